"""Data sets for torch: each frame exactly once."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch
from torch.utils.data import DataLoader

from starling.learning.data import torch_dataset
from starling.learning.data.torch_dataset import Frames, FrameStream
from starling.patterns.errors import InputError
from starling.sim.captures import info as capture_info
from starling.sim.captures import writer
from starling.sim.datasets import index, shard
from starling.sim.datasets.render_view import RenderedView, fingerprint
from starling.sim.sensor import presets

VIEWS, REPEATS = 6, 2


def png(image: np.ndarray) -> bytes:
    return cv2.imencode(".png", image)[1].tobytes()


def taken(view: int) -> RenderedView:
    """A view of constants that identify the frame."""
    name, shape = f"{view:07d}", (6, 8)
    files = {
        f"{name}/room": f"room-{view // 2}\n".encode(),
        f"{name}/truth.png": png(np.full(shape, 1000 + view, np.uint16)),
        f"{name}/label.png": png(np.full(shape, view, np.uint16)),
    }
    rows = []
    for repeat in range(REPEATS):
        original = {
            f"{name}/{repeat}/ir_left.png": png(np.full(shape, 10 * view + repeat, np.uint8)),
            f"{name}/{repeat}/ir_right.png": png(np.full(shape, 5, np.uint8)),
            f"{name}/{repeat}/depth.png": png(np.diag(np.arange(8, dtype=np.uint16))[:6]),
            f"{name}/{repeat}/frame.json": json.dumps({"view": view}).encode(),
        }
        files |= original
        number = view * REPEATS + repeat
        rows.append(
            {
                **{"frame": number, "view": view, "scene": view // 2, "repeat": repeat},
                **{"name": f"{name}/{repeat}", "room": f"room-{view // 2}", "sensor": "d435"},
                **{"seed": view, "ndp_rate": 0.1, "mean_dn": 5.0, "exposure_s": 0.01, "gain": 1.0},
                **{"files": sorted(original), "bytes": 1, "sha256": fingerprint(original)},
            }
        )
    return RenderedView(name=name, files=files, rows=tuple(rows))


@pytest.fixture(params=["folders", "shards"])
def data_set(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    views = [taken(view) for view in range(VIEWS)]
    rows = []
    for number in range(0, VIEWS, 2):
        pair = views[number : number + 2]
        where = shard.name(number // 2) if request.param == "shards" else ""
        rows += [{**row, "shard": where} for item in pair for row in item.rows]
        if where:
            (tmp_path / where).write_bytes(shard.pack(pair))
            continue
        for name, content in {n: d for item in pair for n, d in item.files.items()}.items():
            (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
            (tmp_path / name).write_bytes(content)
    (tmp_path / index.FILE).write_bytes(index.encode(rows))
    info = writer.info_of(presets.load("d435"), source="", licence="", notes="")
    info = dataclasses.replace(info, width=8, height=6)
    (tmp_path / capture_info.FILE).write_text(capture_info.dumps(info))
    return tmp_path


def test_a_frame_has_the_written_content(data_set: Path):
    frames = Frames(data_set, ("ir_left", "depth_m", "truth_m", "label"))
    assert len(frames) == VIEWS * REPEATS and frames.rooms == ["room-0", "room-1", "room-2"]
    item = frames[7]
    assert item["frame"] == 7 and item["room"] == "room-1" and item["record"] == {"view": 3}
    assert item["ir_left"].dtype == torch.float32 and (item["ir_left"] == 31).all()
    assert item["truth_m"][0, 0].item() == pytest.approx(1.003)
    assert item["label"].dtype == torch.int32 and (item["label"] == 3).all()
    assert torch.isnan(item["depth_m"][0, 0]) and item["depth_m"][2, 2].item() == pytest.approx(
        0.002
    )


def test_the_camera_of_a_view_is_used(data_set: Path):
    if not (data_set / "0000000").exists():
        return
    info = capture_info.read(data_set / capture_info.FILE)
    original = dataclasses.replace(info, depth_unit_m=0.0001)
    (data_set / "0000000" / capture_info.OWN).write_text(capture_info.dumps(original))
    frames = Frames(data_set, ("truth_m",))
    assert frames[0]["truth_m"][0, 0].item() == pytest.approx(0.1)
    assert frames[2]["truth_m"][0, 0].item() == pytest.approx(1.001)


def test_rooms_partition_a_set(data_set: Path):
    first = Frames(data_set, rooms=["room-0", "room-2"])
    assert len(first) == 8 and first.rooms == ["room-0", "room-2"]
    with pytest.raises(InputError, match="room must be a known name; got 'romm-1'"):
        Frames(data_set, rooms=["romm-1"])


def numbers(loader: DataLoader) -> list[int]:
    return [int(number) for batch in loader for number in batch["frame"]]


@pytest.mark.parametrize(("workers", "ranks"), [(0, 1), (0, 3), (2, 1)])
def test_a_stream_gives_every_frame_once(data_set: Path, workers: int, ranks: int):
    frames = Frames(data_set, ("ir_left",))
    result: list[int] = []
    for rank in range(ranks):
        stream = FrameStream(frames, rank=rank, ranks=ranks)
        context = "spawn" if workers else None
        loader = DataLoader(stream, 4, num_workers=workers, multiprocessing_context=context)
        result += numbers(loader)
    assert sorted(result) == list(range(VIEWS * REPEATS))


def test_seeds_have_different_orders(data_set: Path):
    frames = Frames(data_set, ("ir_left",))
    orders = [
        tuple(item["frame"] for item in FrameStream(frames, seed=seed)) for seed in (0, 1, 2, 3, 0)
    ]
    assert len(set(orders)) > 1 and {tuple(sorted(order)) for order in orders} == {tuple(range(12))}
    assert orders[-1] == orders[0]


def test_missing_content_is_refused(data_set: Path, tmp_path: Path):
    with pytest.raises(InputError, match="image must be a known name; got 'ir_lfet'"):
        Frames(data_set, ("ir_lfet",))
    with pytest.raises(InputError, match=r"frame 0000000/0 must have rgb.png; got none"):
        Frames(data_set, ("rgb",))[0]
    with pytest.raises(InputError, match="rank must be an integer in"):
        FrameStream(Frames(data_set), rank=2, ranks=2)
    with pytest.raises(InputError, match=r"set must have an index\.parquet"):
        Frames(tmp_path / "none")
    frames = Frames(data_set, ("ir_left",))
    if (archive := data_set / shard.name(0)).exists():
        archive.unlink()
        torch_dataset._archive.cache_clear()
        with pytest.raises(InputError, match=r"shard-\d+\.tar must be readable"):
            frames[0]
    for path in data_set.glob("0000000/0/ir_left.png"):
        path.write_bytes(b"no image")
        with pytest.raises(
            InputError, match=r"ir_left must be a PNG file; got .*0000000/0/ir_left\.png"
        ):
            Frames(data_set, ("ir_left",))[0]


def test_iterators_of_names_are_lists(data_set: Path):
    frames = Frames(data_set, iter(("ir_left", "depth_m")), rooms=iter(["room-1"]))  # type: ignore[arg-type]
    assert len(frames) == 4 and {"ir_left", "depth_m"} <= frames[0].keys()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"images": "ir_left"}, "images must be of type list; got 'ir_left'. Give a list"),
        ({"images": None}, "images must be of type Iterable; got None"),
        ({"images": (5,)}, "entry of images must be of type str; got 5"),
        ({"rooms": "room-1"}, "rooms must be of type list; got 'room-1'"),
        ({"rooms": None}, "rooms must be of type Iterable"),
        ({"path": None}, "path must be of type str or Path; got None. Give the set's folder"),
        ({"path": 5}, "path must be of type str or Path"),
    ],
)
def test_frames_refuse_other_types(data_set: Path, change: dict[str, Any], message: str):
    with pytest.raises(InputError, match=f"^{message}"):
        Frames(**{"path": data_set, **change})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"frames": "set"}, "frames must be of type Frames; got 'set'. Open them"),
        ({"ranks": 1.5}, "ranks must be an integer in"),
        ({"ranks": 2, "rank": 0.5}, "rank must be an integer in"),
        ({"seed": -1}, "seed must be an integer in"),
        ({"seed": None}, "seed must be an integer in"),
    ],
)
def test_streams_refuse_other_types(data_set: Path, change: dict[str, Any], message: str):
    with pytest.raises(InputError, match=f"^{message}"):
        FrameStream(**{"frames": Frames(data_set), **change})


def test_a_damaged_record_is_named(data_set: Path):
    for path in data_set.glob("0000000/0/frame.json"):
        path.write_bytes(b"{")
        with pytest.raises(
            InputError, match=r"frame.json must be JSON; got .*0000000/0/frame.json"
        ):
            Frames(data_set)[0]
