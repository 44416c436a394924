"""Photon transfer on images of the imager model: electrons per DN, read noise, averaging."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from starling.calibration.photometry import photon_transfer
from starling.calibration.photometry.photon_transfer import fit_photon_transfer
from starling.calibration.solution import Solution
from starling.patterns.errors import InputError
from starling.sim.imaging import imager
from starling.sim.sensor import presets
from starling.sim.sensor.sensor import Imager, Sensor

BASE = presets.load("d435")


def sensor_with(**changes: float) -> Sensor:
    part = dataclasses.replace(BASE.left, auto_exposure_level=0.0, **changes)
    return dataclasses.replace(BASE, left=part, right=part)


def repeats(part: Imager, *, count: int = 4, seed: int = 3, top: float = 0.6) -> np.ndarray:
    """Frames of a scene from dark to `top` of the full well, with dots on it."""
    y, x = np.mgrid[:240, :320]
    share = top * x / 320 * (0.6 + 0.4 * np.cos(x / 2.1) * np.cos(y / 1.9))
    electrons = (share * part.full_well_e / part.gain).astype(np.float32)
    frames = [
        imager.read_out(
            part, electrons, exposure_s=part.exposure_s, unit=0, side="left", seed=seed, frame=frame
        ).delivered
        for frame in range(count)
    ]
    return np.stack(frames)


def values(solution: Solution) -> dict[str, float]:
    return {e.name.removeprefix("left."): e.value for e in solution.estimates}


@pytest.mark.parametrize(
    ("changes", "start_well_e"),
    [
        ({"bit_depth": 12, "read_noise_e": 12.0}, 6000.0),
        ({"bit_depth": 10, "read_noise_e": 40.0, "gain": 2.0}, 20000.0),
        ({"bit_depth": 8, "read_noise_e": 90.0, "black_level_dn": 9.0}, 5000.0),
        ({"bit_depth": 10, "read_noise_e": 40.0, "smoothing_px": 0.6}, 7000.0),
        ({"bit_depth": 12, "read_noise_e": 15.0, "row_noise_e": 10.0}, 7000.0),
        ({"bit_depth": 12, "read_noise_e": 12.0, "shot_noise": 0.5}, 6000.0),
    ],
)
def test_known_noise_is_recovered(changes: dict, start_well_e: float) -> None:
    """The fit is within 5 % (electrons per DN) and 10 % (read noise), with fixed-pattern noise.

    The images come from the simulated imager, so the test does not validate a device.
    """
    truth = sensor_with(**changes)
    start = dataclasses.replace(truth.left, full_well_e=start_well_e, read_noise_e=3.0)
    start = dataclasses.replace(truth, left=start)
    fitted_values = values(fit_photon_transfer(repeats(truth.left), start))
    assert fitted_values["full_well_e"] == pytest.approx(truth.left.full_well_e, rel=0.05)
    assert fitted_values["read_noise_e"] == pytest.approx(truth.left.read_noise_e, rel=0.10)
    assert fitted_values["smoothing_px"] == pytest.approx(truth.left.smoothing_px, abs=0.02)


@pytest.mark.parametrize("dark_current_e_s", [0.0, 900.0])
def test_dark_current_does_not_change_read_noise(dark_current_e_s: float) -> None:
    """Dark current of 30 electrons, with shot noise equal to read noise, counts as signal."""
    truth = sensor_with(
        bit_depth=12, read_noise_e=5.6, dark_current_e_s=dark_current_e_s, exposure_s=0.033
    )
    start = dataclasses.replace(truth, left=dataclasses.replace(truth.left, read_noise_e=3.0))
    fitted_values = values(fit_photon_transfer(repeats(truth.left, count=8, top=0.1), start))
    assert fitted_values["read_noise_e"] == pytest.approx(5.6, rel=0.10)
    assert fitted_values["full_well_e"] == pytest.approx(truth.left.full_well_e, rel=0.03)


def test_the_sensor_s_black_level_is_used() -> None:
    """Without the black level of 20 DN, the read noise would be wrong."""
    truth = sensor_with(bit_depth=12, read_noise_e=12.0, black_level_dn=20.0)
    known = sensor_with(bit_depth=12, read_noise_e=3.0, black_level_dn=20.0)
    frames = repeats(truth.left)
    fitted_values = values(fit_photon_transfer(frames, known))
    assert fitted_values["read_noise_e"] == pytest.approx(12.0, rel=0.10)
    unknown = sensor_with(bit_depth=12, read_noise_e=3.0, black_level_dn=0.0)
    wrong = values(fit_photon_transfer(frames, unknown))
    assert abs(wrong["read_noise_e"] - 12.0) > 1.2


def test_deviations_match_the_scatter_of_repeats() -> None:
    """The scatter is that of eight sets of frames; `test_intervals_cover` uses more."""
    truth = sensor_with(bit_depth=10, read_noise_e=30.0, smoothing_px=0.5)
    solutions = [
        fit_photon_transfer(repeats(truth.left, count=2, seed=seed), truth) for seed in range(8)
    ]
    scatter = np.std(
        [[estimate.value for estimate in solution.estimates] for solution in solutions],
        axis=0,
        ddof=1,
    )
    reported = np.median(
        [[estimate.sd for estimate in solution.estimates] for solution in solutions], axis=0
    )
    assert (reported < 2.5 * scatter).all() and (reported > scatter / 2.5).all()


def test_removing_row_means_keeps_the_noise_variance() -> None:
    """Subtracting the mean of a row of 8 pixels removes 1/8 of the variance, which is restored."""
    noise = np.random.default_rng(0).standard_normal((4000, 8)).astype(np.float32)
    mean = np.broadcast_to(np.linspace(10, 90, 4000, dtype=np.float32)[:, None], noise.shape)
    still = photon_transfer._remove_global(
        noise + 3 * noise[:, :1], mean, np.ones(noise.shape, bool)
    )
    assert (still**2).mean() == pytest.approx(1.0, rel=0.03)


def test_read_noise_below_the_detection_limit_is_reported() -> None:
    """Read noise of 5 electrons is below the detection limit at codes of 600 electrons."""
    truth = sensor_with(bit_depth=8, read_noise_e=5.0, full_well_e=150_000.0, black_level_dn=10.0)
    solution = fit_photon_transfer(repeats(truth.left, count=2), truth)
    read = solution.estimates[1]
    assert np.isinf(read.sd)
    assert read.value == read.start
    assert any("left.read_noise_e is below" in sentence for sentence in solution.undetermined)


def test_flicker_of_power_is_not_noise() -> None:
    truth = sensor_with(bit_depth=12, read_noise_e=15.0)
    frames = repeats(truth.left).astype(np.float64)
    black = truth.left.black_level_dn
    scale = np.array([1.0, 1.02, 0.98, 1.01])[:, None, None]
    flickering = np.rint((frames - black) * scale + black).astype(np.uint16)
    fitted_values = values(fit_photon_transfer(flickering, truth))
    assert fitted_values["full_well_e"] == pytest.approx(truth.left.full_well_e, rel=0.05)


@pytest.mark.long
def test_intervals_cover() -> None:
    """Nominal 90 % intervals hold the truth in 80 to 97 % of 60 repeats, for each number."""
    truth = sensor_with(bit_depth=10, read_noise_e=30.0, smoothing_px=0.5)
    want = np.array([truth.left.full_well_e, 30.0, 0.5])
    inside = []
    for seed in range(60):
        solution = fit_photon_transfer(repeats(truth.left, count=3, seed=seed), truth)
        off = np.array([e.value for e in solution.estimates]) - want
        inside.append(np.abs(off) < 1.645 * np.array([e.sd for e in solution.estimates]))
    rates = np.mean(inside, axis=0)
    assert ((rates >= 0.80) & (rates <= 0.97)).all(), rates


def test_one_image_is_refused() -> None:
    with pytest.raises(InputError, match="repeats must be at least 2; got 1"):
        fit_photon_transfer(np.zeros((1, 40, 40), np.uint8), BASE)


def test_copies_are_refused() -> None:
    frame = repeats(BASE.left, count=1)
    with pytest.raises(InputError, match="repeats must differ"):
        fit_photon_transfer(np.repeat(frame, 2, axis=0), BASE)


def test_saturated_repeats_are_refused() -> None:
    with pytest.raises(InputError, match="neither black nor saturated"):
        fit_photon_transfer(np.full((2, 80, 80), 255, np.uint8), BASE)


def test_repeats_with_no_level_in_common_are_refused() -> None:
    """2500 pixels over 65 thousand levels: no level has enough of them."""
    truth = sensor_with(bit_depth=16)
    rng = np.random.default_rng(0)
    frames = rng.integers(100, 60_000, (2, 50, 50)).astype(np.uint16)
    with pytest.raises(InputError, match="pixels of one level"):
        fit_photon_transfer(frames, truth)


def test_noise_that_falls_with_the_level_is_refused() -> None:
    rng = np.random.default_rng(1)
    level = np.repeat(np.linspace(30, 200, 300)[None], 200, axis=0)
    frames = level + (8 - level / 30) * rng.standard_normal((3, 200, 300))
    with pytest.raises(InputError, match="must have more noise at higher levels"):
        fit_photon_transfer(np.rint(frames).astype(np.uint8), BASE)
