"""Verification of data sets: every damage of every file is a finding."""

from __future__ import annotations

import io
import shutil
import tarfile
from pathlib import Path
from typing import Any

import cv2
import pytest

from starling import command_line
from starling.patterns.errors import InputError
from starling.sim.datasets import index, shard
from starling.sim.datasets.generate import generate
from starling.sim.datasets.verify import verify
from tests.system.test_generate import write


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(tmp_path_factory.mktemp("plan"))


@pytest.fixture(scope="module")
def whole(plan: Path) -> Path:
    out = plan.parent / "whole"
    generate(plan, out, workers=1, shard_frames=4)
    return out


def test_verify_finds_missing_duplicate_and_changed_frames(
    plan: Path, whole: Path, tmp_path: Path, capsys: Any, monkeypatch: Any
):
    out = tmp_path / "set"
    shutil.copytree(whole, out)
    assert command_line.main(["verify", str(out), "--sample", "0"]) == 0
    image = out / "0000003" / "1" / "ir_left.png"
    codes = cv2.imread(str(image), cv2.IMREAD_UNCHANGED)
    assert codes is not None
    codes[0, 0] ^= 1
    cv2.imwrite(str(image), codes)
    (out / "0000005" / "0" / "depth.png").unlink()
    rows = index.read(out)
    (out / index.FILE).write_bytes(index.encode([*rows[:-2], rows[0]]))
    report = verify(out, sample=0)
    assert report["frames"] == 18 and report["missing"] == 3
    assert report["duplicate"] == 1 and report["differing"] == 1
    assert command_line.main(["verify", str(out), "--sample", "0"]) == 1
    shutil.rmtree(out)
    shutil.copytree(whole, out)
    rows = [{**row, "sha256": "0"} if row["frame"] == 0 else row for row in index.read(out)]
    (out / index.FILE).write_bytes(index.encode(rows))
    assert verify(out, sample=10)["differing"] == 1
    (out / index.FILE).write_bytes(b"parquet")
    with pytest.raises(InputError, match=r"index.parquet must be a Parquet file"):
        index.read(out)
    with pytest.raises(InputError, match=r"set must have its starling.json"):
        verify(tmp_path, sample=0)
    capsys.readouterr()


@pytest.mark.parametrize("sample", [-1, 1.5, None])
def test_sample_must_be_a_count(tmp_path: Path, sample: Any):
    with pytest.raises(InputError, match=r"sample must be an integer in .*; got"):
        verify(tmp_path, sample=sample)


OWN_FILES = ("capture.toml", "plan.toml", "index.parquet", "starling.json", "SHA256SUMS")


@pytest.mark.parametrize("name", OWN_FILES)
@pytest.mark.parametrize("damage", ["absent", "empty", "other", "changed"])
def test_verify_reports_damage_of_every_own_file(
    whole: Path, tmp_path: Path, name: str, damage: str
):
    out = tmp_path / "set"
    shutil.copytree(whole, out)
    data = (out / name).read_bytes()
    (out / "0000005" / "0" / "depth.png").unlink()
    if damage == "absent":
        (out / name).unlink()
    else:
        changed = bytearray(data)
        changed[len(data) // 2] ^= 1
        (out / name).write_bytes({"empty": b"", "other": b"[]", "changed": bytes(changed)}[damage])
    findings = verify(out, sample=0)["findings"]
    files = {finding["file"] for finding in findings}
    assert set(OWN_FILES) & files  # A wrong checksum is reported for the file that it names.
    if name != "index.parquet":  # The frames are checked although another file is damaged.
        assert "0000005/0" in files
    assert command_line.main(["verify", str(out), "--sample", "0"]) == 1


def test_damaged_archives_are_findings(plan: Path, tmp_path: Path):
    out = tmp_path / "set"
    generate(plan, out, workers=1, shard_frames=4, layout="shards")
    archives = sorted(out.glob("*.tar"))
    archives[0].write_bytes(archives[0].read_bytes()[:5000])
    archives[1].unlink()
    archives[2].write_bytes(b"")
    report = verify(out, sample=0)
    assert report["missing"] == 12
    assert {archive.name for archive in archives[:3]} <= {
        finding["file"] for finding in report["findings"]
    }


def test_findings_are_printed_as_rows(whole: Path, tmp_path: Path, capsys: Any):
    out = tmp_path / "set"
    shutil.copytree(whole, out)
    (out / "0000005" / "0" / "depth.png").unlink()
    assert command_line.main(["verify", str(out), "--sample", "0"]) == 1
    assert "0000005/0" in (printed := capsys.readouterr().out)
    assert "lacks 0000005/0/depth.png" in printed


def problems(out: Path, sample: int = 0) -> dict[str, str]:
    return {row["file"]: row["problem"] for row in verify(out, sample=sample)["findings"]}


def test_files_that_the_index_does_not_list_are_findings(whole: Path, tmp_path: Path):
    out = tmp_path / "set"
    shutil.copytree(whole, out)
    (out / "README.txt").write_text("The user's own.")
    (out / "0000000" / ".DS_Store").touch()
    assert not problems(out)
    shutil.copy(out / "capture.toml", out / "0000000" / "camera.toml")
    shutil.copytree(out / "0000001" / "0", out / "0000001" / "7")
    (out / "shard-000009.tar").touch()
    listed = problems(out)
    assert set(listed.values()) == {"is not listed in index.parquet"}
    expected = {"0000000/camera.toml", "0000001/7/depth.png", "shard-000009.tar"}
    assert expected <= set(listed)


@pytest.mark.parametrize(
    ("column", "value", "problem"),
    [
        ("view", 10**6, "is not in the plan"),
        ("repeat", 5, "is not in the plan"),
        ("frame", -1, "has another frame in index.parquet than in the plan"),
        ("name", "0000001/0", "has another name in"),
        ("room", "attic", "has another room in"),
        ("seed", 3, "has another seed in"),
        ("bytes", 0, "differs from its checksum in the index"),
    ],
)
def test_rows_that_contradict_plan_or_files_are_findings(
    whole: Path, tmp_path: Path, column: str, value: Any, problem: str
):
    out = tmp_path / "set"
    shutil.copytree(whole, out)
    rows = index.read(out)
    (out / index.FILE).write_bytes(index.encode([{**rows[0], column: value}, *rows[1:]]))
    assert any(text.startswith(problem) for text in problems(out).values())


def test_figures_that_differ_from_the_regenerated_ones_are_findings(whole: Path, tmp_path: Path):
    out = tmp_path / "set"
    shutil.copytree(whole, out)
    rows = [{**row, "mean_dn": 0.0} for row in index.read(out)]
    (out / index.FILE).write_bytes(index.encode(rows))
    assert "differs from the regenerated frame" in problems(out, sample=1).values()


def members(archive: Path) -> dict[str, bytes]:
    contents = {}
    with tarfile.open(archive) as read:
        for entry in read:
            file = read.extractfile(entry)
            assert file is not None
            contents[entry.name] = file.read()
    return contents


def tar(contents: list[tuple[str, bytes]]) -> bytes:
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w", format=tarfile.USTAR_FORMAT) as archive:
        for name, data in contents:
            entry = tarfile.TarInfo(name)
            entry.size = len(data)
            archive.addfile(entry, io.BytesIO(data))
    return buffer.getvalue()


def test_additions_to_archives_are_findings(plan: Path, tmp_path: Path):
    out = tmp_path / "set"
    generate(plan, out, workers=1, shard_frames=4, layout="shards")
    archive = out / shard.name(0)
    contents = list(members(archive).items())
    archive.write_bytes(tar([*contents, ("0000000/0.camera.toml", b"width = 3")]))
    file = f"{archive.name}: 0000000/camera.toml"
    assert problems(out) == {file: "is not listed in index.parquet"}
    archive.write_bytes(tar([(contents[0][0], b"other"), *contents]))
    assert "two different 0000000/0/depth.png" in problems(out)[archive.name]
    archive.write_bytes(tar(contents) + b"more")
    assert "data after its end" in problems(out)[archive.name]
