"""Views whose files are written as their frames are rendered."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pytest
import tomli_w

from starling.patterns.errors import InputError
from starling.sim.datasets import plan as plans
from starling.sim.datasets import render_view, workers
from starling.sim.datasets.plan import Plan
from starling.sim.datasets.workers import Task

SIZE = {"width": 64, "height": 48, "cx_px": 31.5, "cy_px": 23.5, "fx_px": 50.0, "fy_px": 50.0}
PLAN: dict[str, Any] = {
    "seed": 3,
    "scenes": 1,
    "frames": 3,
    "layers": ["infrared", "truth", "reason"],
    "source": [{"kind": "builtin", "scene": "wall", "number": 0.8}],
    "sensor": [{"preset": "d435", "set": {**SIZE, "matcher.search_px": 48}}],
}


@pytest.fixture
def plan(tmp_path: Path) -> Plan:
    path = tmp_path / "plan.toml"
    path.write_text(tomli_w.dumps(PLAN))
    return plans.read(path)


def rendered(plan: Plan, out: Path, *, on_disk: bool) -> render_view.RenderedView:
    info = render_view.info_of(render_view.camera(plans.view(plan, 0)))
    return render_view.render(plan, 0, info, out, on_disk=on_disk)


def test_files_on_disk_are_those_in_memory(plan: Plan, tmp_path: Path) -> None:
    kept = rendered(plan, tmp_path, on_disk=False)
    staged = rendered(plan, tmp_path, on_disk=True)
    assert staged.rows == kept.rows and not staged.files and kept.staged is None
    assert staged.staged is not None and str(os.getpid()) in staged.staged.name
    content = {
        f"{kept.name}/{path.relative_to(staged.staged)}": path.read_bytes()
        for path in staged.staged.rglob("*")
        if path.is_file()
    }
    assert content == kept.files
    assert sorted(file for row in kept.rows for file in row["files"]) == sorted(content)


def test_frames_name_the_mode_of_the_plan(tmp_path: Path) -> None:
    sensor = {"preset": "d435", "mode": "424x240", "set": SIZE}
    files = [
        rendered(plans.from_table({**PLAN, "sensor": [entry]}, tmp_path), tmp_path, on_disk=False)
        for entry in (sensor, {key: sensor[key] for key in ("preset", "set")})
    ]
    first, second = (json.loads(view.files[f"{view.name}/0/frame.json"]) for view in files)
    assert first["mode"] == "424x240" and "mode" not in second


def test_a_worker_that_cannot_write_is_refused(plan: Plan, tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("")
    info = render_view.info_of(render_view.camera(plans.view(plan, 0)))
    task = Task(number=0, views=(0,))
    with pytest.raises(InputError, match=r"out must be writable; got .*file\. .*directory"):
        list(workers.run_locally(plan, info, blocked, [task], 1, on_disk=True))
