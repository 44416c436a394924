"""Data sets: identical bits from any run, and complete after any number of interruptions."""

from __future__ import annotations

import errno
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import tomli_w
import trimesh

from starling.patterns.errors import InputError
from starling.sim.captures import capture, exr, png
from starling.sim.captures.info import CaptureInfo
from starling.sim.datasets import generate as generation
from starling.sim.datasets import index, set_folder, shard, workers
from starling.sim.datasets.generate import generate
from starling.sim.datasets.plan import Plan
from starling.sim.datasets.verify import verify
from starling.sim.datasets.workers import Task, TaskResult
from starling.sim.reason import Reason

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
SIZE = {"width": 96, "height": 64, "cx_px": 47.5, "cy_px": 31.5, "fx_px": 50.0, "fy_px": 50.0}
PLAN: dict[str, Any] = {
    "seed": 11,
    "scenes": 5,
    "views": 2,
    "frames": 2,
    "source": [
        {"kind": "builtin", "scene": "wall", "number": {"low": 0.6, "high": 1.5}},
        {"kind": "dropped", "folder": "things", "count": 2},
    ],
    "sensor": [
        {
            "preset": "d435",
            "set": {**SIZE, "matcher.search_px": 48, "baseline_m": {"of": [0.05, 0.06]}},
            "effects": {"lens_blur": {"low": 0.1, "high": 0.8}},
        }
    ],
    "pose": {"turn_deg": [{"low": -5, "high": 5}, 0, 0]},
}


def write(folder: Path, **others: Any) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    things = folder / "things"
    things.mkdir(exist_ok=True)
    trimesh.creation.box((0.1, 0.15, 0.08)).export(things / "box.ply")
    trimesh.creation.cone(0.06, 0.12).export(things / "cone.ply")
    path = folder / "plan.toml"
    path.write_text(tomli_w.dumps({**PLAN, **others}))
    return path


def content(path: Path) -> dict[str, bytes]:
    files = (file for file in path.rglob("*") if file.is_file() and file.name != ".lock")
    return {str(file.relative_to(path)): file.read_bytes() for file in files}


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(tmp_path_factory.mktemp("plan"))


@pytest.fixture(scope="module")
def whole(plan: Path) -> Path:
    out = plan.parent / "whole"
    report = generate(plan, out, workers=1, shard_frames=4)
    assert report["frames"] == 20 and report["missing"] == 0 and report["frames_per_s"] > 0
    return out


@pytest.fixture
def in_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Render in this process, as a worker takes seconds to start."""

    def run(
        plan: Plan,
        info: CaptureInfo,
        out: Path,
        tasks: Sequence[Task],
        workers_most: int,
        *,
        on_disk: bool,
    ) -> Iterator[TaskResult]:
        return (workers.make(plan, info, out, task, on_disk=on_disk) for task in tasks)

    monkeypatch.setattr(generation, "run_locally", run)


def test_two_workers_give_the_result_of_one(plan: Path, whole: Path):
    out = plan.parent / "two"
    generate(plan, out, workers=2, shard_frames=4)
    assert content(out) == content(whole)
    assert not list(out.glob(".parts")) and not list(out.rglob("*.part*"))


def test_a_set_is_read_as_captures_are(whole: Path):
    captures = capture.open_set(whole)
    assert len(captures.scenes) == 10 and {len(item.frames) for item in captures.scenes} == {2}
    rooms = [item.room for item in captures.scenes]
    assert len(set(rooms)) == 5 and rooms[0] == rooms[1]
    assert {item.info.baseline_m for item in captures.scenes} == {0.05, 0.06}
    for scene in captures.scenes:
        frame, truth = scene.frame(0), scene.truth_m()
        assert frame.ir_left is not None and frame.depth_m is not None and truth is not None
        assert (
            frame.record["preset"] == "d435" and 0.1 <= frame.record["effects"]["lens_blur"] <= 0.8
        )
        label, bodies = scene.label(), frame.record["bodies"]
        assert label is not None and label.max() <= len(bodies)
        assert (scene.known() is not None) == (bodies == ["wall"])
        first, second = scene.frame(0).ir_left, scene.frame(1).ir_left
        assert first is not None and second is not None and (first != second).any()
        error = scene.info.disparity_px(frame.depth_m) - scene.info.disparity_px(truth)
        assert np.nanmedian(np.abs(error)) < 1  # Limit of dots half a pixel wide.


@pytest.mark.usefixtures("in_process")
def test_layers_do_not_change_other_files(tmp_path: Path):
    """`reason.png` agrees with `frame.exr`, and with the counts in `frame.json`."""
    few = {"scenes": 1, "views": 1, "frames": 1}
    remaining = write(
        tmp_path / "kept", **few, layers=["infrared", "truth", "reason", "rgb", "exr"]
    )
    for item, out in ((write(tmp_path / "plain", **few), "without"), (remaining, "with")):
        generate(item, tmp_path / out)
    (scene,) = capture.open_set(tmp_path / "with").scenes
    frame = scene.path / "0"
    reason = png.read(frame / "reason.png", "reason")
    np.testing.assert_array_equal(reason, exr.read(frame / "frame.exr")[1].reason)
    counts = scene.record(0)["reasons"]
    assert counts == {
        Reason(code).name.lower(): int((reason == code).sum()) for code in np.unique(reason)
    }
    depth = (frame / "depth.png").read_bytes()
    assert depth == (tmp_path / "without" / scene.name / "0" / "depth.png").read_bytes()
    assert cv2.imread(str(frame / "rgb.png")) is not None


def test_objects_have_their_reported_poses(plan: Path, whole: Path):
    """A mesh's vertices project onto pixels of its label, with the pose in frame.json."""
    seen = 0
    for scene in capture.open_set(whole).scenes:
        record, label = scene.frame(0).record, scene.label()
        assert label is not None
        for placed in record["objects"]:
            mesh = trimesh.load_mesh(plan.parent / "things" / placed["mesh"])
            pose = np.array(placed["left_from_mesh"])
            centre = pose[:3, :3] @ mesh.centroid + pose[:3, 3]
            x = scene.info.fx_px * centre[0] / centre[2] + scene.info.cx_px
            y = scene.info.fy_px * centre[1] / centre[2] + scene.info.cy_px
            number = record["bodies"].index(placed["body"]) + 1
            if (label == number).sum() > 20:
                near = label[int(y) - 2 : int(y) + 4, int(x) - 2 : int(x) + 4]
                seen += number in near
    assert seen >= 3


@pytest.mark.usefixtures("in_process")
def test_shards_hold_the_files_of_folders(plan: Path, whole: Path):
    out = plan.parent / "shards"
    generate(plan, out, workers=1, layout="shards", shard_frames=4)
    archives = sorted(out.glob("*.tar"))
    assert [item.name for item in archives] == [shard.name(number) for number in range(5)]
    result: dict[str, bytes] = {}
    for archive in archives:
        result |= shard.unpack(archive.read_bytes())
    in_folders = content(whole)
    assert result == {name: in_folders[name] for name in in_folders if "/" in name}
    sums = [[row["sha256"] for row in index.read(path)] for path in (out, whole)]
    assert sums[0] == sums[1]
    report = verify(out, sample=1)
    assert (report["frames"], report["missing"], report["duplicate"], report["differing"]) == (
        20,
        0,
        0,
        0,
    )


def start(plan: Path, out: Path) -> subprocess.Popen[bytes]:
    """Start a run on the command line, in a process group of its own."""
    command = [sys.executable, "-m", "starling", "generate", str(plan)]
    command += ["--out", str(out), "--workers", "1", "--shard-frames", "4"]
    return subprocess.Popen(command, stderr=subprocess.DEVNULL, start_new_session=True)


def kill(run: subprocess.Popen[bytes]) -> None:
    if run.poll() is None:
        os.killpg(run.pid, signal.SIGKILL)
    run.wait()


@pytest.mark.usefixtures("in_process")
def test_killed_run_resumes_to_the_same_set(plan: Path, whole: Path):
    """The run is killed as soon as one of its five tasks is complete."""
    out = plan.parent / "killed"
    run = start(plan, out)
    while run.poll() is None and not list(out.glob(".parts/*.json")):
        time.sleep(0.02)
    kill(run)
    assert list(out.rglob("frame.json"))
    generate(plan, out, workers=1, shard_frames=4)
    assert content(out) == content(whole)


@pytest.mark.usefixtures("in_process")
def test_killed_worker_stops_the_run_without_losses(plan: Path, whole: Path):
    out = plan.parent / "orphan"
    script = (
        "import os, sys\n"
        "from pathlib import Path\n"
        "from starling.sim.datasets import workers\n"
        "from starling.sim.datasets.generate import generate\n"
        "from starling.sim.datasets.workers import make\n"
        "def die(plan, info, out, task, *, on_disk):\n"
        "    result = make(plan, info, out, task, on_disk=on_disk)\n"
        "    if task.number == 2: os.kill(os.getpid(), 9)\n"
        "    return result\n"
        "workers.make = die\n"
        "if __name__ == '__main__':\n"
        "    generate(Path(sys.argv[1]), Path(sys.argv[2]), workers=1, shard_frames=4)\n"
    )
    file = plan.parent / "die.py"
    file.write_text(script)
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, str(file), str(plan), str(out)],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert "worker must live as long as the run" in done.stderr
    assert not (out / "starling.json").exists()
    assert list(out.glob(".*.partial"))  # Views that the worker wrote.
    generate(plan, out, workers=1, shard_frames=4)
    assert content(out) == content(whole)


@pytest.mark.usefixtures("in_process")
def test_full_disk_stops_the_run_which_can_be_resumed(plan: Path, whole: Path, monkeypatch: Any):
    out = plan.parent / "full"
    written, renamed = [0], os.replace

    def full(source: Path, target: Path) -> None:
        written[0] += 1
        if written[0] > 4:
            raise OSError(errno.ENOSPC, "No space left on device")
        renamed(source, target)

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(InputError, match=r"out must have room on its disk; got .*, disk full"):
        generate(plan, out, workers=1, shard_frames=4)
    monkeypatch.undo()
    assert 0 < len(list((out / ".parts").glob("*.json"))) < 5
    generate(plan, out, workers=1, shard_frames=4)
    assert content(out) == content(whole)


def test_run_killed_before_writing_its_plan_restarts(plan: Path, tmp_path: Path):
    out = tmp_path / "set"
    (out / ".parts").mkdir(parents=True)
    (out / ".lock").touch()
    (out / ".plan.toml.1234abcd.partial").write_text("half")
    with set_folder.opened(out, "x = 1\n", "folders") as folder:
        assert folder.done([Task(number=0, views=(0,))], 1) == set()
    assert (out / "plan.toml").read_text() == "x = 1\n"
    assert not list(out.glob(".*.partial"))


def test_finished_set_is_unchanged(plan: Path, whole: Path):
    before = content(whole)
    report = generate(plan, whole, workers=1, shard_frames=4)
    assert report["frames"] == 20 and report["frames_per_s"] is None
    assert content(whole) == before


def test_set_of_another_plan_is_refused(plan: Path, whole: Path, tmp_path: Path):
    second = write(plan.parent / "other", seed=12)
    with pytest.raises(InputError, match=r"plan must be that of .*-seed = 11; \+seed = 12"):
        generate(second, whole, workers=1, shard_frames=4)
    with pytest.raises(InputError, match=r"-shard_frames = 4; \+shard_frames = 8"):
        generate(plan, whole, workers=1, shard_frames=8)
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "thesis.tex").touch()
    with pytest.raises(InputError, match="out must be a new folder or an unfinished set"):
        generate(plan, tmp_path / "full", workers=1)
    before = content(plan.parent / "other")
    with pytest.raises(InputError, match="out must be a new folder or an unfinished set"):
        generate(second, second.parent, workers=1)  # It holds the plan itself.
    assert content(second.parent) == before and not (second.parent / ".lock").exists()
    with (
        set_folder.opened(tmp_path / "held", "x", "folders"),
        pytest.raises(InputError, match="out must be used by one run at a time"),
        set_folder.opened(tmp_path / "held", "x", "folders"),
    ):
        pass
    for flags, message in (
        ({"workers": -1}, "workers must be an integer in"),
        ({"shard_frames": 0}, "shard_frames must be an integer in"),
        ({"ray": "local", "workers": 1}, "workers must be 0 with ray"),
        ({"ray": "here"}, "ray must be HOST:PORT or local"),
        ({"ray": "127.0.0.1:1"}, "ray must answer; got 127.0.0.1:1"),
    ):
        with pytest.raises(InputError, match=message):
            generate(plan, tmp_path / "new", **flags)


@pytest.mark.skipif(os.geteuid() == 0, reason="root writes everywhere")
def test_unwritable_folder_is_refused(plan: Path, tmp_path: Path):
    tmp_path.chmod(0o500)
    with pytest.raises(InputError, match="out must be writable"):
        generate(plan, tmp_path / "set", workers=1)


@pytest.mark.parametrize("missing", ["stop", "skip"])
def test_missing_mesh_stops_the_run_or_is_reported(tmp_path: Path, missing: str):
    """The mesh exists when the plan is read, and is damaged when its view is rendered."""
    path = write(tmp_path, missing=missing, frames=1)
    (tmp_path / "things" / "cone.ply").write_bytes(b"ply\n")
    out = tmp_path / "set"
    if missing == "stop":
        with pytest.raises(InputError, match="scene must be a mesh"):
            generate(path, out, workers=1, shard_frames=2)
        return
    report = generate(path, out, workers=1, shard_frames=2)
    assert report["skipped"] and report["frames"] + len(report["skipped"]) == 10
    assert all("cone.ply" in entry["why"] for entry in report["skipped"])
    assert verify(out, sample=0)["missing"] == 0


def test_damaged_part_of_an_unfinished_set_is_refused_by_name(
    plan: Path, whole: Path, tmp_path: Path
):
    out = shutil.copytree(whole, tmp_path / "set")
    (out / "starling.json").unlink()
    (out / ".parts").mkdir(exist_ok=True)
    for damaged in (b"[]", b"{}", b"\xff", b'{"rows": [{}], "skipped": []}'):
        (out / ".parts" / "000003.json").write_bytes(damaged)
        with pytest.raises(InputError, match=r"part of the set must be whole; .*000003\.json"):
            generate(plan, out, workers=1, shard_frames=4)


@pytest.mark.usefixtures("in_process")
def test_mesh_replaced_by_another_of_equal_size_is_another_set(tmp_path: Path):
    copied = write(tmp_path / "copy", scenes=1, views=1, frames=1)
    generate(copied, tmp_path / "set", workers=1, shard_frames=4)
    mesh = copied.parent / "things" / "box.ply"
    data = bytearray(mesh.read_bytes())
    data[-1] ^= 1
    mesh.write_bytes(bytes(data))
    with pytest.raises(InputError, match=r"plan must be that of .*box\.ply"):
        generate(copied, tmp_path / "set", workers=1, shard_frames=4)


def test_missing_pyarrow_or_ray_is_refused_with_advice(monkeypatch: Any, tmp_path: Path):
    for name in ("pyarrow", "ray"):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(InputError, match=r"index needs pyarrow.*pip install -e '\.\[data\]'"):
        index.read(tmp_path)
    with pytest.raises(InputError, match="index needs pyarrow"):
        generate(write(tmp_path), tmp_path / "set", workers=1)
    with pytest.raises(InputError, match=r"cluster needs ray.*pip install -e '\.\[ray\]'"):
        workers._ray()
