"""What remains of a gap once each scene may differ from its description."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from starling.diagnosis.which import scene_mixture, segment
from starling.diagnosis.which.candidates import Segment
from starling.diagnosis.which.scene_mixture import SceneMixture, remains_beyond_scenes
from starling.sim import effects
from tests.unit.diagnosis.made_gaps import (
    BASE,
    EFFECTS,
    FEATURES,
    ONES,
    SCENES,
    SIGNATURES,
    likelihood_of,
    noise,
    screening,
    signature,
)
from tests.unit.diagnosis.test_segment import Captured

SURFACE = signature("nir_reflectance", 20)
LIKELIHOOD = likelihood_of({}, 5)
MIXTURE = SceneMixture.from_signatures([SURFACE, *SIGNATURES], LIKELIHOOD)
CAMERA = EFFECTS["crosstalk"].change[-1] / LIKELIHOOD.deviation
AMOUNTS = np.linspace(-0.15, 0.15, SCENES)[:, None]
FROM_SCENES = AMOUNTS * SURFACE.change[-1] / LIKELIHOOD.deviation
assert np.abs(FROM_SCENES).max() < 10  # No deviation is clipped.


def test_each_scene_has_its_own_amount():
    rest = MIXTURE.remove(FROM_SCENES)
    assert np.abs(rest).max() < 0.05 * np.abs(FROM_SCENES).max()


def test_a_change_by_the_camera_stays():
    before = np.clip(CAMERA, -9, 9)
    assert MIXTURE.size(before) > 0.7 * float((before**2).mean())


def test_unknown_features_stay_unknown():
    gap = FROM_SCENES.copy()
    gap[2, 5] = np.nan
    rest = MIXTURE.remove(gap)
    assert np.flatnonzero(np.isnan(rest)).tolist() == [2 * FEATURES + 5]
    assert np.nanmax(np.abs(rest)) < 0.05 * np.nanmax(np.abs(FROM_SCENES))


def test_a_feature_beyond_the_largest_deviation_does_not_decide_the_amount():
    gap = FROM_SCENES.copy()
    place = int(np.abs(SURFACE.change[-1][0]).argmax())
    gap[0, place] = 1e4
    rest = np.delete(MIXTURE.remove(gap)[0], place)
    assert np.abs(rest).max() < np.abs(gap[0]).max() / 100


@pytest.mark.parametrize(
    ("name", "selected"),
    [
        *((name, True) for name in ("ambient", "texture", "ambient_occlusion", "subsurface")),
        *((name, True) for name in ("exposure", "spot_shape")),
        *((name, False) for name in ("lens_blur", "gain", "projector_power", "pitch")),
    ],
)
def test_scenes_differ_in_light_surfaces_exposure_and_spot(name: str, selected: bool):
    each = signature("veil", 3)
    candidate = dataclasses.replace(each.candidate, name=name, effect=effects.named(name))
    mixture = SceneMixture.from_signatures(
        [dataclasses.replace(each, candidate=candidate)], LIKELIHOOD
    )
    assert len(mixture.changes) == selected * len(each.values)


def test_without_effects_on_the_scene_nothing_is_removed():
    mixture = SceneMixture.from_signatures(SIGNATURES, LIKELIHOOD)
    np.testing.assert_array_equal(mixture.remove(CAMERA), CAMERA)


@pytest.mark.parametrize(("factor", "remains"), [(0.98, False), (1.02, True)])
def test_the_limit_grows_with_noise_and_the_initial_gap(factor: float, remains: bool):
    """Without effects on the scene, the size of the remainder is exact."""
    likelihood = likelihood_of({"crosstalk": 0.5}, 5)
    nothing = likelihood.no_change
    pairs = [
        (BASE.without(number), rows) for number, rows in enumerate(BASE.tables)
    ]  # Each seed against the others.
    seeds = [base.likelihood(rows, ONES).size(nothing) for base, rows in pairs]
    limit = (
        max(seeds)
        + scene_mixture.ALLOWANCE
        + scene_mixture.SHARE_OF_INITIAL * likelihood.size(nothing)
    )
    rest = np.full((SCENES, FEATURES), np.sqrt(factor * limit))
    assert remains_beyond_scenes(SIGNATURES, BASE, likelihood, rest) == remains


def diagnosed(other: float, kind: Segment = Segment.IMAGE, **options: Any) -> Any:
    """Diagnose crosstalk with a change that no effect makes."""
    unknown = other * np.random.default_rng(9).standard_normal(FEATURES)
    table: Any = Captured(EFFECTS["crosstalk"].change[-1] + unknown + noise(7), kind)
    estimates = options.pop("estimates", ())
    table.scene_models = tuple(
        SimpleNamespace(name=scene.name, room=scene.room, estimates=estimates)
        for scene in table.scene_models
    )
    for name, value in options.items():
        setattr(table, name, value)
    return segment.diagnose_segment(table, screening(*SIGNATURES, noise=0.3))


def test_an_unknown_effect_leaves_a_gap_beyond_the_scenes():
    known, unknown = diagnosed(0.0), diagnosed(0.15)
    assert "crosstalk" in known.settings and not known.beyond_scenes
    assert unknown.settings and unknown.beyond_scenes


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"estimates": (None,)}, False),
        ({"estimates": (None,), "compared": True}, True),
        ({"kind": Segment.WHOLE}, False),
    ],
    ids=["estimated", "compared", "end to end"],
)
def test_only_described_scenes_and_images_tell(options: dict[str, Any], expected: bool):
    assert diagnosed(0.15, **options).beyond_scenes == expected


def test_texture_shows_that_scenes_are_incomplete(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(segment, "_TEXTURE", "crosstalk")
    assert not diagnosed(0.15).beyond_scenes


def test_without_an_accepted_effect_nothing_is_rejected():
    table: Any = Captured(noise(7))
    assert not segment.diagnose_segment(table, screening(*SIGNATURES, noise=0.3)).beyond_scenes
