"""Verbs of depth completion (see `starling.sim.commands.verbs`)."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, arg

from starling.sim.console import shell
from starling.sim.console.flags import Common, Shared

Seen = Annotated[
    Literal["ir_left", "ir_left_off", "rgb"],
    arg(name="image", help="Image that goes with the depth; a colour image's view is taken."),
]

Laid = Annotated[
    Literal["captures", "irs", "vkitti2", "nyuv2"],
    arg(
        help="What it is: a capture set, or a public data set (irs, vkitti2: folder; nyuv2: file)."
    ),
]
Some = Annotated[int | None, arg(help="So many of the frames, evenly spread; all if not given.")]


def complete(
    captures: Positional[str],
    *,
    out: Path,
    method: str = "wls",
    picture: Seen = "ir_left",
    force: bool = False,
    common: Shared = Common(),
) -> None:
    """Give captures depth where their camera has none.

    Methods that learn nothing: nearest, morphological, bilateral, wls, poisson. Learnt ones: small,
    whose weights come with the program, or with a folder of weights small, diffusion, marigold,
    marigold-dc, depth-anything.

    Example: starling complete captures/mine --method small --out out/complete

    Args:
        captures: capture set, or one scene in it.
        out: folder of the capture set that is written, with sigma.png where the method tells it.
        method: NAME, or NAME=WEIGHTS.
        force: replace a folder that starling wrote before.
    """
    from starling.learning.completion.commands.complete_captures import complete_captures
    from starling.sim.console import progress

    with progress.on_stderr() as track:
        result = complete_captures(captures, method, out, picture=picture, force=force, track=track)
    shell.say(result, json=common.json)


def train_completion(
    captures: Positional[str],
    *,
    out: Path,
    layout: Laid = "captures",
    also: tuple[str, ...] = (),
    start: str = "",
    variant: Literal["rgbd", "rgbd-mask", "controlnet"] | None = None,
    at_once: int | None = None,
    picture: Seen = "ir_left",
    holes: Literal["camera", "random"] = "camera",
    rooms: tuple[str, ...] | None = None,
    frames: Some = None,
    steps: int | None = None,
    seed: int = 0,
    force: bool = False,
    common: Shared = Common(),
) -> None:
    """Learn to complete depth, as `starling train completion`; goes on where it was cut short.

    Example: starling train completion out/rooms --out models/completion

    Args:
        captures: capture set with reference depth (truth.png) and the camera's own (depth.png); or
            a data set in another layout, where depth is the depth camera's, or our matcher's.
        out: folder for weights, checkpoint and loss curve.
        also: further data sets to learn from, LAYOUT=PLACE each.
        start: weights of Stable Diffusion 2, a folder or the id on a hub, which then learns to
            complete depth; without, a compact network learns from nothing.
        variant: how Stable Diffusion is told image and depth: side by side, with a mask of holes
            too, or by ControlNet; rgbd if not given.
        at_once: frames that the device holds at a time while Stable Diffusion learns; 4 if not
            given. A step takes 32 however few.
        holes: the camera's own; or random ones in their stead, to see what its own are worth.
        rooms: to learn from; all where none is named.
        steps: of the training.
        seed: fixes everything that is drawn.
        force: drop what starling left in the folder.
    """
    from starling.learning.completion.commands.train_captures import train_captures
    from starling.sim.console import progress

    with progress.on_stderr() as track:
        result = train_captures(
            captures,
            out,
            layout=layout,
            also=also,
            start=start,
            variant=variant,
            at_once=at_once,
            picture=picture,
            holes=holes,
            rooms=rooms,
            frames=frames,
            steps=steps,
            seed=seed,
            force=force,
            track=track,
        )
    shell.say(result, json=common.json)


def evaluate_completion(
    captures: Positional[str],
    *,
    out: Path,
    methods: tuple[str, ...],
    layout: Laid = "captures",
    align: Literal["none", "sensor", "truth"] = "none",
    picture: Seen = "ir_left",
    rooms: tuple[str, ...] | None = None,
    frames: Some = None,
    seed: int = 0,
    force: bool = False,
    common: Shared = Common(),
) -> None:
    """Judge completed depth by the truth, as `starling evaluate completion`.

    Example: starling evaluate completion captures/d415-faro --methods nearest wls
    small=models/completion --out out/judged

    Args:
        captures: capture set with reference depth (truth.png) and the camera's own (depth.png); or
            a data set in another layout, where depth is the depth camera's, or our matcher's.
        out: folder for figures and pictures.
        methods: NAME or NAME=WEIGHTS each (see `starling complete`).
        align: scale and shift of depth by least squares before it is judged, frame by frame: to
            the truth, as networks without a unit are commonly judged; to the camera's own depth,
            as a robot can; none.
        rooms: to judge; all where none is named.
        seed: of the intervals' draws.
        force: replace a folder that starling wrote before.
    """
    from starling.learning.completion.commands.judge_captures import judge_captures
    from starling.sim.console import progress

    with progress.on_stderr() as track:
        result = judge_captures(
            captures,
            methods,
            out,
            layout=layout,
            align=align,
            picture=picture,
            rooms=rooms,
            frames=frames,
            seed=seed,
            force=force,
            track=track,
        )
    shell.say(result, json=common.json)


VERBS = (complete, train_completion, evaluate_completion)
