"""Captures of a case on disk: infrared pairs of all scenes, and effects on matched depth."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from starling.diagnosis.validation.camera import (
    chain,
    depth_filters,
    imperfections,
    light,
    nominal,
    projector,
)
from starling.diagnosis.validation.camera.catalogue import Strengths
from starling.diagnosis.validation.camera.draws import Draws
from starling.diagnosis.validation.camera.errors import refusal
from starling.diagnosis.validation.camera.light import SceneLight
from starling.diagnosis.validation.camera.nominal import Nominal
from starling.diagnosis.validation.protocol import files
from starling.diagnosis.validation.protocol.case import Case
from starling.sim.captures import capture

_SET_FILES = ("capture.toml",)
_SCENE_FILES = ("capture.toml", "truth.png", "room", "scene.toml")
_NEED_DOTS = ("dropped_dots", "shifted_dots")


def shoot(light_folder: Path, case: Case, out: Path, frames: int = 1) -> tuple[str, ...]:
    """Capture infrared pairs of all scenes with the camera of a case.

    Writes `out/SCENE/N/ir_left.png` and `ir_right.png`, and copies the public files of set and
    scenes. The files in `out` do not reveal the effects of the case.

    Args:
        light_folder: Folder of nominal.json and of scene folders with light.npz.
        case: The camera with its effects.
        out: New or empty folder.
        frames: Frames per scene.

    Returns:
        Names of the scenes.

    Raises:
        WithheldError: if `out` is not empty, there is no scene, or a file or setting is invalid.
    """
    if out.exists() and any(out.iterdir()):
        raise refusal("out", "must be empty", out, "Give a new folder.")
    departures = case.imperfections
    camera = imperfections.with_spot(nominal.read(light_folder / nominal.FILE), departures)
    strengths = Strengths(nominal=camera, values=case.settings)
    scenes = sorted(path.parent for path in light_folder.glob(f"*/{light.FILE}"))
    if not scenes:
        raise refusal(
            "light folder", f"must hold SCENE/{light.FILE}", light_folder, "Make the light first."
        )
    dots = np.empty((0, 2))
    if any(strengths.is_active(name) for name in _NEED_DOTS):
        dots = projector.gather(_lights(scenes, camera), camera.fx_px)
    factors = imperfections.exposure_factors([each.name for each in scenes], departures, case.seed)
    files.copy(light_folder, out, _SET_FILES)
    for folder, scene_light in zip(scenes, _lights(scenes, camera), strict=True):
        files.copy(folder, out / folder.name, _SCENE_FILES)
        of_scene = Draws(seed=case.seed, scene=folder.name)
        lit = imperfections.on_surfaces(scene_light, camera, departures, of_scene)
        exposed = imperfections.exposed(strengths, factors[folder.name])
        for frame in range(frames):
            draws = Draws(seed=case.seed, scene=folder.name, frame=frame)
            pair = chain.expose(lit, exposed, dots, draws)
            files.write_image(out / folder.name / str(frame) / "ir_left.png", pair.left)
            files.write_image(out / folder.name / str(frame) / "ir_right.png", pair.right)
    return tuple(folder.name for folder in scenes)


def postprocess(out: Path, case: Case, camera: Nominal) -> None:
    """Apply the depth effects of a case to every depth.png of a capture set, in place.

    Args:
        out: Capture set with matched depth, `depth.png`, in its frames.
        case: The camera with its effects.
        camera: Nominal camera. Focal length times baseline converts depth to disparity.

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
                files.write_depth(path, depth_m, captures.info.depth_unit_m)


def _lights(scenes: list[Path], camera: Nominal) -> Iterator[SceneLight]:
    """Read the scenes one at a time to limit memory."""
    for folder in scenes:
        yield light.read(folder / light.FILE, camera.shape)
