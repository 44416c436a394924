"""Null distribution: standard deviations, gains by chance, and the noise size."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from starling.diagnosis.scenes.request import Request, Source, simulation
from starling.diagnosis.which import null
from starling.diagnosis.which.candidates import Segment
from starling.diagnosis.which.null import BaseSamples
from tests.unit.diagnosis.made_gaps import BASE, EFFECTS, FOLDS, ONES, SEEDS, SIGNATURES

ODD = 3  # A seed whose features look like an effect by chance.
VEIL = EFFECTS["veil"].change_at(1.0).change
LIKE_VEIL = dataclasses.replace(
    BASE, tables=BASE.tables + (np.arange(SEEDS) == ODD)[:, None, None] * VEIL
)


def test_the_deviation_is_that_of_a_capture_less_a_mean_or_less_another_capture():
    drawn = np.random.default_rng(0).standard_normal((8, 30, 200))
    samples = BaseSamples(drawn, np.zeros((30, 200)))
    assert samples.deviation.mean() == pytest.approx(np.sqrt(9 / 8), rel=0.01)
    pair = dataclasses.replace(samples, against=drawn[0])
    assert pair.deviation.mean() == pytest.approx(np.sqrt(2), rel=0.01)
    floor = dataclasses.replace(samples, floor=np.full((30, 200), 2.0))
    np.testing.assert_allclose(floor.deviation, np.hypot(samples.deviation, 2.0))


def test_the_null_gain_of_a_seed_is_that_of_the_best_effect():
    gains = null.null_gains(LIKE_VEIL, SIGNATURES, ONES, FOLDS)
    assert int(np.argmax(gains)) == ODD and gains[ODD] > 100
    assert np.delete(gains, ODD).max() < null.LEAST_GAIN
    assert null.gain_threshold(gains) == gains[ODD]
    rest = [signature for signature in SIGNATURES if signature.name != "veil"]
    assert null.null_gains(LIKE_VEIL, rest, ONES, FOLDS)[ODD] < 0.5 * gains[ODD]


def test_no_effect_gains_from_noise():
    gains = null.null_gains(BASE, SIGNATURES, ONES, FOLDS)
    assert gains.shape == (SEEDS,) and (gains < null.LEAST_GAIN).all()
    assert null.gain_threshold(gains) == null.LEAST_GAIN
    assert null.gain_threshold(np.array([50.0] * 20)) == 50
    assert null.gain_threshold(np.empty(0)) == null.LEAST_GAIN


def test_the_noise_size_is_that_of_the_worst_seed():
    assert null.noise_size(BASE, ONES) == pytest.approx(1.0, abs=0.4)
    assert null.noise_size(LIKE_VEIL, ONES) > 5
    assert null.noise_size(BaseSamples(BASE.tables[:1], BASE.floor), ONES) == 0


def test_model_error_includes_the_lens_spot_and_alternative_estimates():
    """A fifth of the spot's effect, and the whole change by another estimate; unknown is 0."""

    class Table:
        segment = Segment.IMAGE

        scene_models = (SimpleNamespace(estimates=("darker",)),)
        compared = False

        def request(self, settings: dict[str, float], **numbers: int) -> Request:
            return simulation(Source.INFRARED, settings, **numbers)

        def rows(self, request: Request) -> np.ndarray:
            darker = np.array([[0.0, 0.0, 0.3], [np.nan, 0.0, 0.0]])
            return darker if request.estimate else np.zeros((2, 3))

        def change(self, settings: dict[str, float]) -> np.ndarray:
            assert settings == {"lens_blur": 0.0}
            return np.array([[0.0, 1.0, np.nan], [0.0, -2.0, 0.0]])

    floor = null.simulate_base(Table(), seeds=2).floor  # type: ignore[arg-type]
    least = null.FLOOR
    np.testing.assert_allclose(
        floor,
        [[least, np.hypot(least, 0.2), np.hypot(least, 0.3)], [least, np.hypot(least, 0.4), least]],
    )
