"""Optics: blur, vignetting, veiling glare, alignment and speckle follow the effect pages."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from starling.diagnosis.validation.camera import optics, psf
from starling.diagnosis.validation.camera.catalogue import Strengths
from starling.diagnosis.validation.camera.chain import ExposedPair
from starling.diagnosis.validation.camera.draws import Draws
from starling.diagnosis.validation.camera.light import SceneLight
from starling.diagnosis.validation.camera.nominal import Nominal
from starling.diagnosis.validation.camera.optics import (
    ResidualAlignment,
    imager_alignment,
    resample,
)


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
    blurred = optics.focus(_point(camera, 31, 47), light.left, strengths)
    assert _variance(blurred, 47) == pytest.approx(sigma_px**2, rel=1e-6, abs=1e-12)
    assert blurred.sum() == pytest.approx(1.0)


@pytest.mark.parametrize("shape", [-1.0, -0.4, 0.4, 1.0])
def test_the_shape_of_a_spot_keeps_light_and_width(
    shape: float, light: SceneLight, camera: Nominal
) -> None:
    """Law: the variance of the blur; a kurtosis below that of a Gaussian for discs, else above."""
    wide = dataclasses.replace(camera, lens_blur_px=1.5)
    spots = []
    for value in (0.0, shape):
        strengths = Strengths(nominal=wide, values={"spot_shape": value})
        spots.append(optics.focus(_point(camera, 31, 47), light.left, strengths))
        assert spots[-1].sum() == pytest.approx(1.0) and spots[-1].min() > -1e-12
        assert _variance(spots[-1], 47) == pytest.approx(1.5**2, rel=2e-3)
    fourth = [(spot.sum(0) * (np.arange(96) - 47) ** 4).sum() for spot in spots]
    assert (fourth[1] - fourth[0]) * shape > 0


def test_corner_blur_grows_with_the_square_of_the_radius(
    light: SceneLight, camera: Nominal
) -> None:
    strengths = Strengths(nominal=camera, values={"corner_blur": 2.0})
    added = optics.added_blur_px(light.left, strengths)
    assert added[31, 47] < 0.05
    x, y = 80 - camera.cx_px, 10 - camera.cy_px
    assert added[10, 80] == pytest.approx(2.0 * np.hypot(x, y) / (0.5 * np.hypot(96, 64)))
    blurred = optics.focus(_point(camera, 12, 76), light.left, strengths)
    assert _variance(blurred, 76) == pytest.approx(0.16 + added[12, 76] ** 2, rel=0.01)


def test_near_defocus_depends_on_the_depth(light: SceneLight, camera: Nominal) -> None:
    for focus_m in (1.0, 2.0):
        focused = dataclasses.replace(camera, lens_focus_m=focus_m)
        strengths = Strengths(nominal=focused, values={"near_defocus": 0.5})
        added = optics.added_blur_px(light.left, strengths)
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
    factor = optics.vignetting(wide, exponent)
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
    factor = optics.vignetting(wide, 4.0)
    assert factor[0, 0] == 0.0 and factor[31, 47] > 0.9


def test_veil_preserves_the_mean_and_scatters_its_share(camera: Nominal) -> None:
    rng = np.random.default_rng(0)
    laser, rest = rng.random(camera.shape), np.full(camera.shape, 3.0)
    direct, veiled = optics.veil(laser, rest, 0.1)
    np.testing.assert_allclose(direct, 0.9 * laser)
    assert (direct + veiled).mean() == pytest.approx((laser + rest).mean())
    spread = veiled - 0.9 * rest
    assert spread.std() < 0.02 * spread.mean()
    assert optics.veil(laser, rest, 0.0)[0] is laser


def test_added_blur_is_a_disc(light: SceneLight, camera: Nominal) -> None:
    point = _point(camera, 31, 47)
    blurred = optics.focus(point, light.left, Strengths(nominal=camera, values={"lens_blur": 1.5}))
    spot = psf.kernel("disc", (1.5**2 - 0.4**2) ** 0.5)
    law = psf.blur(psf.blur(point, psf.kernel("gaussian", 0.4)), spot)
    np.testing.assert_allclose(blurred, law, atol=1e-6)


PLACES = [(20.0, 70.0), (12.0, 20.0), (50.0, 60.0), (48.0, 15.0)]  # Row, column.


def _move(
    camera: Nominal, alignment: ResidualAlignment, row: float, column: float
) -> tuple[float, float]:
    """Return the displacement of the centroid of a smooth spot (x, y) [px]."""
    y, x = np.mgrid[: camera.height, : camera.width]
    spot = np.exp(-((x - column) ** 2 + (y - row) ** 2) / (2 * 1.5**2))
    moved = resample(spot, alignment, camera)
    moved = moved / moved.sum()
    return float((moved * x).sum()) - column, float((moved * y).sum()) - row


@pytest.mark.parametrize(("row", "column"), PLACES)
def test_points_move_by_the_laws_of_the_pages(row: float, column: float, camera: Nominal) -> None:
    x, y, f = column - camera.cx_px, row - camera.cy_px, camera.fx_px
    angle = math.radians(0.8)
    radius = math.hypot(x, y) / camera.half_diagonal_px
    laws = {
        ResidualAlignment(offset_x_px=0.7): (0.7, 0.0),
        ResidualAlignment(offset_y_px=-1.3): (0.0, -1.3),
        ResidualAlignment(roll_deg=0.8): (angle * y, -angle * x),
        ResidualAlignment(pitch_deg=0.8): (x * y * angle / f, f * angle * (1 + y**2 / f**2)),
        ResidualAlignment(yaw_deg=0.8): (-f * angle * (1 + x**2 / f**2), -x * y * angle / f),
        ResidualAlignment(magnification=1.02): (0.02 * x, 0.02 * y),
        ResidualAlignment(distortion_px=0.5): (
            0.5 * radius**3 * x / math.hypot(x, y),
            0.5 * radius**3 * y / math.hypot(x, y),
        ),
    }
    for alignment, law in laws.items():
        assert _move(camera, alignment, row, column) == pytest.approx(law, abs=0.02)


@settings(max_examples=20)
@given(dx=st.floats(-1.5, 1.5), dy=st.floats(-1.5, 1.5))
def test_opposite_offsets_cancel(dx: float, dy: float, camera: Nominal) -> None:
    y, x = np.mgrid[: camera.height, : camera.width]
    image = 1.0 + np.exp(-((x - 45.0) ** 2 + (y - 30.0) ** 2) / 18.0)
    moved = resample(image, ResidualAlignment(offset_x_px=dx, offset_y_px=dy), camera)
    back = resample(moved, ResidualAlignment(offset_x_px=-dx, offset_y_px=-dy), camera)
    np.testing.assert_allclose(back[5:-5, 5:-5], image[5:-5, 5:-5], atol=2e-3)


def test_distortion_keeps_a_uniform_image(camera: Nominal) -> None:
    flat = np.full(camera.shape, 2.0)
    np.testing.assert_allclose(resample(flat, ResidualAlignment(distortion_px=0.5), camera), 2.0)


def test_no_misalignment_returns_the_image_itself(camera: Nominal) -> None:
    image = np.ones(camera.shape)
    assert resample(image, ResidualAlignment(), camera) is image


def test_only_the_focal_scale_is_in_both_images(camera: Nominal) -> None:
    values = {
        "focal_scale": 1.01,
        "disparity_offset": 0.1,
        "vertical_offset": 0.2,
        "roll": 0.3,
        "pitch": 0.4,
        "yaw": 0.5,
        "distortion": 0.6,
    }
    strengths = Strengths(nominal=camera, values=values)
    assert imager_alignment("left", strengths) == ResidualAlignment(magnification=1.01)
    assert imager_alignment("right", strengths) == ResidualAlignment(
        magnification=1.01,
        offset_x_px=0.1,
        offset_y_px=0.2,
        roll_deg=0.3,
        pitch_deg=0.4,
        yaw_deg=0.5,
        distortion_px=0.6,
    )


SHAPE = (300, 400)


def _grain(camera: Nominal, contrast: float, cause: str = "left/speckle") -> np.ndarray:
    return optics.speckle(SHAPE, contrast, camera, Draws(seed=4, scene="a").scene_rng(cause))


@pytest.mark.parametrize("contrast", [0.03, 0.2, 0.5])
def test_mean_and_contrast(contrast: float, camera: Nominal) -> None:
    grain = _grain(camera, contrast)
    assert grain.mean() == pytest.approx(1.0, abs=4 * contrast / math.sqrt(grain.size / 2))
    assert grain.std() == pytest.approx(contrast, rel=0.02)
    assert grain.min() > 0


def test_speckle_is_log_normal(camera: Nominal) -> None:
    """The skewness is 3 C + C^3 for a log-normal law and 2 C for a gamma law."""
    grain = _grain(camera, 0.3)
    skewness = np.mean((grain - 1.0) ** 3) / 0.3**3
    assert skewness == pytest.approx(3 * 0.3 + 0.3**3, abs=0.05)


def test_grain_size_grows_with_the_f_number(camera: Nominal) -> None:
    def correlation(f_number: float) -> float:
        grain = _grain(dataclasses.replace(camera, f_number=f_number), 0.3)
        return float(np.corrcoef(grain[:, 1:].ravel(), grain[:, :-1].ravel())[0, 1])

    assert 0.02 < correlation(2.0) < correlation(4.0) < correlation(8.0) < 0.7


def test_neighbours_correlate_as_averages_of_fine_speckle(camera: Nominal) -> None:
    """Rationale: compare to speckle of a random pupil, averaged over pixels.

    There are 16 points per pixel. The coarse pupil causes an error of a few per cent.
    """
    fine, f_number = 16, 6.0
    width = 850e-9 * f_number / 3e-6 * fine  # lambda F [points].
    side = 1024
    frequency = np.fft.fftfreq(side)
    pupil = np.hypot(frequency[:, None], frequency[None, :]) < 0.5 / width
    rng = np.random.default_rng(0)
    correlations = []
    for _ in range(6):
        phases = np.exp(2j * np.pi * rng.random((side, side)))
        intensity = np.abs(np.fft.ifft2(pupil * phases)) ** 2
        pixels = intensity.reshape(side // fine, fine, side // fine, fine).mean((1, 3))
        correlations.append(np.corrcoef(pixels[:, 1:].ravel(), pixels[:, :-1].ravel())[0, 1])
    grain = _grain(dataclasses.replace(camera, f_number=f_number), 0.3)
    measured = np.corrcoef(grain[:, 1:].ravel(), grain[:, :-1].ravel())[0, 1]
    assert measured == pytest.approx(np.mean(correlations), abs=0.04)


def test_imagers_have_different_speckle(camera: Nominal) -> None:
    left, right = _grain(camera, 0.3), _grain(camera, 0.3, "right/speckle")
    assert abs(np.corrcoef(left.ravel(), right.ravel())[0, 1]) < 0.02


def test_speckle_is_constant_over_frames(take) -> None:
    """Temporal means over two sets of frames are correlated because of the speckle."""

    def mean_image(frames: range, **values: float) -> np.ndarray:
        pairs: list[ExposedPair] = [take(frame=frame, shot_noise=0.3, **values) for frame in frames]
        return np.mean([pair.left for pair in pairs], axis=0)

    plain = mean_image(range(8))
    changes = [
        mean_image(half, laser_speckle=0.4) - plain for half in (range(8, 16), range(16, 24))
    ]
    assert np.corrcoef(changes[0].ravel(), changes[1].ravel())[0, 1] > 0.9
