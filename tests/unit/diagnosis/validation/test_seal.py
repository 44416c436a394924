"""The seal: its digests, and what breaks it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from starling.diagnosis.validation.camera.errors import WithheldError
from starling.diagnosis.validation.camera.nominal import Nominal
from starling.diagnosis.validation.protocol import seal
from starling.diagnosis.validation.protocol.case import draw


def test_a_sensor_digest_includes_its_pattern_images(tmp_path: Path) -> None:
    sensor, picture = tmp_path / "sensor.toml", tmp_path / "my" / "emitter-0.png"
    picture.parent.mkdir()
    picture.write_bytes(b"dots")
    sensor.write_text('pattern = "my/emitter-0.png"\n')
    first = seal.sensor_digest(sensor)
    picture.write_bytes(b"other dots")
    changed = seal.sensor_digest(sensor)
    sensor.write_text('pattern = "my/emitter-0.png"  # \n')
    assert len({first, changed, seal.sensor_digest(sensor)}) == 3
    assert seal.sensor_digest(Path("d415")) == "d415"


def test_versions_are_the_installed_ones() -> None:
    versions = seal.versions()
    assert versions["numpy"] == np.__version__ and set(versions) == {
        "python",
        "cv2",
        "numpy",
        "scipy",
    }


PUBLIC_FILES = {"families.json": b"{}", "asked.json": b"[1]"}


def test_a_seal_is_verified(tmp_path: Path, camera: Nominal) -> None:
    hidden, public = tmp_path / "hidden", tmp_path / "public"
    drawn = draw(camera, {"null": 4, "single": 9, "pair": 2}, entropy=7)
    digest = seal.seal(drawn, PUBLIC_FILES, hidden, public)
    first, *others = (public / "truth.sha256").read_text().splitlines()
    assert first == f"{digest}  truth.json"
    assert [line.split("  ")[1] for line in others] == [*PUBLIC_FILES, "code"]
    assert {path.name for path in public.iterdir()} == {"truth.sha256", *PUBLIC_FILES}
    assert seal.verify(PUBLIC_FILES, hidden, public) == drawn
    assert seal.code_is_sealed(public)


def test_unsealed_cases_are_drawn_again(tmp_path: Path, camera: Nominal) -> None:
    hidden, public = tmp_path / "hidden", tmp_path / "public"
    seal.seal(draw(camera, {"null": 2}), PUBLIC_FILES, hidden, public)
    (public / "truth.sha256").unlink()
    cases = draw(camera, {"null": 3})
    seal.seal(cases, PUBLIC_FILES, hidden, public)
    assert seal.verify(PUBLIC_FILES, hidden, public) == cases


def test_changed_code_breaks_the_seal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The sealed code is that of all packages and of the folder that holds them."""
    for name in ("sim/a.py", "sim/b.toml", "diagnosis/a.json", "command_line.py"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(name)
    monkeypatch.setattr(seal, "_ROOT", tmp_path)
    seal.seal((), PUBLIC_FILES, tmp_path / "hidden", tmp_path / "public")
    (tmp_path / "sim" / "weights.bin").touch()
    assert seal.code_is_sealed(tmp_path / "public")
    seal.log_code(tmp_path / "public")
    assert seal.code_is_sealed(tmp_path / "public")
    for name in ("command_line.py", "sim/b.toml"):
        (tmp_path / name).write_text("other")
        assert not seal.code_is_sealed(tmp_path / "public")
        (tmp_path / name).write_text(name)
        assert seal.code_is_sealed(tmp_path / "public")
    (tmp_path / "sim" / "b.toml").write_text("other")
    seal.log_code(tmp_path / "public")  # Verdicts of the changed code may exist.
    (tmp_path / "sim" / "b.toml").write_text("sim/b.toml")
    assert not seal.code_is_sealed(tmp_path / "public")


def test_files_of_other_inputs_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seal.record_inputs(tmp_path / "set-0", {"scenes": ["b"]}, exists=False)
    # Nothing was made from the first.
    seal.record_inputs(tmp_path / "set-0", {"scenes": ["a"]}, exists=False)
    seal.record_inputs(tmp_path / "set-0", {"scenes": ["a"]}, exists=True)
    with pytest.raises(WithheldError, match=r'folder must be made of what .*made\.json.*"b"'):
        seal.record_inputs(tmp_path / "set-0", {"scenes": ["b"]}, exists=True)
    monkeypatch.setattr(seal, "code_digest", lambda: "another")
    with pytest.raises(WithheldError, match="folder must be made of what"):
        seal.record_inputs(tmp_path / "set-0", {"scenes": ["a"]}, exists=True)
    with pytest.raises(WithheldError, match="folder must be made of what"):
        seal.record_inputs(tmp_path / "set-1", {"scenes": ["a"]}, exists=True)


def test_broken_seals_are_refused(tmp_path: Path, camera: Nominal) -> None:
    hidden, public = tmp_path / "hidden", tmp_path / "public"
    with pytest.raises(WithheldError, match="seal must have digests"):
        seal.verify(PUBLIC_FILES, hidden, public)
    seal.seal(draw(camera, {"null": 2}), PUBLIC_FILES, hidden, public)
    with pytest.raises(WithheldError, match="seal must not be broken"):
        seal.seal((), PUBLIC_FILES, tmp_path / "other", public)
    for name, rule in (("families.json", "families"), ("asked.json", "asked")):
        with pytest.raises(WithheldError, match=rf"{rule}.json must be what .* has; got \[2\]"):
            seal.verify({**PUBLIC_FILES, name: b"[2]"}, hidden, public)
    with pytest.raises(WithheldError, match=r"got 1{300} \.\.\."):
        seal.verify({"asked.json": b"1" * 301}, hidden, public)
    truth = hidden / "truth.json"
    truth.write_text(truth.read_text().replace("null", "pair", 1))
    with pytest.raises(WithheldError, match="truth must be the one sealed"):
        seal.verify(PUBLIC_FILES, hidden, public)
    truth.unlink()
    with pytest.raises(WithheldError, match="seal must have a truth"):
        seal.verify(PUBLIC_FILES, hidden, public)
    (public / "truth.sha256").write_text("none")
    with pytest.raises(WithheldError, match="seal must have digests"):
        seal.verify(PUBLIC_FILES, hidden, public)


def test_families_are_parsed_from_the_sealed_file() -> None:
    public_files = b'{"a": {"family": "x", "twins": []}, "b": {"family": "y", "twins": ["a"]}}'
    assert seal.parse_families(public_files) == {"a": "x", "b": "y"}


@pytest.mark.parametrize(
    "content", [b"[", b"[]", b'{"gain": 3}', b'{"gain": {"family": 3}}', b"\xff"]
)
def test_damaged_families_are_refused(content: bytes) -> None:
    with pytest.raises(WithheldError, match=f"{seal.FAMILIES} must"):
        seal.parse_families(content)
