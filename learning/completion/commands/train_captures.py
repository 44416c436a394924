"""Implementation of `starling train completion`: trains on frames with ground truth."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from starling.learning.commands import work_folder
from starling.learning.completion.data.layouts import (
    INFRARED,
    LAYOUTS,
    Layout,
    ListedFrame,
    list_frames,
    read_frames,
    root,
    select_frames,
)
from starling.learning.completion.data.pairs import Picture
from starling.learning.completion.data.training_frame import Holes, none_has_depth, training_frame
from starling.learning.completion.diffusion import Variant
from starling.patterns.errors import naming, needs, refuse
from starling.sim import files
from starling.sim.console import progress
from starling.sim.console.output import RECORD, refuse_own_input
from starling.sim.sensor import structure

VERB = "train completion"
_MODULES = {
    "small": ("small.method", "learning"),
    "diffusion": ("diffusion.training", "completion"),
}


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
    train = partial(train_diffusion, **generator) if start else train_small
    _import_or_refuse(method)
    arguments = {"method": method, **generator, **data_arguments, "steps": steps, "seed": seed}
    with work_folder.opened(out, arguments, force=force):
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


def _import_or_refuse(method: str) -> None:
    """Import a method's packages, so that missing ones are refused before anything is written."""
    module, extra = _MODULES[method]
    try:
        import_module(f"starling.learning.completion.{module}")
    except ModuleNotFoundError as error:
        raise needs(method, str(error.name), extra) from error


def train_small(
    frames: Sequence[ListedFrame],
    holes: Holes,
    *,
    steps: int | None,
    folder: Path,
    seed: int,
    track: progress.Progress = progress.silent,
) -> dict[str, Any]:
    """Prepare all frames on disk, then train the compact network, or continue from the checkpoint.

    Args:
        frames: frames with ground truth.
        holes: see `training_frame`.
        steps: number of steps; None uses the default.
        folder: gets checkpoint, loss curve and weights.
        seed: seed of initial weights, crops and random holes.
        track: wraps long loops.

    Returns:
        `{"frames", "left_out", "hole_share"}`: number of frames trained on; number of frames
        without depth; mean share of pixels without depth.

    Raises:
        InputError: if a frame is invalid, or none has depth; see also `small.method.fit`.
    """
    from starling.learning.completion.small import method
    from starling.learning.completion.small.crops import FrameSample, SmallSettings
    from starling.learning.networks.stored import store

    shares: list[float] = []

    def prepared_samples() -> Iterator[FrameSample]:
        for number, pair in enumerate(read_frames(frames, track, "read")):
            prepared = training_frame(pair, holes, seed=seed, number=number)
            if prepared is not None:
                image, depth_m, truth_m = prepared.image, prepared.depth_m, prepared.truth()
                shares.append(float(np.isnan(depth_m).mean()))
                yield FrameSample(image=image, depth_m=depth_m, truth_m=truth_m)

    samples = store(prepared_samples(), folder)
    if not samples:
        raise none_has_depth(len(frames))
    settings = SmallSettings() if steps is None else SmallSettings(steps=steps)
    method.fit(samples, settings, folder=folder, seed=seed, track=track)
    return {
        "frames": len(samples),
        "left_out": len(frames) - len(samples),
        "hole_share": float(np.mean(shares)),
    }


def train_diffusion(
    frames: Sequence[ListedFrame],
    holes: Holes,
    *,
    start: str,
    variant: Variant,
    steps: int | None,
    at_once: int | None,
    folder: Path,
    seed: int,
    track: progress.Progress = progress.silent,
) -> dict[str, Any]:
    """Train an image generator on frames that are read when they are drawn.

    Continues from the folder's checkpoint, and writes the weights to `folder/weights`.

    Args:
        frames: frames with ground truth.
        holes: see `training_frame`.
        start: weights of an image generator, a folder or an id on the Hugging Face hub.
        variant: conditioning of the generator.
        steps: number of steps; None uses the default.
        at_once: frames on the device at a time; None uses the default.
        folder: gets checkpoint, loss curve and weights.
        seed: seed of all random draws, including random holes.
        track: wraps the loop over steps.

    Returns:
        `{"frames", "left_out", "hole_share"}`: number of frames; number of frames without depth
        among those drawn by this call; mean share of holes of the others.

    Raises:
        InputError: if a frame is invalid; see also `weights.load` and `training.train`.
    """
    from starling.learning.completion.diffusion import training, weights
    from starling.learning.completion.diffusion.data import ListedSamples

    options = {"steps": steps, "at_once": at_once}
    changes = {name: value for name, value in options.items() if value is not None}
    settings = dataclasses.replace(training.DiffusionSettings(), **changes)
    samples = ListedSamples(frames=frames, holes=holes, seed=seed)
    training.train(
        weights.load(start), variant, samples, settings, folder=folder, seed=seed, track=track
    )
    shares = [share for share in samples.shares.values() if share < 1]
    return {
        "frames": len(frames),
        "left_out": len(samples.shares) - len(shares),
        "hole_share": float(np.mean(shares)) if shares else None,
    }


@dataclass(frozen=True, kw_only=True, slots=True)
class TrainedOn:
    """Arguments of a training that name its scenes."""

    captures: str
    also: tuple[str, ...] = ()  # LAYOUT=PLACE of further sets.
    rooms: tuple[str, ...] | None = None  # None means all.


def training_rooms(specifier: str, captures: str, rooms: Sequence[str]) -> list[str]:
    """Return the rooms of a capture set that a method was trained on, according to its folder.

    Results in these rooms are too good.

    Args:
        specifier: the method, see `methods.create`.
        captures: the evaluated set.
        rooms: the evaluated rooms.

    Raises:
        InputError: if the record of the training is damaged.
    """
    weights = specifier.partition("=")[2]
    if not weights:
        return []
    folder = Path(weights)
    trained_on = _trained_on(folder) or _trained_on(folder.parent)  # The folder `weights`.
    if trained_on is None:
        return []
    also = [data_set.partition("=")[2] for data_set in trained_on.also]
    places = [Path(place).resolve() for place in (trained_on.captures, *also)]
    if Path(captures).resolve() not in places:
        return []
    return [room for room in rooms if trained_on.rooms is None or room in trained_on.rooms]


def _trained_on(folder: Path) -> TrainedOn | None:
    """Read the arguments of a finished training; None if the folder holds none."""
    path = folder / RECORD
    if not path.is_file():
        return None
    record = files.parse_json(files.read_bytes(path), path)
    if not isinstance(record, dict) or record.get("verb") != VERB:
        return None
    arguments = record.get("arguments")
    known = [field.name for field in dataclasses.fields(TrainedOn)]
    if isinstance(arguments, dict):
        arguments = {name: arguments[name] for name in known if arguments.get(name) is not None}
    with naming(path):
        return structure.from_table(TrainedOn, arguments, "arguments")  # type: ignore[arg-type]
