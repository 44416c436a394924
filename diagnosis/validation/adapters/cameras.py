"""The nominal camera of the validation, before any effect is applied."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from tyro.conf import Positional

from starling.sim import effects
from starling.sim.captures import capture
from starling.sim.console.output import OutputFolder
from starling.sim.effects import setting
from starling.sim.scene.builtin import scenes
from starling.sim.sensor import presets, resolve
from starling.sim.sensor.edits import with_values
from starling.sim.sensor.sensor import Sensor

NOMINAL, SENSOR = "nominal.json", "sensor.toml"
_FOCAL = 424.0 / 848.0  # Focal length of a D435 over its image width.
_HAS = (
    # Filters inside the matcher are off, because an effect could not be withheld from them.
    ("matcher.refinement.median_px", 0),
    ("matcher.refinement.smooth_px", 0),
    ("matcher.checks.jump_px", 1024.0),
    ("matcher.checks.speckle_count", 0),
    # Noise and lens blur are on: departures from a perfect camera would be trivial to detect.
    ("imager.lens.blur_px", 0.6),
    ("imager.shot_noise", 1.0),
    ("imager.read_noise_e", 5.0),
    ("imager.black_level_dn", 4.0),
    ("imager.bit_depth", 8),
    ("projector.power_w", 0.15),
)


def builtin_camera(width: int, height: int) -> Sensor:
    """Return a D435 with all effects neutral except noise, lens blur and matching cost.

    Args:
        width: image width [px].
        height: image height [px].

    Raises:
        InputError: if the size is not allowed for a sensor.
    """
    ideal, _ = setting.ideal(presets.load("d435"), scenes.clutter(0))
    focal = _FOCAL * width
    size = (("width", width), ("height", height), ("fx_px", focal), ("fy_px", focal))
    middle = (("cx_px", (width - 1) / 2), ("cy_px", (height - 1) / 2))
    return with_values(ideal, [*size, *middle, *_HAS])


def captured_camera(out: Positional[Path], *, captures: str, sensor: str, mode: str = "") -> None:
    """Write the camera of a capture set: its sensor file and nominal values.

    Writes OUT/sensor.toml with the captures' geometry, and OUT/nominal.json. The latter also lists
    the effects that the camera already has.

    Args:
        out: folder to make.
        captures: capture set whose geometry is used.
        sensor: preset or sensor file of their camera.
        mode: mode of their camera; empty is the sensor's own.
    """
    path = capture.open_set(captures).path
    camera = resolve.load(sensor, mode=mode, captures=str(path))
    with OutputFolder(out) as folder:
        # The ambient light of real rooms is unknown. It is zero, because no effect changes it.
        ambient = {"ambient_w_m2": 0.0, "ambient_gradient": 0.0}
        write(folder, camera, {**ambient, "has": existing_effects(camera)})


def write(folder: OutputFolder, sensor: Sensor, values: dict[str, Any]) -> None:
    """Write the camera description that both sides of the validation read.

    Args:
        folder: folder of `nominal.json` and `sensor.toml`.
        sensor: sensor with the captures' geometry.
        values: further values of `nominal.json`, such as the ambient light.
    """
    folder.write(NOMINAL, json.dumps({**nominal(sensor), **values}, indent=1).encode())
    folder.write(SENSOR, presets.dumps(sensor).encode())


def existing_effects(sensor: Sensor) -> list[str]:
    """List effects of the sensor that are not neutral."""
    scene = scenes.clutter(0)  # Any scene: effects of the sensor do not depend on it.
    first = {row.name: row.parameters[0] for row in effects.table()}
    return sorted(
        name
        for name, parameter in first.items()
        if parameter.neutral is not None
        and setting.value(parameter, sensor, scene) not in (None, parameter.neutral)
    )


def nominal(sensor: Sensor) -> dict[str, Any]:
    """Return the camera values that the second implementation reads."""
    imager = sensor.left
    return {
        "width": sensor.width,
        "height": sensor.height,
        "fx_px": sensor.fx_px,
        "fy_px": sensor.fy_px,
        "cx_px": sensor.cx_px,
        "cy_px": sensor.cy_px,
        "baseline_m": sensor.baseline_m,
        "exposure_s": imager.exposure_s,
        "gain": imager.gain,
        "power_w": sensor.projector.power_w,
        "full_well_e": imager.full_well_e,
        "bit_depth": imager.bit_depth,
        "dn_per_e": imager.dn_per_electron / imager.gain,
        "black_level_dn": imager.black_level_dn,
        "depth_unit_m": sensor.post.depth_unit_m,
        "read_noise_e": imager.read_noise_e,
        "shot_noise": imager.shot_noise,
        "lens_blur_px": imager.lens.blur_px,
        "smoothing_px": imager.smoothing_px,
        "speckle_contrast": sensor.projector.speckle_contrast,
        "pattern_px": imager.pattern_px,
        "lens_focus_m": imager.lens.focus_m,
        "projector_focus_m": sensor.projector.focus_m,
        "projector_x_m": sensor.projector.position_m[0],
        "quantum_efficiency": imager.quantum_efficiency,
        "pixel_pitch_m": imager.pixel_pitch_m,
        "f_number": imager.lens.f_number,
        "wavelength_nm": sensor.projector.wavelength_nm,
    }
