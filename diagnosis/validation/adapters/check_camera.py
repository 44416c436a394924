"""The camera of the check on withheld effects: what is believed before anything is done to it."""

from __future__ import annotations

from starling.sim.effects import setting as setting
from starling.sim.scene.builtin import scenes
from starling.sim.sensor import presets
from starling.sim.sensor.edits import with_values
from starling.sim.sensor.sensor import Sensor

_FOCAL = 424.0 / 848.0  # Of a D435 over its width; the principal point is the middle.
_HAS = (
    # What the matcher filters by itself nobody could withhold.
    ("matcher.refinement.median_px", 0),
    ("matcher.refinement.smooth_px", 0),
    ("matcher.checks.jump_px", 1024.0),
    ("matcher.checks.speckle_count", 0),
    # Without these nothing could be told from no noise and a perfect lens.
    ("imager.lens.blur_px", 0.6),
    ("imager.shot_noise", 1.0),
    ("imager.read_noise_e", 5.0),
    ("imager.black_level_dn", 4.0),
    ("imager.bit_depth", 8),
    ("projector.power_w", 0.15),
)


def camera(width: int, height: int) -> Sensor:
    """A D435 with all effects at their neutral but for noise, a lens's spot and the matcher's cost.

    Args:
        width: of the images [px].
        height: likewise.

    Raises:
        InputError: for a size that no sensor has.
    """
    ideal, _ = setting.ideal(presets.load("d435"), scenes.clutter(0))
    focal = _FOCAL * width
    size = (("width", width), ("height", height), ("fx_px", focal), ("fy_px", focal))
    middle = (("cx_px", (width - 1) / 2), ("cy_px", (height - 1) / 2))
    return with_values(ideal, [*size, *middle, *_HAS])
