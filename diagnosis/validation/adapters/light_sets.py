"""Light for the validation: scenes as photo-electrons before any camera effect.

The second camera implementation reads only these files. It has its own lens, imager and matcher.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tyro.conf import Positional

from starling.diagnosis.scenes.strata import projector_tangents
from starling.diagnosis.validation.adapters import cameras
from starling.patterns.errors import refuse
from starling.sim import simulate
from starling.sim.captures import info, png, writer
from starling.sim.console import progress
from starling.sim.console.output import OutputFolder
from starling.sim.effects import setting
from starling.sim.imaging.imager import electrons_per_radiance
from starling.sim.render.layers import Layers
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.scene import sources
from starling.sim.scene.captured import known_geometry
from starling.sim.sensor.edits import with_values
from starling.sim.sensor.sensor import Sensor

LIGHT = "light.npz"
OTHER_M = 0.2  # Distance of another device's projector to the right [m].
_EVEN_PX = 64  # Size of the uniform pattern image [px].


def light_sets(
    out: Positional[Path],
    scenes: Positional[tuple[str, ...]],
    *,
    width: int = 640,
    height: int = 360,
) -> None:
    """Write builtin scenes as light, and their sensor.

    Args:
        out: folder to make.
        scenes: builtin scenes, such as clutter:7.
        width: image width [px].
        height: image height [px].
    """
    with progress.on_stderr() as track:
        write(out, scenes, cameras.builtin_camera(width, height), track=track)


def write(
    out: Path,
    names: Sequence[str],
    sensor: Sensor,
    *,
    track: progress.Progress = progress.silent,
) -> None:
    """Write builtin scenes as light, with the files of a capture set.

    Args:
        out: folder to make.
        names: builtin scenes, each once.
        sensor: nominal sensor; its geometry, projector and electron scale are used.
        track: wraps the loop over scenes.

    Raises:
        InputError: if a scene is unknown or named twice, or the folder cannot be written.
    """
    if len(set(names)) < len(names) or not names:
        count = f"{len(names)}, {len(set(names))} of them different"
        raise refuse("scenes", "must be at least one, each once", count, "Correct the list.")
    captured = writer.info_of(sensor, source="check", licence="Apache-2.0", notes="simulated")
    with OutputFolder(out, force=False) as folder, tempfile.TemporaryDirectory() as temporary:
        even = _even(sensor, Path(temporary))
        folder.write(info.FILE, info.dumps(captured).encode())
        loaded = {name: sources.load(name, sensor) for name in names}
        ambient = {
            (scene.ambient.irradiance_w_m2, scene.ambient.gradient) for scene in loaded.values()
        }
        if len(ambient) > 1:
            advice = "Write them to separate folders."
            raise refuse("scenes", "must share one ambient light", sorted(ambient), advice)
        level, gradient = ambient.pop()
        cameras.write(folder, sensor, {"ambient_w_m2": level, "ambient_gradient": gradient})
        for name, scene in track(list(loaded.items()), "light"):
            place = name.replace(":", "-")
            stage = MitsubaScene(scene)
            layers = simulate.render_layers(stage, sensor)
            evenly = simulate.render_layers(stage, even)
            other_sensor, other_scene = setting.apply(
                sensor, scene, {"second_projector": 1.0, "second_projector.x": OTHER_M}
            )
            second = simulate.render_layers(MitsubaScene(other_scene), other_sensor)
            up = scene.world_from_left[:3, :3].T @ np.array(scene.ambient.up)
            arrays = _arrays(sensor, layers, evenly, second) | {"left_up": up, "right_up": up}
            folder.write_by(f"{place}/{LIGHT}", partial(_save, arrays))
            writer.write_scene(
                folder,
                place,
                room=place,
                truth_m=layers.truth.depth_m,
                depth_unit_m=sensor.post.depth_unit_m,
                known=known_geometry.describe(name, scene.file_from_left, folder.path / place),
            )


def _save(arrays: dict[str, NDArray[Any]], path: Path) -> None:
    with path.open("wb") as file:  # `np.savez` would append `.npz` to a path without it.
        np.savez_compressed(file, allow_pickle=False, **arrays)


def _even(sensor: Sensor, folder: Path) -> Sensor:
    """Return the sensor with a projector of uniform light."""
    path = folder / "even.png"
    path.write_bytes(png.encode(np.full((_EVEN_PX, _EVEN_PX), 255, np.uint8)))
    return with_values(sensor, [("projector.pattern", str(path))])


def _arrays(
    sensor: Sensor, layers: Layers, evenly: Layers, second: Layers
) -> dict[str, NDArray[Any]]:
    wavelength, arrays = sensor.projector.wavelength_nm, {}
    for side, imager in (("left", sensor.left), ("right", sensor.right)):
        view, even, other_view = (getattr(rendered, side) for rendered in (layers, evenly, second))
        scale = electrons_per_radiance(imager, wavelength, imager.exposure_s)
        power = scale * sensor.projector.power_w
        tangents = projector_tangents(view.depth_m, sensor, right=side == "right")
        arrays |= {
            f"{side}_laser_e": view.projector_direct * np.float32(power),
            f"{side}_even_e": even.projector_direct * np.float32(power),
            f"{side}_ambient_e": view.ambient * np.float32(scale),
            f"{side}_other_e": other_view.other * np.float32(scale),
            f"{side}_depth_m": view.depth_m,
            f"{side}_body": view.body,
            f"{side}_px": tangents[..., 0],
            f"{side}_py": tangents[..., 1],
        }
    return arrays
