"""Verbs of depth completion (see `starling.sim.commands.verbs`)."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, arg

from starling.sim.console import shell
from starling.sim.console.flags import Common, Shared

PictureFlag = Annotated[
    Literal["ir_left", "ir_left_off", "rgb"],
    arg(name="image", help="Image to use with the depth; a colour image sets the view."),
]

LayoutFlag = Annotated[
    Literal["captures", "irs", "vkitti2", "nyuv2"],
    arg(help="Layout: a capture set, or a public data set (irs, vkitti2: folder; nyuv2: file)."),
]
FramesFlag = Annotated[
    int | None, arg(help="Number of frames, evenly spaced; all frames if not given.")
]


def complete(
    captures: Positional[str],
    *,
    out: Path,
    method: str = "wls",
    picture: PictureFlag = "ir_left",
    force: bool = False,
    common: Shared = Common(),
) -> None:
    """Fill the holes in the depth of captures.

    Classical methods: nearest, morphological, bilateral, wls, poisson. Learnt methods: small, whose
    weights come with the program; and, with a folder of weights, small, diffusion, marigold,
    marigold-dc, depth-anything.

    Example: starling complete captures/mine --method small --out out/complete

    Args:
        captures: capture set, or one scene in it.
        out: folder of the completed capture set, with sigma.png where the method estimates its
            error.
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
    layout: LayoutFlag = "captures",
    also: tuple[str, ...] = (),
    start: str = "",
    variant: Literal["rgbd", "rgbd-mask", "controlnet"] | None = None,
    at_once: int | None = None,
    picture: PictureFlag = "ir_left",
    holes: Literal["camera", "random"] = "camera",
    rooms: tuple[str, ...] | None = None,
    frames: FramesFlag = None,
    steps: int | None = None,
    seed: int = 0,
    force: bool = False,
    common: Shared = Common(),
) -> None:
    """Train depth completion: `starling train completion`. Interrupted training continues.

    Example: starling train completion out/rooms --out models/completion

    Args:
        captures: capture set with reference depth (truth.png) and the camera's own (depth.png).
            Data sets in other layouts have the depth of their depth camera or of our matcher.
        out: folder for weights, checkpoint and loss curve.
        also: additional data sets for training, LAYOUT=PLACE each.
        start: weights of Stable Diffusion 2 to fine-tune, a folder or an id on the Hugging Face
            hub. Without it, a compact network is trained from scratch.
        variant: conditioning of Stable Diffusion on image and depth: rgbd (concatenated latents),
            rgbd-mask (with a mask of holes) or controlnet; rgbd if not given.
        at_once: frames on the device at a time while Stable Diffusion trains; 4 if not given. A
            step always uses 32 frames.
        holes: the camera's own, or random ones as a control.
        rooms: rooms to train on; all if not given.
        steps: training steps.
        seed: seed of all random draws.
        force: delete earlier results of starling in the folder.
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
    layout: LayoutFlag = "captures",
    align: Literal["none", "sensor", "truth"] = "none",
    picture: PictureFlag = "ir_left",
    rooms: tuple[str, ...] | None = None,
    frames: FramesFlag = None,
    seed: int = 0,
    force: bool = False,
    common: Shared = Common(),
) -> None:
    """Compare completed depth with the truth: `starling evaluate completion`.

    Example: starling evaluate completion captures/d415-faro --methods nearest wls
    small=models/completion --out out/judged

    Args:
        captures: capture set with reference depth (truth.png) and the camera's own (depth.png).
            Data sets in other layouts have the depth of their depth camera or of our matcher.
        out: folder for figures and pictures.
        methods: NAME or NAME=WEIGHTS each (see `starling complete`).
        align: target of the alignment by scale and shift before evaluation, frame by frame. It is
            truth (usual for networks without unit), sensor (possible on a robot), or none.
        rooms: rooms to evaluate; all if not given.
        seed: seed of the bootstrap.
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
