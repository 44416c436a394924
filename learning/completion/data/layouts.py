"""Frames of data sets: captures, and public data sets in their publishers' layouts.

Frames are listed by file name and read on demand, so that a data set need not fit in memory.
"""

from __future__ import annotations

import os
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Literal

from starling.learning.completion.data.pairs import Pair, Picture, read_pair
from starling.learning.completion.data.readers.item import ItemSource
from starling.learning.completion.data.readers.readings import read_source
from starling.patterns.errors import InputError, in_interval, one_of, refuse
from starling.sim.captures import capture, info
from starling.sim.console import progress

Layout = Literal["captures", "irs", "vkitti2", "nyuv2"]
LAYOUTS: tuple[Layout, ...] = ("captures", "irs", "vkitti2", "nyuv2")
INFRARED: Picture = "ir_left"  # Default image of a capture.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class ListedFrame:
    """A frame that is not yet read."""

    name: str  # Unique in its data set.
    room: str  # Splits are by room.
    files: tuple[Path, ...]  # Files needed for training.
    load: Callable[[], Pair]  # Raises InputError if a file is missing or damaged.


def list_frames(place: str, layout: str, picture: Picture = INFRARED) -> list[ListedFrame]:
    """List the frames of a data set without reading an image.

    Args:
        place: capture set; folder of IRS or Virtual KITTI 2; file of NYUv2.
        layout: one of `LAYOUTS`.
        picture: image of a capture to use with its depth.

    Raises:
        InputError: if the layout is unknown, or a picture is chosen for a data set with only one;
            see also `starling.sim.captures.capture.open_set` and the readers' `sources`.
    """
    one_of("layout", layout, LAYOUTS)
    if layout == "captures":
        return _captured(place, picture)
    if picture != INFRARED:
        advice = f"Leave --image out: {layout} has one image a frame."
        raise refuse("image", "can be chosen for captures only", picture, advice)
    sources: list[ItemSource] = import_module(
        f"starling.learning.completion.data.readers.{layout}"
    ).sources(Path(place))
    return [
        ListedFrame(
            name=source.name,
            room=source.room,
            files=source.files,
            load=partial(read_source, source),
        )
        for source in sources
    ]


def root(place: str, layout: str) -> Path:
    """Return the path that must not contain outputs; for one scene of captures, the whole set.

    Raises:
        InputError: see `starling.sim.captures.capture.open_set`.
    """
    return capture.open_set(place).path if layout == "captures" else Path(place)


def select_frames(
    frames: Sequence[ListedFrame], rooms: Sequence[str] | None = None, most: int | None = None
) -> list[ListedFrame]:
    """Select frames.

    Args:
        frames: listed frames.
        rooms: rooms to select; None selects all.
        most: number of frames, evenly spaced in order; None selects all.

    Raises:
        InputError: if a room is unknown, no room is named, or there are fewer frames.
    """
    if rooms is not None and not rooms:
        raise refuse("rooms", "must be at least one", "none", "Name some, or leave --rooms out.")
    for room in rooms or ():
        one_of("room", room, {frame.room for frame in frames})
    selected = [frame for frame in frames if rooms is None or frame.room in rooms]
    if most is None:
        return selected
    in_interval("frames", most, 1, len(selected), f"There are {len(selected)}.")
    return [selected[number * len(selected) // most] for number in range(most)]


def read_frames(
    frames: Sequence[ListedFrame], track: progress.Progress, label: str
) -> Iterator[Pair]:
    """Read frames one after the other.

    Args:
        frames: listed frames.
        track: wraps the loop over frames.
        label: label of the progress bar.

    Raises:
        InputError: see their `load`.
    """
    for frame in track(frames, label):
        yield frame.load()


def _captured(place: str, picture: Picture) -> list[ListedFrame]:
    """List the frames of a capture set."""
    frames = []
    for scene in capture.open_set(place).scenes:
        # Depth unit and pose of the colour camera.
        info_paths = [scene.path / info.OWN, scene.path.parent / info.FILE]
        info_files = [path for path in info_paths if path.exists()]
        for number in scene.frames:
            folder = scene.path / str(number)
            images = (folder / f"{picture}.png", folder / "depth.png", scene.path / "truth.png")
            frames.append(
                ListedFrame(
                    name=f"{scene.name}/{number}",
                    room=scene.room,
                    files=(*images, *info_files),
                    load=partial(read_pair, scene, number, picture),
                )
            )
    return frames


# The end of a PNG file contains a checksum of all pixels.
_END_BYTES = 32


def fingerprint(frames: Sequence[ListedFrame]) -> str:
    """Hash the names of frames and, for each of their files, name, size and last 32 bytes.

    This detects any change of a PNG file, independent of its folder and time. For other files it
    detects changes of size and end only. It does not detect a changed image inside one file that
    holds all images, as in NYUv2.

    Raises:
        InputError: if a file is missing; this is better than an error during training.
    """
    value = 0
    for frame in frames:
        value = zlib.crc32(frame.name.encode(), value)
        for path in frame.files:
            value = zlib.crc32(_end(frame.name, path), value)
    return f"{len(frames)} {value:08x}"


def _end(frame: str, path: Path) -> bytes:
    """Return name, size and last bytes of a file."""
    try:
        with path.open("rb") as file:
            size = file.seek(0, os.SEEK_END)
            file.seek(max(0, size - _END_BYTES))
            return f"{path.name} {size} ".encode() + file.read()
    except OSError as error:
        raise _missing(frame, path) from error


def _missing(frame: str, path: Path) -> InputError:
    advice = "Leave it out, or copy it again."
    return refuse(f"frame {frame}", f"must have {path.name} for training", "none", advice)
