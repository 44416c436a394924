"""Data sets of `starling generate` for torch, by index or as a stream split over workers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch.utils.data import Dataset, IterableDataset, get_worker_info

from starling.patterns.errors import instance, one_of, refuse, texts, whole_number
from starling.sim import files
from starling.sim.captures import frame_record, png
from starling.sim.captures import info as capture_info
from starling.sim.captures.info import CaptureInfo
from starling.sim.datasets import index, shard
from starling.sim.stereo import depth

Sample = dict[str, Any]

IMAGES = ("ir_left", "ir_right", "depth_m", "truth_m", "label", "rgb")
# Names of files that differ from the image's name.
_FILES = {"depth_m": "depth", "truth_m": "truth"}


class Frames(Dataset[Sample]):
    """Frames of a data set by index.

    A sample has the requested images as float32 tensors (h, w) (`rgb` (3, h, w), 0..1; depth [m],
    NaN = none; `label` int32), and `frame`, `scene`, `room`, `sensor`, `record`. The keys of
    `record` differ from frame to frame: a loader's `collate_fn` must omit or list it.

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
            images: names from `IMAGES`; a frame that lacks one is refused when it is read.
            rooms: rooms to include; all if empty. Split by rooms, because scenes of one room are
                not independent.

        Raises:
            InputError: if the set has no index, or an image or a room is unknown. Also if an
                argument has another type.
        """
        self._images = tuple(texts("images", images, "Give a list of names."))
        for name in self._images:
            one_of("image", name, IMAGES)
        included = texts("rooms", rooms, "Give a list of names.")
        self.path = Path(instance("path", path, (str, Path), "Give the set's folder."))
        rows = index.read(self.path)
        known = {row["room"] for row in rows}
        for room in included:
            one_of("room", room, known)
        self._rows = [row for row in rows if not included or row["room"] in included]
        self._info = capture_info.read(self.path / capture_info.FILE)

    def __len__(self) -> int:
        """Number of frames."""
        return len(self._rows)

    def __getitem__(self, number: int) -> Sample:
        """Read one frame.

        Raises:
            InputError: if a file is missing or damaged, or the frame lacks an image.
        """
        row = self._rows[number]
        sample: Sample = {name: row[name] for name in ("frame", "scene", "room", "sensor")}
        record = _needed(self.path, row, frame_record.FILE)
        sample["record"] = frame_record.parse(record, self.path / row["name"] / frame_record.FILE)
        own = _file(self.path, row, capture_info.OWN)
        info = self._info
        if own is not None:
            place = self.path / row["name"] / capture_info.OWN
            info = files.parse_toml(own, place, capture_info.from_table)
        for name in self._images:
            file = f"{_FILES.get(name, name)}.png"
            data = _needed(self.path, row, file)
            place = self.path / row["name"] / file
            sample[name] = torch.from_numpy(_decode(name, data, place, info))
        return sample

    @property
    def rooms(self) -> list[str]:
        """Names of the rooms, sorted."""
        return sorted({row["room"] for row in self._rows})

    @property
    def rows(self) -> Sequence[Mapping[str, Any]]:
        """Rows of the index of these frames."""
        return self._rows


class FrameStream(IterableDataset[Sample]):
    """Frames in a shuffled order, split over ranks and workers; each archive is read once.

    Each frame comes from exactly one worker. The seed fixes the order of archives or views; use
    another one in each epoch.
    """

    def __init__(self, frames: Frames, *, rank: int = 0, ranks: int = 1, seed: int = 0) -> None:
        """Create a stream of frames.

        Args:
            frames: the frames.
            rank: rank of this process in distributed training.
            ranks: number of ranks.
            seed: seed of the order.

        Raises:
            InputError: if the rank is out of range, or an argument has another type.
        """
        self._frames = instance("frames", frames, Frames, "Open them: Frames(PATH).")
        self._ranks = whole_number("ranks", ranks, 1, 10**6)
        self._rank = whole_number("rank", rank, 0, self._ranks - 1)
        self._seed = whole_number("seed", seed, 0, 2**63 - 1)

    def __iter__(self) -> Iterator[Sample]:
        """Iterate over this worker's frames."""
        worker = get_worker_info()
        part = self._rank if worker is None else self._rank * worker.num_workers + worker.id
        parts = self._ranks * (1 if worker is None else worker.num_workers)
        groups: dict[str, list[int]] = {}
        for number, row in enumerate(self._frames.rows):
            groups.setdefault(row["shard"] or str(row["view"]), []).append(number)
        names = sorted(groups)
        order = np.random.default_rng([self._seed, 0]).permutation(len(names))
        for name_in_set in order[part::parts]:
            for number in groups[names[name_in_set]]:
                yield self._frames[number]


def _file(path: Path, row: Mapping[str, Any], name: str) -> bytes | None:
    """Read a file of a frame, or of its view; None if there is none."""
    view = row["name"].partition("/")[0]
    name_in_set = f"{view if name in shard.SHARED else row['name']}/{name}"
    if row["shard"]:
        return _archive(path / row["shard"]).get(name_in_set)
    file = path / name_in_set
    return file.read_bytes() if file.is_file() else None


@lru_cache(maxsize=2)
def _archive(path: Path) -> Mapping[str, bytes]:
    return shard.unpack(files.read_bytes(path), str(path))


def _needed(path: Path, row: Mapping[str, Any], name: str) -> bytes:
    data = _file(path, row, name)
    if data is None:
        advice = "Request only images of the set's plan, or verify the set."
        raise refuse(f"frame {row['name']}", f"must have {name}", "none", advice)
    return data


def _decode(
    name: str, data: bytes, path: Path, info: CaptureInfo
) -> NDArray[np.float32] | NDArray[np.int32]:
    if name == "rgb":
        image = png.decode_colour(data, path, name)
        return np.ascontiguousarray(image.transpose(2, 0, 1), np.float32) / np.float32(255)
    code = png.decode(data, path, name, shape=info.shape)
    if name == "label":
        return code.astype(np.int32)
    if name not in _FILES:
        return code.astype(np.float32)
    if code.dtype != np.uint16:
        raise refuse(name, "must be a 16-bit PNG", f"{path}, 8-bit", "Verify the set.")
    return depth.from_code(code.astype(np.uint16), info.depth_unit_m)
