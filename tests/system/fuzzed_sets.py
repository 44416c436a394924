"""Plans and data sets of the fuzz tests."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import tomli_w

from starling.sim.captures import info as capture_info
from starling.sim.captures import png
from starling.sim.datasets import index, render_view, set_folder, shard, verify
from starling.sim.datasets import plan as plans
from starling.sim.datasets.render_view import RenderedView
from starling.sim.datasets.workers import TaskResult
from tests.system import mutations
from tests.system.fuzzed_parts import (
    INFO,
    RECORD,
    Format,
    as_json,
    as_toml,
    depth_codes,
    plain_file,
)

_TOML, _JSON, _WORDS = mutations.toml_text, mutations.json_text, mutations.words
_PLAN = {
    **{"seed": 1, "scenes": 2, "views": 2, "frames": 1, "layers": ["infrared", "truth"]},
    "source": [
        {"kind": "builtin", "scene": "clutter", "number": {"low": 0, "high": 9, "whole": True}},
        {"kind": "builtin", "scene": "wall", "number": 1.5, "weight": 0.5},
    ],
    "sensor": [
        {
            "preset": "d435",
            "weight": 2.0,
            "set": {"projector.power_w": {"low": 0.01, "high": 0.3, "log": True}, "left.gain": 2.0},
            "effects": {"read_noise": {"of": [1.0, 3.0]}},
        }
    ],
    "pose": {"shift_m": [0.0, {"low": -0.1, "high": 0.1}, 0.0], "turn_deg": [0.0, 0.0, 0.0]},
}


# Data sets of `generate`.


def _views() -> tuple[RenderedView, ...]:
    views = []
    for number in range(2):
        name = f"{number:07d}"
        content = {
            f"{name}/truth.png": png.encode(depth_codes()),
            f"{name}/0/ir_left.png": png.encode(depth_codes(np.uint8)),
            f"{name}/0/frame.json": as_json(RECORD),
        }
        row = {
            **{"frame": number, "view": number, "scene": 0, "repeat": 0, "name": f"{name}/0"},
            **{"room": "clutter", "sensor": "d435", "seed": number, "ndp_rate": 0.1, "gain": 1.0},
            **{"mean_dn": 20.0, "exposure_s": 0.01, "files": sorted(content)},
            "bytes": sum(map(len, content.values())),
            "sha256": render_view.fingerprint(content),
        }
        views.append(RenderedView(name=name, files=content, rows=(row,)))
    return tuple(views)


def _data_set(name: str, *, finished: bool = True) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        run = {"folder": "/", "layout": "shards", "shard_frames": 4, "variant": "scalar_rgb"}
        text = tomli_w.dumps({"plan": _PLAN, "run": run, "files": {"a.ply": "0" * 64}})
        with set_folder.opened(folder / "set", text, "shards") as opened:
            skipped = ({"view": 3, "why": "no file"},)
            opened.put(TaskResult(number=0, views=_views(), skipped=skipped))
            opened.describe(capture_info.from_table(INFO))
            if finished:
                opened.finish({"verb": "generate"})
        return folder / "set" / name

    return write


def _verify(path: Path) -> object:
    return verify.verify(path.parent, sample=0)


def _finish(path: Path) -> object:
    """Finish the set of a part; its folder of parts is deleted then, and made again."""
    part = path.read_bytes()
    folder = set_folder.SetFolder(path.parent.parent, "shards")
    try:
        folder.finish({"verb": "generate"})
        return index.read(folder.path)
    finally:
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(part)


def _read_plan(path: Path) -> object:
    plan = plans.read(path)
    return [plans.view(plan, number) for number in range(min(plan.scenes * plan.views, 3))]


def _unpack(path: Path) -> object:
    return shard.unpack(path.read_bytes(), path.name)


FORMATS = {
    "plan": Format(write=plain_file("plan.toml", as_toml(_PLAN)), read=_read_plan, mutator=_TOML),
    "set's plan.toml": Format(write=_data_set("plan.toml"), read=_verify, mutator=_TOML),
    "set's capture.toml": Format(
        write=_data_set("capture.toml"), read=_verify, mutator=_TOML, slow=True
    ),
    "starling.json": Format(
        write=_data_set("starling.json"), read=_verify, mutator=_JSON, slow=True
    ),
    "SHA256SUMS": Format(write=_data_set("SHA256SUMS"), read=_verify, mutator=_WORDS, slow=True),
    "index.parquet": Format(
        write=_data_set("index.parquet"),
        read=_verify,
        mutator=mutations.parquet,
        native=True,
        slow=True,
    ),
    "part": Format(
        write=_data_set(".parts/000000.json", finished=False), read=_finish, mutator=_JSON
    ),
    "shard": Format(
        write=plain_file("shard-000000.tar", shard.pack(_views())),
        read=_unpack,
        mutator=mutations.tar,
    ),
}
