"""A case's captures on disk: infrared pairs of every scene, and effects on depth matched since."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from starling.diagnosis.validation.camera import chain, depth_filters, dots, light, nominal
from starling.diagnosis.validation.camera.catalogue import Strengths
from starling.diagnosis.validation.camera.dots import Dots
from starling.diagnosis.validation.camera.draws import Draws
from starling.diagnosis.validation.camera.errors import refusal
from starling.diagnosis.validation.camera.light import Light
from starling.diagnosis.validation.camera.nominal import Nominal
from starling.diagnosis.validation.protocol import capture_files
from starling.diagnosis.validation.protocol.case import Case
from starling.sim.captures import capture

_OF_SET = ("capture.toml",)
_OF_SCENE = ("capture.toml", "truth.png", "room", "scene.toml")
_NEED_DOTS = ("dropped_dots", "shifted_dots")


def shoot(light_folder: Path, case: Case, out: Path, frames: int = 1) -> tuple[str, ...]:
    """Take infrared pairs of all scenes with one case's camera.

    Writes `out/SCENE/N/ir_left.png` and `ir_right.png` and copies what everybody may know of set
    and scene; nothing in `out` tells of the case.

    Args:
        light_folder: Holds nominal.json and scene folders with light.npz.
        case: The camera.
        out: New or empty folder.
        frames: Frames of each scene.

    Returns:
        Names of the scenes.

    Raises:
        WithheldError: if `out` holds something, there is no scene, frames is below 1, or a file or
            setting cannot be used.
    """
    if frames < 1:
        raise refusal("frames", "must be >= 1", frames, "Give how many of each scene.")
    if out.exists() and any(out.iterdir()):
        raise refusal("out", "must be empty", out, "Give a new folder.")
    camera = nominal.read(light_folder / nominal.FILE)
    strengths = Strengths(nominal=camera, values=case.settings)
    scenes = sorted(path.parent for path in light_folder.glob(f"*/{light.FILE}"))
    if not scenes:
        raise refusal(
            "light folder", f"must hold SCENE/{light.FILE}", light_folder, "Make the light first."
        )
    found = Dots(tangents=np.empty((0, 2)))
    if any(strengths.acting(name) for name in _NEED_DOTS):
        found = dots.gather(_lights(scenes, camera), camera.fx_px)
    capture_files.copy(light_folder, out, _OF_SET)
    for folder, seen in zip(scenes, _lights(scenes, camera), strict=True):
        capture_files.copy(folder, out / folder.name, _OF_SCENE)
        for frame in range(frames):
            draws = Draws(seed=case.seed, scene=folder.name, frame=frame)
            pair = chain.expose(seen, strengths, found, draws)
            capture_files.write(out / folder.name / str(frame) / "ir_left.png", pair.left)
            capture_files.write(out / folder.name / str(frame) / "ir_right.png", pair.right)
    return tuple(folder.name for folder in scenes)


def post(out: Path, case: Case, camera: Nominal) -> None:
    """Apply a case's effects on matched depth to every depth.png of a capture set, in place.

    Args:
        out: A capture set with `depth.png` in its frames, which another program has matched.
        case: The camera.
        camera: Its nominal settings: focal length times baseline turn depth into disparity.

    Raises:
        InputError: if the set is damaged.
    """
    strengths = Strengths(nominal=camera, values=case.settings)
    captures = capture.open_set(out)
    for scene in captures.scenes:
        for number in scene.frames:
            matched = scene.frame(number).depth_m
            if matched is None:
                continue
            before = matched.astype(np.float64)
            depth_m = depth_filters.process(before, strengths)
            if depth_m is not before:
                path = scene.path / str(number) / "depth.png"
                capture_files.write_depth(path, depth_m, captures.info.depth_unit_m)


def _lights(scenes: list[Path], camera: Nominal) -> Iterator[Light]:
    """Read one scene after the other, so that one at a time is held."""
    for folder in scenes:
        yield light.read(folder / light.FILE, camera.shape)
