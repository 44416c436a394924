"""Light between dots: told from ambient light, and dots that are a little off do not hide it."""

from __future__ import annotations

import numpy as np
import pytest

from starling.calibration.photometry import light_model, weights
from starling.calibration.photometry.photometry_fit import PARAMETERS, fit_photometry
from starling.sim.render import direct
from starling.sim.render.mitsuba_scene import Stage
from starling.sim.sensor import edits
from starling.sim.sensor.sensor import Sensor
from tests.unit.calibration.lit_table import (
    AMBIENT,
    AMBIENT_W_M2,
    SCENE,
    START,
    TRUTH,
    deviations,
    fitted_layers,
    found,
    observed,
)


def misfit(sensor: Sensor, *, on: bool = True) -> float:
    """Misfit of the left image's dots, captured by a sensor and predicted by the true one."""
    layers = {SCENE.name: direct.layers(Stage(SCENE), TRUTH, subpixels=4)}
    captured = observed(sensor=sensor, off=True, layers=direct.layers(Stage(SCENE), sensor))
    taken = light_model.images([captured], TRUTH, layers, {})
    (image,) = (one for one in taken if one.side == "left" and one.on == on)
    values = light_model.start(TRUTH, {SCENE.name: AMBIENT_W_M2})
    column = light_model.columns(image, values, TRUTH, (), {})
    signal = image.level - np.float32(TRUTH.left.black_level_dn)
    factor = weights.tile_factor(image, signal, column.model)
    weight = weights.weight(image, column, factor)
    share = weights.dots_misfit(image, signal, column, weight)
    less = weights.weight(image, column, factor, misfit=share)
    assert (less <= weight).all()
    return share


def test_dots_off_their_places_are_noticed() -> None:
    """The more, the farther they are off; not at all where the projector is."""
    near, far = (
        edits.with_values(TRUTH, [("projector.shifted_dots_mrad", off)]) for off in (1.0, 2.0)
    )
    assert misfit(TRUTH) < 0.05
    assert 0.1 < misfit(near) < misfit(far) < 0.4
    assert misfit(far, on=False) == 0.0


@pytest.mark.parametrize("off", [False, True])
def test_held_haze_is_one_with_ambient_light(off: bool) -> None:
    """Unless the emitter was off in another image."""
    free = [name for name in PARAMETERS if name != "projector.haze"]
    fit = fit_photometry([observed(off=off)], START, layers=fitted_layers(), free=free)
    text = " ".join(fit.solution.undetermined)
    assert (f"{AMBIENT} and projector.haze" in text) == (not off)


@pytest.mark.parametrize("off", [False, True])
@pytest.mark.parametrize("believed", [0.0, 0.3])
def test_light_between_dots_comes_back(off: bool, believed: float) -> None:
    """A haze of 0.4, by its change with distance or by an image without it: 3 standard deviations,
    which are below 0.05 and 0.02. What was believed does not count.
    """
    hazy = edits.with_values(TRUTH, [("projector.haze", 0.4)])
    layers = direct.layers(Stage(SCENE), hazy, subpixels=3)
    start = edits.with_values(START, [("projector.haze", believed)])
    fit = fit_photometry([observed(sensor=hazy, off=off, layers=layers)], start)
    haze, sd = found(fit)["projector.haze"], deviations(fit)["projector.haze"]
    assert haze == pytest.approx(0.4, abs=3 * sd)
    assert sd < (0.02 if off else 0.05)
    assert fit.solution.sensor.projector.haze == haze
    ratio = found(fit)[AMBIENT] / found(fit)["projector.power_w"]
    assert ratio == pytest.approx(AMBIENT_W_M2 / 0.22, rel=0.05)


def test_haze_stays_where_it_was_believed_to_be_all() -> None:
    start = edits.with_values(START, [("projector.haze", 1.0)])
    fit = fit_photometry([observed()], start)
    assert found(fit)["projector.haze"] == 1.0
    assert np.isinf(deviations(fit)["projector.haze"])
