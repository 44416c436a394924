"""From light to charge: crosstalk, counting, noise and the full well."""

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
    """Turn expected electrons of one exposure into the charge that is read out.

    Args:
        light_e: Expected electrons (h, w), >= 0.
        strengths: The effects.
        side: `left` or `right`, whose noise differs.
        draws: Random numbers.

    Returns:
        Charge (h, w) [electrons], at most the full well; below 0 by noise alone.
    """
    held = light_e
    share = strengths.of("prnu")
    if share != 0.0:
        rng = draws.of_device(f"{side}/prnu")
        held = held * fixed_pattern.sensitivity(held.shape, share, rng)
    held = held + strengths.of("dark_current") * strengths.of("exposure")
    held = share_charge(held, strengths.of("crosstalk"))
    held = count(held, strengths.of("shot_noise"), draws.of_frame(f"{side}/shot"))
    held = _read(held, strengths, side, draws)
    full_well_e = strengths.of("saturation")
    held = bloom(held, strengths.of("blooming"), full_well_e)
    held = np.minimum(held, full_well_e)
    hot_share = strengths.of("hot_pixels")
    if hot_share != 0.0:
        hot = fixed_pattern.full(held.shape, hot_share, draws.of_device(f"{side}/hot_pixels"))
        held = np.where(hot, full_well_e, held)
    return held


def share_charge(light_e: Image, share: float) -> Image:
    """Let a share of each pixel's electrons end beside it.

    All eight neighbours receive some, as the product of two lines (c/4, 1 - c/2, c/4). Along each
    axis the second moment, c/2, and the contrast at the finest period, 1 - c, are those of the
    page's four neighbours.
    """
    if share == 0.0:
        return light_e
    line = np.array([0.25 * share, 1.0 - 0.5 * share, 0.25 * share])
    down = ndimage.convolve1d(light_e, line, 0, mode="nearest")
    return ndimage.convolve1d(down, line, 1, mode="nearest")


def count(light_e: Image, share: float, rng: np.random.Generator) -> Image:
    """Count electrons one by one: Poisson numbers of variance share^2 times the mean.

    A share s below 1 is a device that averages 1 / s^2 readings: a Poisson number of the mean over
    s^2, times s^2.
    """
    if share == 0.0:
        return light_e
    return share**2 * rng.poisson(light_e / share**2).astype(np.float64)


def bloom(charge_e: Image, share: float, full_well_e: float) -> Image:
    """Let a share of what is above the full well run along the column, half up and half down.

    Both halves run at once; where they meet in a pixel that has not room for both, each gets half
    of what the two orders would give it.
    """
    over = np.clip(charge_e - full_well_e, 0.0, None) * (0.5 * share)
    if not over.any():
        return charge_e
    held = np.minimum(charge_e, full_well_e)
    down_first = _run_up(_run_down(held, over, full_well_e), over, full_well_e)
    up_first = _run_down(_run_up(held, over, full_well_e), over, full_well_e)
    return 0.5 * (down_first + up_first)


def _run_down(held: Image, over: Image, full_well_e: float) -> Image:
    held = held.copy()
    carried = np.zeros(held.shape[1])
    for row in range(len(held)):
        taken = np.minimum(carried, full_well_e - held[row])
        held[row] += taken
        carried = carried - taken + over[row]
    return held


def _run_up(held: Image, over: Image, full_well_e: float) -> Image:
    return _run_down(held[::-1], over[::-1], full_well_e)[::-1]


def _read(held: Image, strengths: Strengths, side: str, draws: Draws) -> Image:
    """Add what reading adds: noise of pixels and rows, offsets of pixels and columns."""
    held = fixed_pattern.add_offsets(held, strengths, side, draws)
    row_e = strengths.of("row_noise")
    if row_e != 0.0:
        # The sum of two even deviates: bounded, as a supply's ripple.
        reach = row_e * math.sqrt(1.5)
        rows = draws.of_frame(f"{side}/row_noise").uniform(-reach, reach, (2, len(held), 1))
        held = held + rows.sum(0)
    read_e = strengths.of("read_noise")
    if read_e != 0.0:
        held = held + read_e * draws.of_frame(f"{side}/read").standard_normal(held.shape)
    return held
