"""Frames of data sets in any layout: captures, and public ones in their publishers'.

A frame is listed by the names of its files and read when it is asked for, so that a data set may be
larger than memory.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Literal

from starling.learning.completion.data.pairs import Pair, Picture, pair
from starling.learning.completion.data.readers.item import Source
from starling.learning.completion.data.readers.readings import reading
from starling.patterns.errors import in_interval, one_of, refuse
from starling.sim.captures import capture, info
from starling.sim.console import progress

Layout = Literal["captures", "irs", "vkitti2", "nyuv2"]
LAYOUTS: tuple[Layout, ...] = ("captures", "irs", "vkitti2", "nyuv2")
INFRARED: Picture = "ir_left"  # What goes with a capture's depth where nothing else is said.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Listed:
    """A frame that is not yet read."""

    name: str  # Unique in its data set.
    room: str  # Splits go by room.
    files: tuple[Path, ...]  # What it is learnt from.
    load: Callable[[], Pair]  # Raises InputError if a file is missing or damaged.


def listed(place: str, layout: str, picture: Picture = INFRARED) -> list[Listed]:
    """List the frames of a data set; no image is read.

    Args:
        place: capture set; folder of IRS or Virtual KITTI 2; file of NYUv2.
        layout: of `LAYOUTS`.
        picture: which image of a capture goes with its depth.

    Raises:
        InputError: if the layout is unknown, a picture is chosen where there is but one, or as
            `starling.sim.captures.capture.open_set` or the readers' `sources`.
    """
    one_of("layout", layout, LAYOUTS)
    if layout == "captures":
        return _captured(place, picture)
    if picture != INFRARED:
        advice = f"Leave --image out: {layout} has one image a frame."
        raise refuse("image", "must be chosen of captures alone", picture, advice)
    sources: list[Source] = import_module(
        f"starling.learning.completion.data.readers.{layout}"
    ).sources(Path(place))
    return [
        Listed(name=one.name, room=one.room, files=one.files, load=partial(reading, one))
        for one in sources
    ]


def root(place: str, layout: str) -> Path:
    """What a verb must not write into: of one scene of captures, the whole set.

    Raises:
        InputError: as `starling.sim.captures.capture.open_set`.
    """
    return capture.open_set(place).path if layout == "captures" else Path(place)


def chosen(
    frames: Sequence[Listed], rooms: Sequence[str] | None = None, most: int | None = None
) -> list[Listed]:
    """Take some frames.

    Args:
        frames: listed.
        rooms: theirs alone; None takes all.
        most: so many of what is left, evenly spread in order; None takes all.

    Raises:
        InputError: if a room is unknown, none is named, or fewer frames are there.
    """
    if rooms is not None and not rooms:
        raise refuse("rooms", "must be at least one", "none", "Name some, or leave --rooms out.")
    for room in rooms or ():
        one_of("room", room, {one.room for one in frames})
    left = [one for one in frames if rooms is None or one.room in rooms]
    if most is None:
        return left
    in_interval("frames", most, 1, len(left), f"There are {len(left)}.")
    return [left[number * len(left) // most] for number in range(most)]


def readings(frames: Sequence[Listed], track: progress.Progress, label: str) -> Iterator[Pair]:
    """Read frames one after the other.

    Args:
        frames: listed.
        track: wraps the loop over them.
        label: what is done with them.

    Raises:
        InputError: as their `load`.
    """
    for one in track(frames, label):
        yield one.load()


def _captured(place: str, picture: Picture) -> list[Listed]:
    found = []
    for scene in capture.open_set(place).scenes:
        # Steps of depth, and where the colour camera stands, are told there.
        about = [scene.path / info.OWN, scene.path.parent / info.FILE]
        told = [path for path in about if path.exists()]
        for number in scene.frames:
            folder = scene.path / str(number)
            images = (folder / f"{picture}.png", folder / "depth.png", scene.path / "truth.png")
            found.append(
                Listed(
                    name=f"{scene.name}/{number}",
                    room=scene.room,
                    files=(*images, *told),
                    load=partial(pair, scene, number, picture),
                )
            )
    return found
