"""Imperfections of a base: each acts on what it names, and none acts at zero."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from starling.diagnosis.validation.camera import imperfections, optics, psf, sky
from starling.diagnosis.validation.camera.catalogue import Strengths
from starling.diagnosis.validation.camera.draws import Draws
from starling.diagnosis.validation.camera.errors import WithheldError
from starling.diagnosis.validation.camera.imperfections import IMPERFECTIONS, SPOTS
from starling.diagnosis.validation.camera.light import LightView, SceneLight
from starling.diagnosis.validation.camera.nominal import Nominal
from starling.diagnosis.validation.protocol.case import Case
from starling.diagnosis.validation.protocol.shoot import shoot
from starling.sim import effects
from tests.unit.diagnosis.validation.conftest import BOX_M

OF_SCENE = Draws(seed=5, scene="a")
LIGHTS = ("laser_e", "even_e", "ambient_e", "other_e")
IN_IMAGES = sorted(IMPERFECTIONS.keys() - {imperfections.OTHER_MATCHER})


def _images(light_set: Path, out: Path, **values: float) -> np.ndarray:
    shoot(light_set, Case(number=0, kind="null", seed=5, imperfections=values), out)
    paths = sorted(out.glob("*/0/ir_*.png"))
    return np.stack([np.asarray(cv2.imread(str(path), cv2.IMREAD_UNCHANGED)) for path in paths])


def test_nothing_changes_at_zero(light_set: Path, tmp_path: Path) -> None:
    plain = _images(light_set, tmp_path / "plain")
    zero = _images(light_set, tmp_path / "zero", **dict.fromkeys(IMPERFECTIONS, 0.0))
    np.testing.assert_array_equal(zero, plain)


def test_effects_that_name_an_imperfection_are_in_the_table() -> None:
    names = {row for imperfection in IMPERFECTIONS.values() for row in imperfection.rows}
    assert names <= {row.name for row in effects.table()}


@pytest.mark.parametrize("name", IN_IMAGES)
def test_each_acts_on_images(name: str, light_set: Path, tmp_path: Path) -> None:
    """Expected behaviour: the same noise, so every difference is of the imperfection."""
    plain = _images(light_set, tmp_path / "plain").astype(float)
    changed = _images(light_set, tmp_path / "changed", **{name: IMPERFECTIONS[name].most})
    assert np.abs(changed - plain).mean() > 0.05
    assert abs(changed.mean() / plain.mean() - 1.0) < 0.05


def test_surfaces_block_ambient_light_alone(light: SceneLight, camera: Nominal) -> None:
    lit = imperfections.on_surfaces(light, camera, {imperfections.OCCLUDED_SKY: 0.3}, OF_SCENE)
    for before, after in ((light.left, lit.left), (light.right, lit.right)):
        assert (after.ambient_e <= before.ambient_e).all()
        assert after.ambient_e.sum() < 0.999 * before.ambient_e.sum()
        np.testing.assert_array_equal(after.laser_e, before.laser_e)
        np.testing.assert_array_equal(after.other_e, before.other_e)


def test_a_free_wall_sees_the_whole_sky(camera: Nominal) -> None:
    wall = np.full(camera.shape, 1.0)
    np.testing.assert_allclose(sky.openness(wall, camera, 0.5), 1.0)
    wall[:, :48] = BOX_M
    near, far = (sky.openness(wall, camera, reach_m) for reach_m in (0.1, 1.0))
    assert far[:, 50:].mean() < near[:, 50:].mean() <= 1.0
    np.testing.assert_allclose(far[:, :40], 1.0)  # The near surface lies before the far one.


@pytest.mark.parametrize("name", SPOTS)
def test_lens_spots_keep_light_and_variance(name: str, light: SceneLight, camera: Nominal) -> None:
    blurred = dataclasses.replace(camera, lens_blur_px=1.2)
    shaped = imperfections.with_spot(blurred, {name: IMPERFECTIONS[name].most})
    point = np.zeros(camera.shape)
    point[32, 48] = 1.0
    plain, spot = (
        optics.focus(point, light.left, Strengths(nominal=nominal, values={}))[1:, 1:]
        for nominal in (blurred, shaped)
    )
    assert spot.sum() == pytest.approx(1.0)
    assert psf.variance(spot) == pytest.approx(psf.variance(plain), rel=1e-6)
    assert np.abs(spot - plain).sum() > 0.05


def test_a_texture_has_its_contrast_on_every_body(light: SceneLight, camera: Nominal) -> None:
    contrast = 0.1
    draws = [Draws(seed=5, scene=str(number)) for number in range(12)]
    factors = []
    textured = light
    for each in draws:
        textured = imperfections.on_surfaces(light, camera, {"texture": contrast}, each)
        seen = light.left.body > 0
        ratios = [
            getattr(textured.left, name)[seen] / getattr(light.left, name)[seen]
            for name in ("even_e", "ambient_e")
        ]
        np.testing.assert_allclose(ratios[0], ratios[1], rtol=1e-12)
        factors.append(ratios[0])
    assert np.mean(factors) == pytest.approx(1.0, abs=0.03)
    assert 0.5 * contrast < np.std(factors) < 1.5 * contrast
    assert not np.allclose(factors[0], factors[1])
    lights = [getattr(textured.left, name) for name in LIGHTS]
    assert all(np.isfinite(image).all() and (image >= 0).all() for image in lights)


def test_both_imagers_see_the_same_texture(camera: Nominal) -> None:
    """On a plane at disparity 6 px, the right image is the left one 6 px further left."""
    depth_m = np.full(camera.shape, camera.focal_baseline_px_m / 6.0)
    ones = np.ones(camera.shape)
    view = LightView(
        **dict.fromkeys(LIGHTS, ones),
        depth_m=depth_m,
        body=np.ones(camera.shape, np.uint32),
        px=ones,
        py=ones,
        up=np.array([0.0, -1.0, 0.0]),
    )
    flat = SceneLight(left=view, right=view)
    textured = imperfections.on_surfaces(flat, camera, {"texture": 0.2}, OF_SCENE)
    left, right = textured.left.ambient_e, textured.right.ambient_e
    np.testing.assert_allclose(left[:, 6:], right[:, :-6], rtol=1e-9)
    assert left.std() > 0.05


@given(reach=st.floats(0.0, 1.0), seed=st.integers(0, 2**62), count=st.integers(1, 8))
def test_exposures_of_scenes_have_no_common_factor(reach: float, seed: int, count: int) -> None:
    names = [str(number) for number in range(count)]
    factors = imperfections.exposure_factors(names, {"exposure": reach}, seed)
    logs = [math.log(factor) for factor in factors.values()]
    assert math.fsum(logs) == pytest.approx(0.0, abs=1e-9)
    assert max(map(abs, logs)) <= 2 * reach + 1e-12
    assert list(factors) == names


def test_an_exposure_multiplies_that_of_the_effect(camera: Nominal) -> None:
    longer = Strengths(nominal=camera, values={"exposure": 2 * camera.exposure_s, "veil": 0.1})
    exposed = imperfections.exposed(longer, 1.25)
    assert exposed["exposure"] == pytest.approx(2.5 * camera.exposure_s)
    assert exposed["veil"] == 0.1


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"fog": 0.1}, r"imperfection must be a known one; got fog\. Give some of"),
        ({"texture": -0.1}, r"texture must be 0 to 1; got -0\.1\."),
        ({"texture": math.nan}, "texture must be 0 to 1; got nan"),
        ({"disc_spot": 0.5, "tailed_spot": 0.1}, r"lens spot must have one shape; got \['disc"),
    ],
)
def test_impossible_imperfections_are_refused(values: dict[str, float], message: str) -> None:
    with pytest.raises(WithheldError, match=message):
        Case(number=0, kind="null", seed=1, imperfections=values)
