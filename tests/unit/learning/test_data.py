"""Data sets as torch reads them: every frame once, whoever asks."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from torch.utils.data import DataLoader

from starling.learning.data import torch_dataset
from starling.learning.data.torch_dataset import Frames, Stream
from starling.patterns.errors import InputError
from starling.sim.captures import info as capture_info
from starling.sim.captures import writer
from starling.sim.datasets import index, shard
from starling.sim.datasets.render_view import Taken, fingerprint
from starling.sim.sensor import presets

VIEWS, REPEATS = 6, 2


def png(image: np.ndarray) -> bytes:
    return cv2.imencode(".png", image)[1].tobytes()


def taken(view: int) -> Taken:
    """A view of constants that tell which frame it is."""
    name, shape = f"{view:07d}", (6, 8)
    files = {
        f"{name}/room": f"room-{view // 2}\n".encode(),
        f"{name}/truth.png": png(np.full(shape, 1000 + view, np.uint16)),
        f"{name}/label.png": png(np.full(shape, view, np.uint16)),
    }
    rows = []
    for repeat in range(REPEATS):
        own = {
            f"{name}/{repeat}/ir_left.png": png(np.full(shape, 10 * view + repeat, np.uint8)),
            f"{name}/{repeat}/ir_right.png": png(np.full(shape, 5, np.uint8)),
            f"{name}/{repeat}/depth.png": png(np.diag(np.arange(8, dtype=np.uint16))[:6]),
            f"{name}/{repeat}/frame.json": json.dumps({"view": view}).encode(),
        }
        files |= own
        number = view * REPEATS + repeat
        rows.append(
            {
                **{"frame": number, "view": view, "scene": view // 2, "repeat": repeat},
                **{"name": f"{name}/{repeat}", "room": f"room-{view // 2}", "sensor": "d435"},
                **{"seed": view, "ndp_rate": 0.1, "mean_dn": 5.0, "exposure_s": 0.01, "gain": 1.0},
                **{"files": sorted(own), "bytes": 1, "sha256": fingerprint(own)},
            }
        )
    return Taken(name=name, files=files, rows=tuple(rows))


@pytest.fixture(params=["folders", "shards"])
def made(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    views = [taken(view) for view in range(VIEWS)]
    rows = []
    for number in range(0, VIEWS, 2):
        pair = views[number : number + 2]
        where = shard.name(number // 2) if request.param == "shards" else ""
        rows += [{**row, "shard": where} for one in pair for row in one.rows]
        if where:
            (tmp_path / where).write_bytes(shard.packed(pair))
            continue
        for name, content in {n: d for one in pair for n, d in one.files.items()}.items():
            (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
            (tmp_path / name).write_bytes(content)
    (tmp_path / index.FILE).write_bytes(index.encoded(rows))
    info = writer.info_of(presets.load("d435"), source="", licence="", notes="")
    (tmp_path / capture_info.FILE).write_text(capture_info.dumps(info))
    return tmp_path


def test_a_frame_is_what_was_written(made: Path):
    frames = Frames(made, ("ir_left", "depth_m", "truth_m", "label"))
    assert len(frames) == VIEWS * REPEATS and frames.rooms == ["room-0", "room-1", "room-2"]
    one = frames[7]
    assert one["frame"] == 7 and one["room"] == "room-1" and one["record"] == {"view": 3}
    assert one["ir_left"].dtype == torch.float32 and (one["ir_left"] == 31).all()
    assert one["truth_m"][0, 0].item() == pytest.approx(1.003)
    assert one["label"].dtype == torch.int32 and (one["label"] == 3).all()
    assert torch.isnan(one["depth_m"][0, 0]) and one["depth_m"][2, 2].item() == pytest.approx(0.002)


def test_a_view_s_own_camera_counts(made: Path):
    if not (made / "0000000").exists():
        return
    info = capture_info.read(made / capture_info.FILE)
    own = dataclasses.replace(info, depth_unit_m=0.0001)
    (made / "0000000" / capture_info.OWN).write_text(capture_info.dumps(own))
    frames = Frames(made, ("truth_m",))
    assert frames[0]["truth_m"][0, 0].item() == pytest.approx(0.1)
    assert frames[2]["truth_m"][0, 0].item() == pytest.approx(1.001)


def test_rooms_part_a_set(made: Path):
    first = Frames(made, rooms=["room-0", "room-2"])
    assert len(first) == 8 and first.rooms == ["room-0", "room-2"]
    with pytest.raises(InputError, match="room must be a known name; got 'romm-1'"):
        Frames(made, rooms=["romm-1"])


def numbers(loader: DataLoader) -> list[int]:
    return [int(number) for batch in loader for number in batch["frame"]]


@pytest.mark.parametrize(("workers", "ranks"), [(0, 1), (0, 3), (2, 1)])
def test_a_stream_gives_every_frame_once(made: Path, workers: int, ranks: int):
    frames = Frames(made, ("ir_left",))
    found: list[int] = []
    for rank in range(ranks):
        stream = Stream(frames, rank=rank, ranks=ranks)
        context = "spawn" if workers else None
        loader = DataLoader(stream, 4, num_workers=workers, multiprocessing_context=context)
        found += numbers(loader)
    assert sorted(found) == list(range(VIEWS * REPEATS))


def test_epochs_have_orders_of_their_own(made: Path):
    stream = Stream(Frames(made, ("ir_left",)), seed=1)
    orders = []
    for epoch in range(4):
        stream.set_epoch(epoch)
        orders.append(tuple(one["frame"] for one in stream))
    assert len(set(orders)) > 1 and {tuple(sorted(one)) for one in orders} == {tuple(range(12))}
    stream.set_epoch(0)
    assert tuple(one["frame"] for one in stream) == orders[0]


def test_what_is_not_there_is_refused(made: Path, tmp_path: Path):
    with pytest.raises(InputError, match="image must be a known name; got 'ir_lfet'"):
        Frames(made, ("ir_lfet",))
    with pytest.raises(InputError, match=r"frame 0000000/0 must have rgb.png; got none"):
        Frames(made, ("rgb",))[0]
    with pytest.raises(InputError, match="rank must be in"):
        Stream(Frames(made), rank=2, ranks=2)
    with pytest.raises(InputError, match=r"set must have an index\.parquet"):
        Frames(tmp_path / "none")
    frames = Frames(made, ("ir_left",))
    if (archive := made / shard.name(0)).exists():
        archive.unlink()
        torch_dataset._archive.cache_clear()
        with pytest.raises(InputError, match="shard must be readable"):
            frames[0]
    for path in made.glob("0000000/0/ir_left.png"):
        path.write_bytes(b"no image")
        with pytest.raises(InputError, match="ir_left must be a PNG file; got 0000000/0"):
            Frames(made, ("ir_left",))[0]
