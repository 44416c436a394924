"""`scene.toml`: reading, writing, and the text of all refusals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from starling.patterns.errors import InputError
from starling.sim.captures import capture
from starling.sim.geometry import frames
from starling.sim.scene import scene_file
from starling.sim.scene.scene_file import KnownMaterial, SceneFile

TEXT = """scene = "table.ply"
left_from_world = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0.8], [0, 0, 0, 1]]

[[materials]]
body = "ball*"
reflectance = 0.3
"""

_DEGREES = st.floats(-120, 120)
_METRES = st.floats(-1e4, 1e4)
# File names cannot contain NUL.
_WORDS = st.text(st.characters(codec="utf-8", exclude_characters="\0"), min_size=1).filter(
    str.strip
)


def _rows(pose: np.ndarray) -> scene_file.Rows:
    a, b, c, d = (tuple(map(float, row)) for row in pose)
    return a, b, c, d  # type: ignore[return-value]


def test_a_file_is_read(tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text(TEXT)
    file = scene_file.read(tmp_path / "scene.toml")
    assert (file.scene, file.left_from_world[2]) == ("table.ply", (0.0, 0.0, 1.0, 0.8))
    assert file.materials == (KnownMaterial(body="ball*", reflectance=0.3),)
    np.testing.assert_array_equal(file.world_from_left, frames.pose((0, 0, -0.8)))


def test_a_captured_scene_reads_its_own(small_set: Path) -> None:
    (small_set / "a" / "scene.toml").write_text(TEXT)
    first, second = capture.open_set(small_set).scenes
    known = first.known()
    assert known is not None and known.scene == "table.ply"
    assert second.known() is None


@given(
    word=_WORDS,
    turn=st.tuples(_DEGREES, _DEGREES, _DEGREES),
    shift=st.tuples(_METRES, _METRES, _METRES),
    ambient=st.none() | st.floats(0, 2000),
    materials=st.lists(
        st.builds(KnownMaterial, body=st.text(min_size=1), reflectance=st.floats(0, 1)), max_size=3
    ),
)
def test_written_files_read_back_equal(
    tmp_path_factory: pytest.TempPathFactory,
    word: str,
    turn: tuple[float, float, float],
    shift: tuple[float, float, float],
    ambient: float | None,
    materials: list[KnownMaterial],
) -> None:
    """All rigid poses are accepted and stored without loss."""
    file = SceneFile(
        scene=word,
        left_from_world=_rows(frames.pose(shift, turn)),
        materials=tuple(materials),
        ambient_w_m2=ambient,
    )
    path = tmp_path_factory.getbasetemp() / "round.toml"
    path.write_text(scene_file.dumps(file), encoding="utf-8")
    assert scene_file.read(path) == file
    back = np.array(file.left_from_world) @ file.world_from_left
    np.testing.assert_allclose(back, np.eye(4), atol=1e-6)  # At 10 km.


@given(data=st.binary(max_size=40), position=st.integers(0, len(TEXT)))
def test_any_bytes_are_read_or_refused(
    tmp_path_factory: pytest.TempPathFactory, data: bytes, position: int
) -> None:
    path = tmp_path_factory.getbasetemp() / "fuzz.toml"
    path.write_bytes(TEXT.encode()[:position] + data + TEXT.encode()[position + len(data) :])
    try:
        scene_file.read(path)
    except InputError as error:
        assert "\n" not in str(error)


_POSE = "[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0.8], [0, 0, 0, 1]]"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('scene = "table.ply"', "", "scene must be given; got nothing"),
        ('"table.ply"', '" "', "scene must name a scene; got ' '"),
        ('"table.ply"', '"x\\u0000/y.ply"', r"scene must name a scene; got 'x\\x00/y.ply'"),
        ('"table.ply"', "3", "scene must be of type str; got 3"),
        ('"table.ply"', "", "scene.toml must be TOML"),
        (f"left_from_world = {_POSE}", "", "left_from_world must be given"),
        (_POSE, "1", "left_from_world must be a list of 4"),
        ("[1, 0, 0, 0]", "[1, 0, 0]", "left_from_world must be a list of 4"),
        ("[1, 0, 0, 0]", "[1, 0, 'x', 0]", "left_from_world must be of type float"),
        ("[1, 0, 0, 0]", "[1.00001, 0, 0, 0]", "left_from_world must be rigid, its rotation"),
        ("[1, 0, 0, 0]", "[1, 2e-6, 0, 0]", "left_from_world must be rigid"),
        ("[1, 0, 0, 0]", "[0.999, 0, 0, 0]", "left_from_world must be rigid"),
        ("[1, 0, 0, 0]", "[1e300, 0, 0, 0]", "left_from_world must be rigid"),
        ("[1, 0, 0, 0]", "[nan, 0, 0, 0]", "left_from_world must be rigid"),
        ("[1, 0, 0, 0]", "[-1, 0, 0, 0]", "left_from_world must turn, not mirror"),
        ("0.8]", "inf]", r"shift of left_from_world must be in \[-1e\+07, 1e\+07\]; got inf"),
        ("0.8]", "nan]", "shift of left_from_world must be in"),
        ("[0, 0, 0, 1]", "[0, 0, 0.8, 1]", "last row of left_from_world must be 0 0 0 1; got"),
        ("[0, 0, 0, 1]", "[0, 0, 0, nan]", "last row of left_from_world must be 0 0 0 1; got"),
        ("[[materials]]", "[materials]", "materials must be a list of tables; got"),
        (TEXT[TEXT.index("[[m") :], "[[poses]]", "key must be a known name; got 'p"),
        ("body =", "bodies =", r"key in materials\[0\] must be a known name; got 'bodies'"),
        ('body = "ball*"', "", r"materials\[0\].body must be given"),
        ('"ball*"', '""', "materials.body must name bodies; got ''. Give a name, or "),
        ("[[mat", "ambient_w_m2 = -0.1\n[[mat", r"ambient_w_m2 must be in \[0, 4000\]; got -0.1"),
        ("[[mat", "ambient_w_m2 = '1'\n[[mat", "ambient_w_m2 must be of type float"),
        ("= 0.3", "= 1.3", r"reflectance of ball\* must be in \[0, 1\]; got 1.3"),
        ("= 0.3", "= '0.3'", r"materials\[0\].reflectance must be of type float"),
        (
            "reflectance = 0.3",
            "",
            r"materials of ball\* must give reflectance, kind",
        ),
    ],
)
def test_wrong_files_are_refused(tmp_path: Path, old: str, new: str, message: str) -> None:
    path = tmp_path / "scene.toml"
    assert TEXT.count(old) == 1
    path.write_text(TEXT.replace(old, new))
    with pytest.raises(InputError, match=message) as caught:
        scene_file.read(path)
    assert str(path) in str(caught.value)


def test_entries_of_materials_must_be_tables(tmp_path: Path) -> None:
    head = TEXT[: TEXT.index("[[materials]]")]
    (tmp_path / "scene.toml").write_text(head + "materials = [1]")
    with pytest.raises(InputError, match=r"materials\[0\] must be a table; got 1"):
        scene_file.read(tmp_path / "scene.toml")


def test_files_that_cannot_be_read_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"scene.toml must be readable; got .*No such file"):
        scene_file.read(tmp_path / "scene.toml")
    (tmp_path / "scene.toml").mkdir()
    with pytest.raises(InputError, match=r"scene.toml must be readable"):
        scene_file.read(tmp_path / "scene.toml")


def test_rotations_with_seven_digits_are_accepted() -> None:
    """A pose from a text file may be rounded; the tolerance is 1e-6."""
    pose = np.round(frames.pose((0.1, 0.2, 0.3), (10, 20, 30)), 7)
    assert SceneFile(scene="wall", left_from_world=_rows(pose)).world_from_left.shape == (4, 4)
