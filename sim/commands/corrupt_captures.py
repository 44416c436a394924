"""`starling simulate` of depth images: what a depth camera would capture in their place."""

from __future__ import annotations

import time
import warnings
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors
from starling.sim.captures import capture, depth_file, png, writer
from starling.sim.commands.simulate_captures import facts, scene_figures, scene_seed
from starling.sim.console import names, progress
from starling.sim.console.output import OutputFolder, refuse_own_input
from starling.sim.corrupt import Corruptor
from starling.sim.effects import Value
from starling.sim.sensor import edits, intrinsics
from starling.sim.sensor.sensor import Sensor
from starling.sim.simulate import refuse_impossible


def corrupt_captures(
    path: Path,
    sensor: Sensor,
    out: Path,
    *,
    camera_matrix: tuple[float, float, float, float],
    unit: str = "",
    rgb: Path | None = None,
    own_camera: bool = False,
    frames: int = 1,
    seed: int = 0,
    effects: Mapping[str, Value] | None = None,
    empty: bool = False,
    force: bool = False,
    options: Mapping[str, Any] | None = None,
    track: progress.Progress = progress.silent,
) -> dict[str, Any]:
    """Corrupt depth images, and write them as one scene of a capture set.

    The images of a folder are the frames of a moving camera, so temporal filters go on from frame
    to frame. Then the scene has no `truth.png`; the layers in `frame.exr` hold the true depth.

    Args:
        path: a depth image, or a folder of them.
        sensor: camera to imitate.
        out: folder to create.
        camera_matrix: fx, fy, cx, cy of the depth images [px].
        unit: `m`, `mm` or step of the depth images [m]; by their type if empty.
        rgb: colour picture, or folder of as many, as a hint of the reflectance.
        own_camera: give the sensor the camera of the depth images.
        frames: frames of one depth image, each with independent noise.
        seed: seed of the noise.
        effects: strengths as for `starling.apply_effects`.
        empty: allow depth images without a surface in the sensor's view.
        force: replace an earlier set.
        options: further command-line options to record, as typed.
        track: wraps the loop over frames.

    Returns:
        `{"out", "files", "seconds", "scenes": {NAME: {"ndp_rate", "mean_dn", ...}}}`.

    Raises:
        InputError: if an image, the camera or the folder is invalid; no partial output remains.
    """
    started = time.perf_counter()
    frames = errors.whole_number("frames", frames, 1, 100_000, "Give a count inside.")
    seed = errors.whole_number("seed", seed, 0, 2**63 - 1, "Give a whole number from 0.")
    images = _images(path, frames)
    capture.refuse_not_utf8(path)
    pictures = _pictures(rgb, len(images))
    fx, fy, cx, cy = camera_matrix
    matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    if own_camera:
        height, width = depth_file.read(images[0], unit).shape
        sensor = edits.with_camera(sensor, matrix, (width, height))
    corruptor = Corruptor(sensor, matrix, effects=effects)
    refuse_impossible(corruptor.sensor, len(images))
    for source in (path, rgb):
        if source is not None:
            refuse_own_input(out, source)
    source = f"starling simulate {path}"
    info = writer.info_of(
        corruptor.sensor, source=source, licence="as the images'", notes="corrupted"
    )
    arguments = {"scene": str(path), "frames": frames, "seed": seed}
    with OutputFolder(out, force=force) as folder:
        figures = _write_scene(folder, images, pictures, corruptor, unit, seed, empty, track)
        writer.write_set(
            folder,
            info,
            corruptor.sensor,
            verb="simulate",
            arguments={**arguments, "effect": dict(effects or {}), **(options or {})},
            figures=figures,
        )
    return {
        "out": str(folder.path),
        "files": sum(each.is_file() for each in folder.path.rglob("*")),
        "seconds": round(time.perf_counter() - started, 3),
        "scenes": figures,
    }


def intrinsics_of(
    camera_matrix: tuple[float, float, float, float] | Path, path: Path, unit: str
) -> tuple[float, float, float, float]:
    """Return fx, fy, cx, cy of depth images; a file gives those of the images' size.

    Args:
        camera_matrix: the numbers [px], or a file of a device's calibration.
        path: a depth image, or a folder of them.
        unit: as for `corrupt_captures`.

    Raises:
        InputError: for no depth images, or a file without their size.
    """
    if not isinstance(camera_matrix, Path):
        return camera_matrix
    height, width = depth_file.read(_images(path, 1)[0], unit).shape
    camera = intrinsics.read(camera_matrix).camera(width, height)
    return camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px


def _images(path: Path, frames: int) -> list[Path]:
    """List the image of each frame."""
    images = depth_file.files(path)
    if not images:
        kinds = ", ".join(depth_file.SUFFIXES)
        other = depth_file.other_in(path)
        rule, got = f"must hold depth images ({kinds})", path if other is None else other
        raise errors.refuse("scene", rule, got, "Check the path.")
    if len(images) == 1:
        return images * frames
    if frames > 1:
        rule = "must be 1 for a folder of depth images"
        raise errors.refuse("frames", rule, frames, "Each image is a frame.")
    counts = Counter(each.stem for each in images)
    twice = [each.name for each in images if counts[each.stem] > 1]
    if twice:
        rule, advice = "must hold one image of each name", "Move the other ones."
        raise errors.refuse("scene", rule, f"{twice[0]} and {twice[1]} in {path}", advice)
    return images


def _pictures(rgb: Path | None, count: int) -> Sequence[Path | None]:
    """List the colour picture of each frame."""
    if rgb is None:
        return [None] * count
    if not rgb.is_dir():
        return [rgb] * count
    visible = (each for each in rgb.iterdir() if each.is_file() and each.name[0] != ".")
    pictures = sorted(visible, key=depth_file.order)
    if len(pictures) != count:
        rule = f"must hold {count} pictures, as many as depth images"
        raise errors.refuse("rgb", rule, f"{len(pictures)} in {rgb}", "Check the folder.")
    return pictures


def _scene_name(images: Sequence[Path]) -> str:
    still = len(set(images)) == 1
    return names.scene_folder(images[0].stem if still else images[0].absolute().parent.name)


def _write_scene(
    folder: OutputFolder,
    images: Sequence[Path],
    pictures: Sequence[Path | None],
    corruptor: Corruptor,
    unit: str,
    seed: int,
    empty: bool,
    track: progress.Progress,
) -> dict[str, Any]:
    still = len(set(images)) == 1
    name = _scene_name(images)
    unit_m, past = corruptor.sensor.post.depth_unit_m, None
    scene_number = scene_seed(seed, name)
    rates, levels, shot, shape, lit, source = [], [], None, None, None, None
    bare: list[str] = []  # Images without a surface in view.
    for number, image in enumerate(track(list(images), "simulate")):
        if lit is None or source != (image, pictures[number]):  # Equal frames share their light.
            source = (image, pictures[number])
            depth_m = depth_file.read(image, unit)
            hint = _hint(pictures[number], image, depth_m.shape)
            shape = shape or depth_m.shape
            if depth_m.shape != shape:
                rule = f"must be {shape}, as {images[0].name}"
                remedy = "A camera matrix belongs to one size."
                raise errors.refuse(str(image), rule, depth_m.shape, remedy)
            with errors.naming(image):
                lit = corruptor.light(depth_m, reflectance=hint, empty=True)
            if not lit.seen:
                bare.append(image.name)
            if not empty and bare and (still or len(bare) == len(images)):
                rule, advice = (
                    "must have a surface in view",
                    "Check camera-matrix, or give --empty.",
                )
                raise errors.refuse(str(image), rule, "none", advice)
        shot = lit.shoot(seed=scene_number, frame=number, past=past)
        past = shot.depth.history
        if number == 0:
            truth_m = shot.layers.truth.depth_m if still else None
            writer.write_scene(folder, name, room=name, truth_m=truth_m, depth_unit_m=unit_m)
        writer.write_frame(
            folder,
            name,
            number,
            depth=shot.depth,
            depth_unit_m=unit_m,
            infrared=(shot.ir_left, shot.ir_right),
            registered_m=shot.registered_m,
            layers=shot.layers,
            facts={
                **facts(shot, corruptor.sensor),
                "counts": "repeats" if still else "views",
                "seed": scene_number,
                "frame": number,
            },
        )
        rates.append(1 - shot.depth.valid.mean())
        levels.append(shot.ir_left.mean())
    if bare and not empty:
        warnings.warn(
            f"{len(bare)} of {len(images)} depth images have no surface in view, {bare[0]} first. "
            "Their frames have no depth.",
            stacklevel=3,
        )
    assert shot is not None  # `images` has at least one.
    return {name: scene_figures(rates, levels, shot)}


def _hint(picture: Path | None, image: Path, shape: tuple[int, ...]) -> NDArray[np.uint8] | None:
    """Read the picture of a depth image, which has its size (h, w)."""
    if picture is None:
        return None
    hint = png.read_picture(picture, "rgb", colour=True)
    if hint.shape[:2] != shape:
        rule = f"must be {shape}, as {image.name}"
        raise errors.refuse("rgb", rule, f"{picture} with {hint.shape[:2]}", "Resize it.")
    return hint
