"""The fitted target level of auto exposure."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from starling.calibration.observation import Observation
from starling.calibration.photometry.photometry_fit import fit_exposure_level
from starling.sim.captures import writer
from starling.sim.sensor import presets
from starling.sim.sensor.edits import with_values

SENSOR = presets.load("d415")


def _seen(name: str, level_dn: float) -> Observation:
    info = writer.info_of(SENSOR, source="drawn", licence="Apache-2.0", notes="")
    image = np.full((8, 8), level_dn, np.float32)
    return Observation(name=name, room=name, info=info, left=image, right=image)


def test_the_target_is_the_mean_level() -> None:
    levels = (19.0, 22.0, 25.0)
    solution = fit_exposure_level([_seen(str(dn), dn) for dn in levels], SENSOR)
    assert solution is not None
    (estimate,) = solution.estimates
    assert estimate.value == pytest.approx(22 / 255)
    assert estimate.sd == pytest.approx(3 / np.sqrt(3) / 255)
    for imager in (solution.sensor.left, solution.sensor.right):
        assert imager.auto_exposure_level == estimate.value
    assert estimate.start == SENSOR.left.auto_exposure_level


@pytest.mark.parametrize(("row", "wanted_dn"), [(3, 50.0), (0, 10.0)])
def test_a_level_is_the_mean_of_all_metered_pixels(row: int, wanted_dn: float) -> None:
    """The mean includes bright dots, and excludes the border that the sensor does not meter."""
    dotted = _seen("dots", 10.0)
    assert dotted.left is not None and SENSOR.left.auto_exposure_roi == 0.8
    dotted.left[row] = 250.0
    solution = fit_exposure_level([dotted, replace(dotted, name="again")], SENSOR)
    assert solution is not None and solution.estimates[0].value == pytest.approx(wanted_dn / 255)


def test_one_scene_or_a_fixed_exposure_gives_no_level() -> None:
    seen = [_seen("a", 20.0), _seen("b", 21.0)]
    assert fit_exposure_level(seen[:1], SENSOR) is None
    blind = replace(seen[1], left=None, right=None)
    assert fit_exposure_level([seen[0], blind], SENSOR) is None
    fixed = with_values(SENSOR, [("imager.auto_exposure_level", 0.0)])
    assert fit_exposure_level(seen, fixed) is None
