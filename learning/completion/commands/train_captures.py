"""The work of `starling train completion`: frames with truth in, weights out."""

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
    Listed,
    chosen,
    listed,
    root,
)
from starling.learning.completion.data.pairs import Picture
from starling.learning.completion.diffusion.variants import Variant
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
    """Train a network; what was cut short is gone on with when asked for again.

    Args:
        captures: capture set, or data set of another layout, with truth.
        out: folder for weights, checkpoint and loss curve.
        layout: as `layouts.listed` takes it.
        also: further data sets to learn from, LAYOUT=PLACE each.
        start: weights of an image generator, a folder or the id on a hub, that learns to complete
            depth; empty trains the compact network from nothing.
        variant: how the generator is told what is seen; see `diffusion.variants`; None: `rgbd`.
        at_once: frames that the device holds at a time while a generator learns; None leaves the
            settings' number.
        picture: the image that goes with a capture's depth.
        holes: the camera's own, or random ones in their stead, as a control.
        rooms: to learn from; None takes all.
        frames: to learn from, so many of theirs, evenly spread; None takes all.
        steps: None leaves the settings' number.
        seed: of first weights, crops, and random holes.
        force: drop what starling left in the folder.
        track: wraps loops that take long.

    Returns:
        `{"method", "frames", "left_out", "hole_share", "out", "seconds"}`, as `train_small` and
        `train_diffusion` say.

    Raises:
        InputError: whatever is wrong with the frames or the folder; a variant, or a number at once,
            of the compact network, which has neither.
    """
    begun = time.perf_counter()
    for name, value in (("variant", variant), ("at-once", at_once)):
        if value is not None and not start:
            advice = f"Give weights of Stable Diffusion 2 by --start, or leave --{name} out."
            raise refuse(name, "must come with --start", value, advice)
    learnt = chosen(_listed([(captures, layout), *map(_named, also)], out, picture), rooms, frames)
    asked = {
        "captures": captures,
        "layout": layout,
        "also": list(also),
        "picture": picture,
        "holes": holes,
        "rooms": rooms,
        "frames": frames,
    }
    seen = {"start": start, "variant": variant or "rgbd", "at_once": at_once} if start else {}
    method = "diffusion" if start else "small"
    arguments = {"method": method, **seen, **asked, "steps": steps, "seed": seed}
    train = partial(_train_diffusion(), **seen) if start else _train_small()
    work_folder.begin(out, arguments, force=force)
    found = train(learnt, holes, steps=steps, folder=out, seed=seed, track=track)
    figures = {"method": method, **found}
    work_folder.end(out, VERB, arguments, figures)
    return {**figures, "out": str(out), "seconds": round(time.perf_counter() - begun, 3)}


def _named(word: str) -> tuple[str, str]:
    """Place and layout of a further data set."""
    layout, _, place = word.partition("=")
    if not place:
        advice = f"LAYOUT is one of {', '.join(LAYOUTS)}."
        raise refuse("also", "must be LAYOUT=PLACE", word, advice)
    return place, layout


def _listed(sets: Sequence[tuple[str, str]], out: Path, picture: Picture) -> list[Listed]:
    """Frames of all data sets."""
    found: list[Listed] = []
    for place, layout in sets:
        # The picture is that of captures, if there are any; else it is refused.
        other = layout != "captures" and any(one == "captures" for _, one in sets)
        found += listed(place, layout, INFRARED if other else picture)
        refuse_own_input(out, root(place, layout))
    return found


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
