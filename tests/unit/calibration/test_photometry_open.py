"""Sentences on unidentifiable photometric parameters."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from starling.calibration.photometry import light_model, photometry_open
from starling.calibration.photometry.light_model import FALLOFF, HAZE, LEFT_BLACK, POWER, VIGNETTING
from starling.calibration.solution import Estimate

AMBIENT = light_model.ambient("hall")


def image(*, on: bool = True, scene: str = "hall", lowest_dn: float = 5.0) -> Any:
    return SimpleNamespace(on=on, scene=scene, side="left", lowest_dn=lowest_dn)


def estimate(name: str, value: float, sd: float) -> Estimate:
    return Estimate(name=name, value=value, sd=sd, unit="", start=value)


def open_text(
    estimates: Sequence[Estimate],
    images: Sequence[Any] = (image(),),
    correlation: float = 0.0,
) -> str:
    deviation = np.array([item.sd for item in estimates])
    covariance = np.diag(deviation**2)
    if correlation:
        covariance[0, 1] = covariance[1, 0] = correlation * deviation[0] * deviation[1]
    texts = photometry_open.sentences(
        estimates,
        covariance,
        images=images,
        power_w=0.2,
        means=False,
    )
    return "\n".join(texts)


def test_emitter_off_images_are_a_remedy_for_dots() -> None:
    held = [estimate(POWER, 0.2, np.inf), estimate(HAZE, 0.1, 0.01)]
    dots = "Captures with the emitter off make the ratio independent of the dots' shape"
    lit, both = (open_text(held, images) for images in ([image()], [image(), image(on=False)]))
    assert dots in lit and dots not in both
    assert f"{POWER} = 0.2 W was kept" in lit and f"{POWER} = 0.2 W was kept" in both


@pytest.mark.parametrize(
    ("value", "sd", "named"), [(6.4, 0.3, False), (7.0, 0.3, True), (7.0, 0.6, False)]
)
def test_a_black_level_above_the_darkest_pixels_is_reported(
    value: float, sd: float, named: bool
) -> None:
    """The excess over the darkest image of that side is above 1 DN and two deviations."""
    images = [image(lowest_dn=9.0), image(lowest_dn=5.0)]
    text = open_text([estimate(LEFT_BLACK, value, sd)], images)
    assert (f"{LEFT_BLACK} = {value:.3g} DN exceeds the darkest pixels' 5 DN" in text) == named


@pytest.mark.parametrize(("correlation", "named"), [(0.99, True), (-0.99, True), (-0.9, False)])
def test_confounded_pairs_are_reported(correlation: float, named: bool) -> None:
    both = [estimate(FALLOFF, 1.0, 0.1), estimate(AMBIENT, 1.0, 0.2)]
    text = open_text(both, correlation=correlation)
    assert (f"{FALLOFF} and {AMBIENT} cannot be separated" in text) == named


def test_a_deviation_above_the_range_is_reported() -> None:
    """A uniform distribution from 0 to 20 has a deviation of 20 / sqrt(12) = 5.8."""
    assert f"{FALLOFF} is not determined: its standard deviation of 6 exceeds" in open_text(
        [estimate(FALLOFF, 3.0, 6.0)]
    )
    assert "is not determined" not in open_text([estimate(FALLOFF, 3.0, 5.5)])
    assert "is not determined" in open_text([estimate(HAZE, 0.3, 0.3)])
    assert "is not determined" not in open_text([estimate(VIGNETTING, 3.0, 0.3)])
