"""Haze: separation from ambient light, robustness against displaced dots."""

from __future__ import annotations

import numpy as np
import pytest

from starling.calibration.photometry import light_model, prediction
from starling.calibration.photometry.photometry_fit import PARAMETERS, fit_photometry
from starling.sim.render import direct
from starling.sim.render.mitsuba_scene import MitsubaScene
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
    observed,
    values_by_name,
)


def misfit(sensor: Sensor, *, on: bool = True) -> float:
    """Return the dots' misfit in the left image of a sensor, predicted with the true sensor."""
    layers = {SCENE.name: direct.layers(MitsubaScene(SCENE), TRUTH, subpixels=4)}
    captured = observed(sensor=sensor, off=True, layers=direct.layers(MitsubaScene(SCENE), sensor))
    images = light_model.images([captured], TRUTH, layers)
    (image,) = (image for image in images if image.side == "left" and image.on == on)
    values = light_model.start(TRUTH, {SCENE.name: AMBIENT_W_M2})
    column = light_model.columns(image, values, TRUTH, (), {})
    signal = image.level - np.float32(TRUTH.left.black_level_dn)
    factor = prediction.tile_factor(image, signal, column.model)
    weight = prediction.weight(image, column, factor)
    share = prediction.dots_misfit(image, signal, column, weight)
    reduced = prediction.weight(image, column, factor, misfit=share)
    assert (reduced <= weight).all()
    return share


@pytest.mark.slow
def test_displaced_dots_increase_the_misfit() -> None:
    """The misfit grows with the displacement, and is 0 with the projector off."""
    near, far = (
        edits.with_values(TRUTH, [("projector.shifted_dots_mrad", off)]) for off in (1.0, 2.0)
    )
    assert misfit(TRUTH) < 0.05
    assert 0.1 < misfit(near) < misfit(far) < 0.4
    assert misfit(far, on=False) == 0.0


@pytest.mark.parametrize("off", [False, True])
def test_fixed_haze_is_confounded_with_ambient_light(off: bool) -> None:
    """An image with the emitter off separates them."""
    free = [name for name in PARAMETERS if name != "projector.haze"]
    fit = fit_photometry([observed(off=off)], START, layers=fitted_layers(), free=free)
    text = " ".join(fit.solution.undetermined)
    assert (f"{AMBIENT} and projector.haze" in text) == (not off)


@pytest.mark.parametrize("off", [False, True])
@pytest.mark.parametrize("believed", [0.0, 0.3])
def test_haze_is_recovered(off: bool, believed: float) -> None:
    """A haze of 0.4 is recovered within 3 standard deviations for any initial haze.

    The standard deviation is below 0.05, or below 0.02 with an emitter-off image.
    """
    hazy = edits.with_values(TRUTH, [("projector.haze", 0.4)])
    layers = direct.layers(MitsubaScene(SCENE), hazy, subpixels=3)
    start = edits.with_values(START, [("projector.haze", believed)])
    fit = fit_photometry([observed(sensor=hazy, off=off, layers=layers)], start)
    haze, sd = values_by_name(fit)["projector.haze"], deviations(fit)["projector.haze"]
    assert haze == pytest.approx(0.4, abs=3 * sd)
    assert sd < (0.02 if off else 0.05)
    assert fit.solution.sensor.projector.haze == haze
    ratio = values_by_name(fit)[AMBIENT] / values_by_name(fit)["projector.power_w"]
    assert ratio == pytest.approx(AMBIENT_W_M2 / 0.22, rel=0.05)


def test_haze_of_one_is_not_fitted() -> None:
    start = edits.with_values(START, [("projector.haze", 1.0)])
    fit = fit_photometry([observed()], start)
    assert values_by_name(fit)["projector.haze"] == 1.0
    assert np.isinf(deviations(fit)["projector.haze"])
