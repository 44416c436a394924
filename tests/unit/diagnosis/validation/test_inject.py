"""Injection into real pairs: real noise is preserved and effects follow their pages."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from starling.diagnosis.validation.camera import inject, optics, psf
from starling.diagnosis.validation.camera.catalogue import ROWS
from starling.diagnosis.validation.camera.chain import ExposedPair
from starling.diagnosis.validation.camera.dequantise import band_power, subcode_offsets
from starling.diagnosis.validation.camera.errors import WithheldError
from starling.diagnosis.validation.camera.nominal import Nominal

SHAPE = (100, 150)


@pytest.fixture
def real(camera: Nominal) -> Nominal:
    """A camera with 0.05 DN per electron and a black level of 10 DN."""
    return dataclasses.replace(
        camera,
        width=150,
        height=100,
        cx_px=74.5,
        cy_px=49.5,
        dn_per_e=0.05,
        black_level_dn=10.0,
        read_noise_e=30.0,
        lens_blur_px=0.0,
    )


def _flat(real: Nominal, level_dn: float = 60.0, seed: int = 0) -> np.ndarray:
    """A uniform image with the noise of the camera's photon transfer law."""
    rng = np.random.default_rng(seed)
    variance = 0.05 * level_dn + (0.05 * 30.0) ** 2
    dn = 10.0 + level_dn + rng.normal(0, variance**0.5, SHAPE)
    return np.clip(np.rint(dn), 0, 255).astype(np.uint8)


def _inject(
    image: np.ndarray, real: Nominal, right: np.ndarray | None = None, **values: Any
) -> ExposedPair:
    return inject.inject(image, image if right is None else right, values, real, seed=5)


@pytest.mark.parametrize("name", sorted(inject.EFFECTS))
def test_neutral_returns_the_images_themselves(name: str, real: Nominal) -> None:
    image = _flat(real)
    pair = inject.inject(image, image, {name: ROWS[name].neutral_of(real)}, real, seed=5)
    assert pair.left is image and pair.right is image


def test_second_exposures_differ_as_two_readings_do(real: Nominal) -> None:
    """Law: two readings of a scene differ by twice the variance of the photon transfer law."""
    image = _flat(real)
    first, second = (
        inject.inject(image, image, {}, real, seed=seed, exposed_again=True) for seed in (1, 2)
    )
    variance = 0.05 * 60 + 1.5**2 + 1 / 12
    left = first.left.astype(float) - second.left
    right = first.right - 1.0 * second.right
    assert left.var() == pytest.approx(2 * variance, rel=0.05)
    assert abs(np.corrcoef(left.ravel(), right.ravel())[0, 1]) < 0.03


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("lens_ghost", 0.3),
        ("astigmatism", 2.0),
        ("finger_print", 0.8),
        ("lens_blur", 1.2),
        ("crosstalk", 0.3),
        ("vignetting", 3.0),
        ("roll", 0.3),
        ("veil", 0.1),
        ("fixed_pattern", 0.05),
    ],
)
@pytest.mark.parametrize("again", [False, True], ids=["as captured", "exposed again"])
def test_noise_follows_the_photon_transfer_law(
    name: str, value: float, again: bool, real: Nominal
) -> None:
    """Rationale: a lens blurs light, but not noise. A second exposure doubles the variance."""
    outs = []
    for frame in (0, 1):  # Their difference is noise only.
        image = _flat(real, seed=frame)
        pair = inject.inject(
            image, image, {name: value}, real, seed=5, frame=frame, exposed_again=again
        )
        outs.append(pair.right[20:80, 20:130].astype(float) - 10.0)
    level = 0.5 * (outs[0] + outs[1]).mean()
    variance = (1 + again) * (0.05 * level + 1.5**2) + 1 / 12
    assert (outs[0] - outs[1]).var() / 2 == pytest.approx(variance, rel=0.08)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("column_noise", 200.0),
        ("hot_pixels", 0.01),
        ("column_rain", 0.05),
        ("crosstalk", 0.3),
        ("lens_blur", 1.2),
        ("veil", 0.1),
        ("vignetting", 3.0),
    ],
)
def test_a_device_that_averages_codes_averages_injected_effects(
    name: str, value: float, real: Nominal
) -> None:
    """Law: injection after averaging equals averaging after injection."""
    effect: dict[str, Any] = {name: value}
    quiet = dataclasses.replace(real, read_noise_e=0.0, shot_noise=0.0)
    rng = np.random.default_rng(1)
    sharp = np.clip(rng.normal(60, 12, SHAPE), 0, 255).round().astype(np.uint8)
    spot = psf.kernel("gaussian", 0.6)
    averaged = psf.blur(sharp.astype(float), spot)
    expected = psf.blur(_inject(sharp, quiet, **effect).left.astype(float), spot)
    device = dataclasses.replace(quiet, smoothing_px=0.6)
    injected = _inject(averaged.round().astype(np.uint8), device, **effect).left.astype(float)
    inner = np.s_[3:-3, 3:-3]
    rounding = (3 / 12) ** 0.5
    assert (injected - expected)[inner].std() < rounding
    assert (expected - averaged)[inner].std() > 1.1 * rounding
    if name in {"column_noise", "hot_pixels", "column_rain"}:
        not_averaged = _inject(averaged.round().astype(np.uint8), quiet, **effect).left
        assert (not_averaged - expected)[inner].std() > 5 * rounding


def test_added_noise_is_averaged_by_the_device(real: Nominal) -> None:
    """Law: the variance scales by the sum of squares of the kernel, whose overlap correlates it."""
    device = dataclasses.replace(real, smoothing_px=0.6)
    flat = np.full(SHAPE, 70, np.uint8)
    spot = psf.kernel("gaussian", 0.6)
    power = float((spot**2).sum())
    correlation = float((spot[:, 1:] * spot[:, :-1]).sum()) / power

    def check(added: np.ndarray, variance: float) -> None:
        assert added.var() - 1 / 12 == pytest.approx(power * variance, rel=0.06)
        along = (added[:, 1:] * added[:, :-1]).mean() / (added.var() - 1 / 12)
        assert along == pytest.approx(correlation, abs=0.04)

    check(_inject(flat, device, read_noise=120.0).left - 70.0, 0.05**2 * (120.0**2 - 30.0**2))
    again = inject.inject(flat, flat, {}, device, seed=5, exposed_again=True).right
    check(again - 70.0 - subcode_offsets(SHAPE, side="right"), 0.05 * 60 + 1.5**2)


def test_smoothing_widens_existing_averaging(real: Nominal) -> None:
    """Law: smoothing of 1 px on an image averaged by 0.6 px equals averaging by 1 px."""
    rng = np.random.default_rng(2)
    sharp = rng.normal(90, 20, SHAPE)
    once, wide = (psf.blur(sharp, psf.kernel("gaussian", px)) for px in (0.6, 1.0))
    device = dataclasses.replace(real, smoothing_px=0.6)
    smoothed = _inject(once.round().astype(np.uint8), device, smoothing=1.0).left
    inner = np.s_[5:-5, 5:-5]
    assert (smoothed - wide)[inner].std() < 0.1 * (once - wide)[inner].std()


def test_blur_widens_a_line(real: Nominal) -> None:
    """Law: the variance of the line profile increases by sigma^2."""
    quiet = dataclasses.replace(real, read_noise_e=0.0, shot_noise=0.0)
    image = np.full(SHAPE, 10, np.uint8)
    image[:, 75] = 250
    image[:, 74] = image[:, 76] = 130
    offset = np.arange(150) - 75

    def variance(pixels: np.ndarray) -> float:
        profile = pixels.astype(float).sum(0) - 10.0 * len(pixels)
        return float((profile * offset**2).sum() / profile.sum())

    out = _inject(image, quiet, lens_blur=1.5).left
    assert variance(out) - variance(image) == pytest.approx(2.25, rel=0.03)


def test_blur_preserves_speckle(real: Nominal) -> None:
    """Law: blurred dots have the speckle of sharp ones if the speckle contrast is known."""
    quiet = dataclasses.replace(real, read_noise_e=0.0, shot_noise=0.0)
    known = dataclasses.replace(quiet, speckle_contrast=0.25)
    y, x = np.mgrid[:100, :150] % 12 - 6
    dots = 100 * np.exp(-(x**2 + y**2) / 8.0)
    grain = optics.speckle(SHAPE, 0.25, known, np.random.default_rng(4))
    image = (30 + dots * grain).round().astype(np.uint8)

    def finest(image: np.ndarray) -> float:
        return float(band_power(image.astype(float))[-12:].mean())

    expected = finest(30 + psf.blur(dots, psf.kernel("disc", 0.8)) * grain)
    assert finest(_inject(image, quiet, lens_blur=0.8).left) < 0.1 * expected
    assert finest(_inject(image, known, lens_blur=0.8).left) == pytest.approx(expected, rel=0.2)
    spread = finest(_inject(image, quiet, astigmatism=0.8).left)
    assert spread < 0.5 * expected
    assert finest(_inject(image, known, astigmatism=0.8).left) > 1.5 * spread


def test_only_the_right_image_is_shifted(real: Nominal) -> None:
    y, x = np.mgrid[:100, :150]
    spot = 20 + 200 * np.exp(-((x - 70) ** 2 + (y - 50) ** 2) / 50.0)
    image = np.rint(spot).astype(np.uint8)
    quiet = dataclasses.replace(real, read_noise_e=0.0, shot_noise=0.0)
    pair = _inject(image, quiet, vertical_offset=1.25, disparity_offset=-0.5)
    np.testing.assert_array_equal(pair.left, image)
    near = np.hypot(x - 69.5, y - 51.25) < 20  # Elsewhere the offset within a code dominates.
    weight = np.where(near, pair.right.astype(float) - 20.0, 0.0)
    assert (weight * y).sum() / weight.sum() == pytest.approx(51.25, abs=0.05)
    assert (weight * x).sum() / weight.sum() == pytest.approx(69.5, abs=0.05)


def test_gain_scales_the_signal_above_black(real: Nominal) -> None:
    out = _inject(_flat(real), real, gain=1.6)
    assert out.left.mean() == pytest.approx(10 + 1.6 * 60, abs=0.2)
    assert out.left.std() / _flat(real).std() == pytest.approx(1.6, rel=0.05)


def test_read_noise_is_added_in_quadrature(real: Nominal) -> None:
    image = _flat(real)
    out = _inject(image, real, read_noise=80.0)
    left = out.left.astype(float) - image
    assert left.std() == pytest.approx(0.05 * (80.0**2 - 30.0**2) ** 0.5, rel=0.03)
    right = out.right.astype(float) - image
    assert abs(np.corrcoef(left.ravel(), right.ravel())[0, 1]) < 0.03


def test_electronics_and_codes(real: Nominal) -> None:
    image = _flat(real)
    columns = _inject(image, real, column_noise=40.0).left.mean(0) - image.mean(0)
    assert columns.std() == pytest.approx(2.0, rel=0.2)
    assert (_inject(image, real, hot_pixels=0.01).left == 255).mean() == pytest.approx(
        0.01, rel=0.4
    )
    assert _inject(image, real, black_level=16.0).left.mean() == pytest.approx(76.0, abs=0.2)
    lifted = 255 * (60 / 255) ** (1 / 2.0) + 10
    assert _inject(image, real, gamma=2.0).left.mean() == pytest.approx(lifted, abs=1.0)
    assert _inject(image, real, smoothing=1.0).left.std() < 0.4 * image.std()
    vignetted = _inject(image, real, vignetting=4.0).left
    across, down = real.tangents()
    law = (1.0 + across**2 + down**2) ** -2
    assert vignetted.mean() - 10.0 == pytest.approx(60.0 * law.mean(), rel=0.04)
    assert vignetted[:5, :5].mean() - 10.0 == pytest.approx(60.0 * law[0, 0], rel=0.25)


def test_effects_outside_the_table(real: Nominal) -> None:
    flat = np.full(SHAPE, 60, np.uint8)
    quiet = dataclasses.replace(real, read_noise_e=0.0, shot_noise=0.0)

    def change(image: np.ndarray = flat, **values: Any) -> tuple[np.ndarray, np.ndarray]:
        pair = _inject(image, quiet, **values)
        return pair.left.astype(float) - image, pair.right.astype(float) - image

    spot = np.full(SHAPE, 10, np.uint8)
    spot[20:26, 30:36] = 250
    ghost, _ = change(spot, lens_ghost=0.3)
    assert ghost[76, 117] > 20 and ghost[50, 75] == 0
    rows = change(brightness_ramp=0.5)[0].mean(axis=1)
    assert rows.max() == pytest.approx(25, abs=2) and rows.min() == pytest.approx(-25, abs=2)
    smeared = [side.min() < -10 for side in change(finger_print=0.8)]
    assert sorted(smeared) == [False, True]
    wet = (change(column_rain=0.05)[0] > 20).any(axis=0)
    assert 0 < wet.mean() < 0.15
    noisy = _flat(real)
    assert _inject(noisy, real, block_compression=20.0).left.std() < 0.6 * noisy.std()
    line = np.full(SHAPE, 10, np.uint8)
    line[:, 20] = 250
    blurred, _ = change(line, astigmatism=2.0)
    assert blurred[50, 20] < -20 < 5 < blurred[50, 18:23].max()


def test_speckle_affects_only_dots(real: Nominal) -> None:
    """Expected behaviour: a uniform image hardly changes; dots scatter by the contrast."""
    quiet = np.full(SHAPE, 60, np.uint8)
    change = np.abs(_inject(quiet, real, laser_speckle=0.3).left.astype(int) - quiet)
    assert change.max() <= 1 and change.mean() < 0.01
    dots = quiet.copy()
    dots[4::7, 4::7] = 200
    out = _inject(dots, real, laser_speckle=0.2).left.astype(float)
    assert (out[4::7, 4::7] - 60).std() / 140 == pytest.approx(0.2, rel=0.2)


def test_noise_depends_on_the_frame_or_the_device(real: Nominal) -> None:
    image = _flat(real)

    def inject_into(frame: int, scene: str, **values: float) -> np.ndarray:
        return inject.inject(
            image, image, values, real, seed=1, scene=scene, frame=frame
        ).left.astype(float)

    assert not np.array_equal(
        inject_into(0, "a", read_noise=90.0), inject_into(1, "a", read_noise=90.0)
    )
    np.testing.assert_array_equal(
        inject_into(0, "a", column_noise=40.0), inject_into(1, "b", column_noise=40.0)
    )


def test_invalid_inputs_are_refused(real: Nominal) -> None:
    image = _flat(real)
    with pytest.raises(WithheldError, match="injected effect must be one of"):
        _inject(image, real, ambient=1.0)
    with pytest.raises(WithheldError, match="image must be of shape"):
        _inject(image, real, right=image[:-1], gain=2.0)
    with pytest.raises(WithheldError, match="lens_blur must not be below nominal"):
        _inject(image, dataclasses.replace(real, lens_blur_px=0.5), lens_blur=0.3)
    with pytest.raises(WithheldError, match="smoothing must not be below nominal"):
        _inject(image, dataclasses.replace(real, smoothing_px=0.6), smoothing=0.3)


def test_speckle_depends_on_the_scene_and_the_imager(real: Nominal) -> None:
    image = np.full(SHAPE, 60, np.uint8)
    image[4::7, 4::7] = 200

    def inject_into(scene: str, frame: int) -> ExposedPair:
        values = {"laser_speckle": 0.2}
        return inject.inject(image, image, values, real, seed=5, scene=scene, frame=frame)

    first, dots = inject_into("a", 0), np.s_[4::7, 4::7]
    np.testing.assert_array_equal(first.left, inject_into("a", 1).left)
    assert not np.array_equal(first.left, inject_into("b", 0).left)
    assert abs(np.corrcoef(first.left[dots].ravel(), first.right[dots].ravel())[0, 1]) < 0.2


def test_restored_noise_differs_between_imagers(real: Nominal) -> None:
    pair = _inject(_flat(real), real, right=_flat(real, seed=1), lens_blur=1.2)
    assert abs(np.corrcoef(pair.left.ravel(), pair.right.ravel())[0, 1]) < 0.05


def test_a_camera_with_gain_and_less_shot_noise(real: Nominal) -> None:
    """Law: variance = shot^2 g S + (g r)^2; the injected gain is relative to the camera's gain."""
    device = dataclasses.replace(real, gain=2.0, shot_noise=0.6)
    flat = np.full(SHAPE, 70, np.uint8)
    again = inject.inject(flat, flat, {}, device, seed=5, exposed_again=True).left
    added = again - 70.0 - subcode_offsets(SHAPE, side="left")
    variance = 0.6**2 * 0.1 * 60 + (0.1 * 30.0) ** 2
    assert added.var() - 1 / 12 == pytest.approx(variance, rel=0.05)
    assert _inject(flat, device, gain=3.2).left.mean() == pytest.approx(10 + 1.6 * 60, abs=0.2)
