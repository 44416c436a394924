"""Implementation of `starling train completion`: trains on frames with ground truth."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from starling.learning.commands import work_folder
from starling.learning.completion.data.layouts import (
    INFRARED,
    LAYOUTS,
    Layout,
    ListedFrame,
    list_frames,
    root,
    select_frames,
)
from starling.learning.completion.data.pairs import Picture
from starling.learning.completion.diffusion import Variant
from starling.learning.completion.evaluation.training_rooms import VERB
from starling.patterns.errors import needs, refuse
from starling.sim.console import progress
from starling.sim.console.output import refuse_own_input

if TYPE_CHECKING:
    from starling.learning.completion.data.training_frame import Holes


def train_captures(
    captures: str,
    out: Path,
    *,
    layout: Layout = "captures",
    also: Sequence[str] = (),
    start: str = "",
    variant: Variant | None = None,
    at_once: int | None = None,
    picture: Picture = INFRARED,
    holes: Holes = "camera",
    rooms: Sequence[str] | None = None,
    frames: int | None = None,
    steps: int | None = None,
    seed: int = 0,
    force: bool = False,
    track: progress.Progress = progress.silent,
) -> dict[str, Any]:
    """Train a network. Interrupted training continues when the same call is repeated.

    Args:
        captures: capture set, or data set of another layout, with ground truth.
        out: folder for weights, checkpoint and loss curve.
        layout: see `layouts.list_frames`.
        also: additional data sets, LAYOUT=PLACE each.
        start: weights of an image generator to fine-tune, a folder or an id on the Hugging Face
            hub; empty trains the compact network from scratch.
        variant: conditioning of the generator, see `diffusion.VARIANTS`; None: `rgbd`.
        at_once: frames on the device at a time while a generator trains; None uses the default.
        picture: image to use with a capture's depth.
        holes: the camera's own, or random ones as a control.
        rooms: rooms to train on; None uses all.
        frames: number of their frames to train on, evenly spaced; None uses all.
        steps: number of steps; None uses the default.
        seed: seed of initial weights, crops, and random holes.
        force: delete earlier results in the folder.
        track: wraps long loops.

    Returns:
        `{"method", "frames", "left_out", "hole_share", "out", "seconds"}`, see `train_small` and
        `train_diffusion`.

    Raises:
        InputError: if the frames or the folder are invalid, or a variant or `at_once` is given for
            the compact network.
    """
    start_time = time.perf_counter()
    for name, value in (("variant", variant), ("at-once", at_once)):
        if value is not None and not start:
            advice = f"Give weights of Stable Diffusion 2 by --start, or leave --{name} out."
            raise refuse(name, "must come with --start", value, advice)
    chosen = select_frames(
        _list_all([(captures, layout), *map(_split, also)], out, picture), rooms, frames
    )
    data_arguments = {
        "captures": captures,
        "layout": layout,
        "also": list(also),
        "picture": picture,
        "holes": holes,
        "rooms": rooms,
        "frames": frames,
    }
    generator = {"start": start, "variant": variant or "rgbd", "at_once": at_once} if start else {}
    method = "diffusion" if start else "small"
    arguments = {"method": method, **generator, **data_arguments, "steps": steps, "seed": seed}
    train = partial(_train_diffusion(), **generator) if start else _train_small()
    work_folder.begin(out, arguments, force=force)
    result = train(chosen, holes, steps=steps, folder=out, seed=seed, track=track)
    figures = {"method": method, **result}
    work_folder.end(out, VERB, arguments, figures)
    return {**figures, "out": str(out), "seconds": round(time.perf_counter() - start_time, 3)}


def _split(word: str) -> tuple[str, str]:
    """Split LAYOUT=PLACE into place and layout."""
    layout, _, place = word.partition("=")
    if not place:
        advice = f"LAYOUT is one of {', '.join(LAYOUTS)}."
        raise refuse("also", "must be LAYOUT=PLACE", word, advice)
    return place, layout


def _list_all(sets: Sequence[tuple[str, str]], out: Path, picture: Picture) -> list[ListedFrame]:
    """List the frames of all data sets."""
    frames: list[ListedFrame] = []
    for place, layout in sets:
        # The picture applies to captures. It is refused if there are none.
        ignored = layout != "captures" and any(kind == "captures" for _, kind in sets)
        frames += list_frames(place, layout, INFRARED if ignored else picture)
        refuse_own_input(out, root(place, layout))
    return frames


def _train_small() -> Callable[..., dict[str, Any]]:
    try:
        from starling.learning.completion.commands.train_small import train_small
    except ModuleNotFoundError as error:
        raise needs("small", str(error.name), "learning") from error
    return train_small


def _train_diffusion() -> Callable[..., dict[str, Any]]:
    try:
        from starling.learning.completion.commands.train_diffusion import train_diffusion
    except ModuleNotFoundError as error:
        raise needs("diffusion", str(error.name), "completion") from error
    return train_diffusion
