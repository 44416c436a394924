"""From light to charge: crosstalk, photon statistics, noise and full well."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from starling.diagnosis.validation.camera import fixed_pattern
from starling.diagnosis.validation.camera.catalogue import Strengths
from starling.diagnosis.validation.camera.draws import Draws

Image = NDArray[np.float64]


def charge(light_e: Image, strengths: Strengths, side: str, draws: Draws) -> Image:
    """Convert the expected electrons of one exposure to the charge that is read out.

    Args:
        light_e: Expected electrons (h, w), >= 0.
        strengths: Nominal camera and effect strengths.
        side: `left` or `right` imager; each has its own noise.
        draws: Random streams of the scene and frame.

    Returns:
        Charge (h, w) [electrons], at most the full well. Read noise can make it negative.
    """
    charge_e = light_e
    share = strengths.value("prnu")
    if share != 0.0:
        rng = draws.device_rng(f"{side}/prnu")
        charge_e = charge_e * fixed_pattern.sensitivity(charge_e.shape, share, rng)
    charge_e = charge_e + strengths.value("dark_current") * strengths.value("exposure")
    charge_e = share_charge(charge_e, strengths.value("crosstalk"))
    charge_e = count(charge_e, strengths.value("shot_noise"), draws.frame_rng(f"{side}/shot"))
    charge_e = _read(charge_e, strengths, side, draws)
    full_well_e = strengths.value("saturation")
    charge_e = bloom(charge_e, strengths.value("blooming"), full_well_e)
    charge_e = np.minimum(charge_e, full_well_e)
    hot_share = strengths.value("hot_pixels")
    if hot_share != 0.0:
        hot = fixed_pattern.saturated_pixels(
            charge_e.shape, hot_share, draws.device_rng(f"{side}/hot_pixels")
        )
        charge_e = np.where(hot, full_well_e, charge_e)
    return charge_e


def share_charge(light_e: Image, share: float) -> Image:
    """Move a share c of each pixel's electrons to its eight neighbours.

    The kernel is the outer product of (c/4, 1 - c/2, c/4) with itself. Its second moment per axis,
    c/2, and its contrast at the finest period, 1 - c, equal those of the effect page, whose kernel
    has four neighbours.
    """
    if share == 0.0:
        return light_e
    line = np.array([0.25 * share, 1.0 - 0.5 * share, 0.25 * share])
    down = ndimage.convolve1d(light_e, line, 0, mode="nearest")
    return ndimage.convolve1d(down, line, 1, mode="nearest")


def count(light_e: Image, share: float, rng: np.random.Generator) -> Image:
    """Draw electron counts with a variance of share^2 times the mean.

    A share s below 1 models a device that averages 1 / s^2 readings: the count is s^2 times a
    Poisson number of mean light / s^2.
    """
    if share == 0.0:
        return light_e
    return share**2 * rng.poisson(light_e / share**2).astype(np.float64)


def bloom(charge_e: Image, share: float, full_well_e: float) -> Image:
    """Move a share of the charge above the full well along the column, half up and half down.

    Both halves spread at the same time. The result is the mean of both orders, which differ only
    where the two streams meet in one pixel.
    """
    over = np.clip(charge_e - full_well_e, 0.0, None) * (0.5 * share)
    if not over.any():
        return charge_e
    clipped = np.minimum(charge_e, full_well_e)
    down_first = _run_up(_run_down(clipped, over, full_well_e), over, full_well_e)
    up_first = _run_down(_run_up(clipped, over, full_well_e), over, full_well_e)
    return 0.5 * (down_first + up_first)


def _run_down(charge_e: Image, over: Image, full_well_e: float) -> Image:
    charge_e = charge_e.copy()
    carried = np.zeros(charge_e.shape[1])
    for row in range(len(charge_e)):
        absorbed = np.minimum(carried, full_well_e - charge_e[row])
        charge_e[row] += absorbed
        carried = carried - absorbed + over[row]
    return charge_e


def _run_up(charge_e: Image, over: Image, full_well_e: float) -> Image:
    return _run_down(charge_e[::-1], over[::-1], full_well_e)[::-1]


def _read(charge_e: Image, strengths: Strengths, side: str, draws: Draws) -> Image:
    """Add pixel and column offsets, row noise and read noise."""
    charge_e = fixed_pattern.add_offsets(charge_e, strengths, side, draws)
    row_e = strengths.value("row_noise")
    if row_e != 0.0:
        # The sum of two uniform deviates is bounded, as the ripple of a supply voltage is.
        reach = row_e * math.sqrt(1.5)
        rows = draws.frame_rng(f"{side}/row_noise").uniform(-reach, reach, (2, len(charge_e), 1))
        charge_e = charge_e + rows.sum(0)
    read_e = strengths.value("read_noise")
    if read_e != 0.0:
        charge_e = charge_e + read_e * draws.frame_rng(f"{side}/read").standard_normal(
            charge_e.shape
        )
    return charge_e
