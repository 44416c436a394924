"""The lens: variances, the dimming over the image and the veil are the page's."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from starling.diagnosis.validation.camera import lens, psf
from starling.diagnosis.validation.camera.catalogue import Strengths
from starling.diagnosis.validation.camera.light import Light
from starling.diagnosis.validation.camera.nominal import Nominal


def _point(camera: Nominal, row: int, column: int) -> np.ndarray:
    image = np.zeros(camera.shape)
    image[row, column] = 1.0
    return image


def _variance(image: np.ndarray, column: int) -> float:
    offset = np.arange(image.shape[1]) - column
    return float((image.sum(0) * offset**2).sum() / image.sum())


@pytest.mark.parametrize("sigma_px", [0.0, 0.2, 0.4, 0.7, 1.5])
def test_lens_blur_is_the_whole_spot(sigma_px: float, light: Light, camera: Nominal) -> None:
    strengths = Strengths(nominal=camera, values={"lens_blur": sigma_px})
    seen = lens.focus(_point(camera, 31, 47), light.left, strengths)
    assert _variance(seen, 47) == pytest.approx(sigma_px**2, rel=1e-6, abs=1e-12)
    assert seen.sum() == pytest.approx(1.0)


def test_corner_blur_grows_with_the_square_of_the_radius(light: Light, camera: Nominal) -> None:
    strengths = Strengths(nominal=camera, values={"corner_blur": 2.0})
    added = lens.added_blur_px(light.left, strengths)
    assert added[31, 47] < 0.05
    x, y = 80 - camera.cx_px, 10 - camera.cy_px
    assert added[10, 80] == pytest.approx(2.0 * np.hypot(x, y) / (0.5 * np.hypot(96, 64)))
    seen = lens.focus(_point(camera, 12, 76), light.left, strengths)
    assert _variance(seen, 76) == pytest.approx(0.16 + added[12, 76] ** 2, rel=0.01)


def test_near_defocus_is_of_the_seen_depth(light: Light, camera: Nominal) -> None:
    for focus_m in (1.0, 2.0):
        focused = dataclasses.replace(camera, lens_focus_m=focus_m)
        strengths = Strengths(nominal=focused, values={"near_defocus": 0.5})
        added = lens.added_blur_px(light.left, strengths)
        np.testing.assert_allclose(added, np.nan_to_num(_law(light, focus_m), nan=0.5 / focus_m))


def _law(light: Light, focus_m: float) -> np.ndarray:
    return 0.5 * np.abs(1.0 / light.left.depth_m - 1.0 / focus_m)


@pytest.mark.parametrize("focal_px", [48.0, 60.0, 120.0])
@pytest.mark.parametrize("exponent", [0.5, 1.0, 2.0, 4.0])
def test_vignetting_is_the_pages_over_the_image(
    exponent: float, focal_px: float, camera: Nominal
) -> None:
    """Results: of all cos^n the page's fits best to 1 %; no pixel is further from it than 0.1.

    Of the logarithms, which weigh the dark corners as much as the middle, that within 6 % does.
    """
    wide = dataclasses.replace(camera, fx_px=focal_px, fy_px=focal_px)
    factor = lens.vignetting(wide, exponent)
    across, down = wide.tangents()
    cosine = (1.0 + across**2 + down**2) ** -0.5
    tried = exponent * np.linspace(0.8, 1.25, 451)
    away = [float(((factor - cosine**n) ** 2).sum()) for n in tried]
    assert tried[np.argmin(away)] == pytest.approx(exponent, rel=0.01)
    slope = np.log(cosine)
    of_logarithms = float((np.log(factor) * slope).sum() / (slope**2).sum())
    assert of_logarithms == pytest.approx(exponent, rel=0.06)
    assert factor[31, 47] == pytest.approx(1.0, abs=0.02)
    assert np.abs(factor - cosine**exponent).max() < 0.1


def test_no_lens_is_too_wide_to_dim(camera: Nominal) -> None:
    """Expected behaviour: at 150 degrees the corners go dark, and nothing fails."""
    wide = dataclasses.replace(camera, fx_px=13.0, fy_px=13.0)
    factor = lens.vignetting(wide, 4.0)
    assert factor[0, 0] == 0.0 and factor[31, 47] > 0.9


def test_veil_keeps_the_mean_and_takes_its_share(camera: Nominal) -> None:
    rng = np.random.default_rng(0)
    laser, rest = rng.random(camera.shape), np.full(camera.shape, 3.0)
    kept, veiled = lens.veil(laser, rest, 0.1)
    np.testing.assert_allclose(kept, 0.9 * laser)
    assert (kept + veiled).mean() == pytest.approx((laser + rest).mean())
    spread = veiled - 0.9 * rest
    assert spread.std() < 0.02 * spread.mean()
    assert lens.veil(laser, rest, 0.0)[0] is laser


def test_what_is_added_to_the_nominal_spot_is_a_disc(light: Light, camera: Nominal) -> None:
    point = _point(camera, 31, 47)
    seen = lens.focus(point, light.left, Strengths(nominal=camera, values={"lens_blur": 1.5}))
    spot = psf.kernel("disc", (1.5**2 - 0.4**2) ** 0.5)
    law = psf.blur(psf.blur(point, psf.kernel("gaussian", 0.4)), spot)
    np.testing.assert_allclose(seen, law, atol=1e-6)
