"""Verification of data sets: every damage of every file is a finding."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import cv2
import pytest

from starling import command_line
from starling.patterns.errors import InputError
from starling.sim.datasets import index
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
