"""Names in data as file names: one component, inside its folder, injective."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from starling.sim.console.names import distinct_names, file_name, scene_folder

any_text = st.text(max_size=300)


@given(any_text)
def test_a_file_name_is_one_component_inside_its_folder(name: str) -> None:
    written = file_name(name)
    assert Path(written).name == written
    assert written not in ("", ".", "..")
    assert not written.startswith(".")
    assert len(written.encode()) <= 120
    assert not set(written) & set('/\\\0\n:*?"<>|')


@given(any_text, any_text)
def test_different_names_give_different_file_names(first: str, second: str) -> None:
    assert (file_name(first) == file_name(second)) == (first == second)


@pytest.mark.parametrize(("shared", "count"), [("a" * 500, 3), ("é" * 200, 3), ("/" * 200, 3)])
def test_long_names_that_differ_at_the_end_stay_different(shared: str, count: int) -> None:
    assert len({file_name(f"{shared}{number}") for number in range(count)}) == count


@pytest.mark.parametrize("name", ["capture.toml", "sensor.toml", "starling.json", ".", ".hid"])
def test_a_scene_takes_no_name_of_a_set(name: str) -> None:
    folder = scene_folder(name)
    assert folder != name
    assert Path(folder).name == folder and not folder.startswith(".")


@pytest.mark.parametrize("name", ["kitchen", "room 2", "lab_3.b", "Küche", "a@b", "wall-0.8"])
def test_usual_names_stay(name: str) -> None:
    assert file_name(name) == name


@pytest.mark.parametrize(
    ("name", "written"),
    [("../x", "%2E.%2Fx"), ("/etc", "%2Fetc"), ("a\0", "a%00"), ("100%", "100%25"), ("", "%")],
)
def test_other_characters_are_escaped(name: str, written: str) -> None:
    assert file_name(name) == written


paths = st.lists(st.sampled_from(["a", "b", "c"]), min_size=1, max_size=4).map(
    lambda parts: Path("/", *parts, "mesh.obj")
)


@given(st.lists(paths, max_size=8))
def test_different_paths_get_different_names(files: list[Path]) -> None:
    names = distinct_names(files)
    assert set(names) == set(files)
    assert len(set(names.values())) == len(names)


def test_folders_are_named_only_where_stems_are_equal() -> None:
    files = [Path("x/cup.ply"), Path("x/can/textured.obj"), Path("x/box/textured.obj")]
    assert [distinct_names(files)[file] for file in files] == [
        "cup",
        "can-textured",
        "box-textured",
    ]


def test_names_that_only_differ_in_suffix_or_separator_stay_different() -> None:
    files = [Path("a/b.ply"), Path("a/b.obj"), Path("a-b.ply"), Path("x/a-b.ply")]
    assert len(set(distinct_names(files).values())) == 4
