"""Data sets of `starling generate` for torch: by number, or in order and parted among workers."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch.utils.data import Dataset, IterableDataset, get_worker_info

from starling.patterns.errors import in_interval, one_of, refuse
from starling.sim.captures import info as capture_info
from starling.sim.captures.info import CaptureInfo
from starling.sim.datasets import index, shard
from starling.sim.stereo import depth

Sample = dict[str, Any]

IMAGES = ("ir_left", "ir_right", "depth_m", "truth_m", "label", "rgb")
_FILES = {"depth_m": "depth", "truth_m": "truth"}  # Else as the image is called.


class Frames(Dataset[Sample]):
    """Frames of a data set by number.

    A sample has the images asked for as tensors, float32 (h, w) (`rgb` (3, h, w), 0..1; depth [m],
    NaN = none; `label` int32), and `frame`, `scene`, `room`, `sensor`, `record`. The keys of
    `record` differ from frame to frame: a loader's `collate_fn` must leave it out or list it.

    Example:
        >>> frames = Frames("out/set", ("ir_left", "depth_m"), rooms=train)  # doctest: +SKIP
        >>> loader = DataLoader(frames, 8, collate_fn=list)  # doctest: +SKIP
    """

    def __init__(
        self, path: Path | str, images: Sequence[str] = IMAGES[:4], *, rooms: Sequence[str] = ()
    ) -> None:
        """Read the index.

        Args:
            path: folder of a finished set.
            images: of `IMAGES`; those that a frame lacks are refused when it is asked for.
            rooms: whose frames there are; all where none is named. Split by rooms: scenes of one
                are no independent evidence.

        Raises:
            InputError: if the set has no index, an image or a room is unknown.
        """
        for name in images:
            one_of("image", name, IMAGES)
        self.path, self._images = Path(path), tuple(images)
        rows = index.read(self.path)
        known = {row["room"] for row in rows}
        for room in rooms:
            one_of("room", room, known)
        self._rows = [row for row in rows if not rooms or row["room"] in rooms]
        self._info = capture_info.read(self.path / capture_info.FILE)

    def __len__(self) -> int:
        """How many there are."""
        return len(self._rows)

    def __getitem__(self, number: int) -> Sample:
        """Read one.

        Raises:
            InputError: if a file is missing or damaged, or the frame has no such image.
        """
        row = self._rows[number]
        found: Sample = {name: row[name] for name in ("frame", "scene", "room", "sensor")}
        found["record"] = json.loads(_needed(self.path, row, "frame.json"))
        own = _file(self.path, row, capture_info.OWN)
        info = self._info if own is None else capture_info.from_table(tomllib.loads(own.decode()))
        for name in self._images:
            data = _needed(self.path, row, f"{_FILES.get(name, name)}.png")
            found[name] = torch.from_numpy(_decoded(name, data, row, info))
        return found

    @property
    def rooms(self) -> list[str]:
        """Rooms that there are, by name."""
        return sorted({row["room"] for row in self._rows})

    @property
    def rows(self) -> Sequence[Mapping[str, Any]]:
        """The index's rows of these frames."""
        return self._rows


class Stream(IterableDataset[Sample]):
    """The same in order, each archive read once; parted among ranks and a loader's workers.

    Every frame comes from one of them, in each epoch in another order of archives or views.
    """

    def __init__(self, frames: Frames, *, rank: int = 0, ranks: int = 1, seed: int = 0) -> None:
        """Of frames by number.

        Args:
            frames: what is streamed.
            rank: of this process among those that train together.
            ranks: how many these are.
            seed: of the order.

        Raises:
            InputError: if there is no such rank.
        """
        in_interval("ranks", ranks, 1, 10**6)
        in_interval("rank", rank, 0, ranks - 1)
        self._frames, self._rank, self._ranks = frames, rank, ranks
        self._seed, self._epoch = seed, 0

    def set_epoch(self, epoch: int) -> None:
        """Say which epoch comes, before its loader starts."""
        self._epoch = epoch

    def __iter__(self) -> Iterator[Sample]:
        """Give this worker's part."""
        worker = get_worker_info()
        part = self._rank if worker is None else self._rank * worker.num_workers + worker.id
        parts = self._ranks * (1 if worker is None else worker.num_workers)
        groups: dict[str, list[int]] = {}
        for number, row in enumerate(self._frames.rows):
            groups.setdefault(row["shard"] or str(row["view"]), []).append(number)
        names = sorted(groups)
        order = np.random.default_rng([self._seed, self._epoch]).permutation(len(names))
        for place in order[part::parts]:
            for number in groups[names[place]]:
                yield self._frames[number]


def _file(path: Path, row: Mapping[str, Any], name: str) -> bytes | None:
    """A file of a frame, or of its view; None where there is none."""
    view = row["name"].partition("/")[0]
    place = f"{view if name in shard.SHARED else row['name']}/{name}"
    if row["shard"]:
        return _archive(path / row["shard"]).get(place)
    file = path / place
    return file.read_bytes() if file.is_file() else None


@lru_cache(maxsize=2)
def _archive(path: Path) -> Mapping[str, bytes]:
    try:
        return shard.unpacked(path.read_bytes())
    except OSError as error:
        raise refuse("shard", "must be readable", path, f"{error.strerror}.") from error


def _needed(path: Path, row: Mapping[str, Any], name: str) -> bytes:
    data = _file(path, row, name)
    if data is None:
        advice = "Ask for what the set's plan keeps, or verify the set."
        raise refuse(f"frame {row['name']}", f"must have {name}", "none", advice)
    return data


def _decoded(
    name: str, data: bytes, row: Mapping[str, Any], info: CaptureInfo
) -> NDArray[np.float32] | NDArray[np.int32]:
    code = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if code is None:
        raise refuse(name, "must be a PNG file", row["name"], "Verify the set.")
    if name == "label":
        return code.astype(np.int32)
    if name in _FILES:
        return depth.from_code(code.astype(np.uint16), info.depth_unit_m)
    if name == "rgb":
        planes = np.ascontiguousarray(code[..., ::-1].transpose(2, 0, 1), np.float32)
        return planes / np.float32(255)
    return code.astype(np.float32)
