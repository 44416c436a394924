"""The nominal camera of the validation, before any effect is applied."""

from __future__ import annotations

from starling.sim.effects import setting as setting
from starling.sim.scene.builtin import scenes
from starling.sim.sensor import presets
from starling.sim.sensor.edits import with_values
from starling.sim.sensor.sensor import Sensor

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


def camera(width: int, height: int) -> Sensor:
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
