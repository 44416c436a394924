"""The lens: blur, vignetting and veiling glare follow the effect pages."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from starling.diagnosis.validation.camera import lens, psf
from starling.diagnosis.validation.camera.catalogue import Strengths
from starling.diagnosis.validation.camera.light import SceneLight
from starling.diagnosis.validation.camera.nominal import Nominal


def _point(camera: Nominal, row: int, column: int) -> np.ndarray:
    image = np.zeros(camera.shape)
    image[row, column] = 1.0
    return image


def _variance(image: np.ndarray, column: int) -> float:
    offset = np.arange(image.shape[1]) - column
    return float((image.sum(0) * offset**2).sum() / image.sum())


@pytest.mark.parametrize("sigma_px", [0.0, 0.2, 0.4, 0.7, 1.5])
def test_lens_blur_is_the_whole_spot(sigma_px: float, light: SceneLight, camera: Nominal) -> None:
    strengths = Strengths(nominal=camera, values={"lens_blur": sigma_px})
    blurred = lens.focus(_point(camera, 31, 47), light.left, strengths)
    assert _variance(blurred, 47) == pytest.approx(sigma_px**2, rel=1e-6, abs=1e-12)
    assert blurred.sum() == pytest.approx(1.0)


def test_corner_blur_grows_with_the_square_of_the_radius(
    light: SceneLight, camera: Nominal
) -> None:
    strengths = Strengths(nominal=camera, values={"corner_blur": 2.0})
    added = lens.added_blur_px(light.left, strengths)
    assert added[31, 47] < 0.05
    x, y = 80 - camera.cx_px, 10 - camera.cy_px
    assert added[10, 80] == pytest.approx(2.0 * np.hypot(x, y) / (0.5 * np.hypot(96, 64)))
    blurred = lens.focus(_point(camera, 12, 76), light.left, strengths)
    assert _variance(blurred, 76) == pytest.approx(0.16 + added[12, 76] ** 2, rel=0.01)


def test_near_defocus_depends_on_the_depth(light: SceneLight, camera: Nominal) -> None:
    for focus_m in (1.0, 2.0):
        focused = dataclasses.replace(camera, lens_focus_m=focus_m)
        strengths = Strengths(nominal=focused, values={"near_defocus": 0.5})
        added = lens.added_blur_px(light.left, strengths)
        np.testing.assert_allclose(added, np.nan_to_num(_law(light, focus_m), nan=0.5 / focus_m))


def _law(light: SceneLight, focus_m: float) -> np.ndarray:
    return 0.5 * np.abs(1.0 / light.left.depth_m - 1.0 / focus_m)


@pytest.mark.parametrize("focal_px", [48.0, 60.0, 120.0])
@pytest.mark.parametrize("exponent", [0.5, 1.0, 2.0, 4.0])
def test_vignetting_agrees_with_the_law_of_the_page(
    exponent: float, focal_px: float, camera: Nominal
) -> None:
    """Results: the best-fit exponent of cos^n agrees within 1 %, and no pixel differs by 0.1.

    A fit of the logarithms, which weights dark corners as much as the centre, agrees within 6 %.
    """
    wide = dataclasses.replace(camera, fx_px=focal_px, fy_px=focal_px)
    factor = lens.vignetting(wide, exponent)
    across, down = wide.tangents()
    cosine = (1.0 + across**2 + down**2) ** -0.5
    exponents = exponent * np.linspace(0.8, 1.25, 451)
    residuals = [float(((factor - cosine**n) ** 2).sum()) for n in exponents]
    assert exponents[np.argmin(residuals)] == pytest.approx(exponent, rel=0.01)
    slope = np.log(cosine)
    logarithmic_fit = float((np.log(factor) * slope).sum() / (slope**2).sum())
    assert logarithmic_fit == pytest.approx(exponent, rel=0.06)
    assert factor[31, 47] == pytest.approx(1.0, abs=0.02)
    assert np.abs(factor - cosine**exponent).max() < 0.1


def test_a_very_wide_lens_dims_to_zero(camera: Nominal) -> None:
    """Expected behaviour: at a field of 150 degrees the corners are dark."""
    wide = dataclasses.replace(camera, fx_px=13.0, fy_px=13.0)
    factor = lens.vignetting(wide, 4.0)
    assert factor[0, 0] == 0.0 and factor[31, 47] > 0.9


def test_veil_preserves_the_mean_and_scatters_its_share(camera: Nominal) -> None:
    rng = np.random.default_rng(0)
    laser, rest = rng.random(camera.shape), np.full(camera.shape, 3.0)
    direct, veiled = lens.veil(laser, rest, 0.1)
    np.testing.assert_allclose(direct, 0.9 * laser)
    assert (direct + veiled).mean() == pytest.approx((laser + rest).mean())
    spread = veiled - 0.9 * rest
    assert spread.std() < 0.02 * spread.mean()
    assert lens.veil(laser, rest, 0.0)[0] is laser


def test_added_blur_is_a_disc(light: SceneLight, camera: Nominal) -> None:
    point = _point(camera, 31, 47)
    blurred = lens.focus(point, light.left, Strengths(nominal=camera, values={"lens_blur": 1.5}))
    spot = psf.kernel("disc", (1.5**2 - 0.4**2) ** 0.5)
    law = psf.blur(psf.blur(point, psf.kernel("gaussian", 0.4)), spot)
    np.testing.assert_allclose(blurred, law, atol=1e-6)
