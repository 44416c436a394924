"""Oracle of the band-pass filter's shift: transfer-matrix computation of a thin-film stack.

Two mirrors of quarter-wave layers, alternating between high and low index, enclose a half-wave
layer and transmit a narrow line. Dispersion and absorption are ignored.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from starling.patterns import errors
from starling.sim.imaging.optics import bandpass
from starling.sim.imaging.optics.bandpass import Spectrum


@dataclass(frozen=True, kw_only=True, slots=True)
class Stack:
    """Thin films between air and a glass substrate."""

    indices: tuple[float, ...]  # From air through the films to the glass.
    thicknesses_nm: tuple[float, ...]  # Thicknesses of the films [nm].


def single_cavity(
    centre_nm: float,
    *,
    high: float = 2.1,
    low: float = 1.46,
    pairs: int = 5,
    high_cavity: bool = True,
    glass: float = 1.52,
) -> Stack:
    """Design a single-cavity filter: air, (H L)^pairs, cavity, (L H)^pairs, glass.

    Args:
        centre_nm: Transmitted wavelength at normal incidence [nm].
        high: Index of H (tantala 2.1, titania 2.3, hydrogenated silicon 3.5).
        low: Index of L (silica 1.46).
        pairs: Layer pairs of each mirror.
        high_cavity: Whether the half-wave layer is H; otherwise it is L, between H layers.
        glass: Index of the substrate.

    Raises:
        InputError: if the centre is not a near-infrared wavelength, `pairs` is outside 1 to 20,
            or `high` is not above `low`.
    """
    bandpass.in_silicon("filter centre", centre_nm)
    errors.in_interval("pairs", pairs, 1, 20)
    errors.in_interval("low", low, 1.0, 5.0)
    errors.in_interval("high", high, low + 0.05, 5.0, "It must exceed the low index.")
    mirror = [high, low] * pairs if high_cavity else [high, low] * (pairs - 1) + [high]
    cavity = high if high_cavity else low
    films = [*mirror, cavity, *mirror[::-1]]
    waves = [0.25] * len(mirror) + [0.5] + [0.25] * len(mirror)
    return Stack(
        indices=(1.0, *films, glass),
        thicknesses_nm=tuple(
            wave * centre_nm / index for wave, index in zip(waves, films, strict=True)
        ),
    )


def transmittance(stack: Stack, wavelength_nm: Spectrum, angle_deg: float) -> Spectrum:
    """Transmittance for unpolarised light by the transfer-matrix method (n,).

    Source: Byrnes, Multilayer optical calculations, arXiv:1603.02720 (colour-science's).
    """
    from colour.phenomena import multilayer_tmm

    _, passed = multilayer_tmm(stack.indices, stack.thicknesses_nm, wavelength_nm, angle_deg)
    return np.asarray(passed, np.float64)[:, 0, 0, :].mean(axis=-1)


def peak_nm(stack: Stack, angle_deg: float, low_nm: float, high_nm: float) -> float:
    """Middle of the band between its half maxima [nm], searched from `low_nm` to `high_nm`.

    The middle is used because the bands of the two polarisations separate at an angle.
    """
    grid = np.arange(low_nm, high_nm, 0.1)
    passed = transmittance(stack, grid, angle_deg)
    above = grid[passed >= passed.max() / 2]
    return float(above[0] + above[-1]) / 2


def fitted_index(angles_deg: Spectrum, peaks_nm: Spectrum, centre_nm: float) -> float:
    """Effective index by least squares of the shift over angles.

    1 - (l / l_0)^2 = sin^2 a / n^2 is a line through the origin in sin^2 a.
    """
    sine2 = np.sin(np.deg2rad(angles_deg)) ** 2
    fall = 1 - (peaks_nm / centre_nm) ** 2
    return float(np.sqrt((sine2 @ sine2) / (sine2 @ fall)))


def first_order_index(*, high: float, low: float, high_cavity: bool) -> float:
    """Effective index of a first-order cavity between many quarter-wave layers.

    sqrt(H L) for a high-index cavity; L / sqrt(1 - L/H + (L/H)^2) for a low-index one.

    Source: Pidgeon and Smith, J. Opt. Soc. Am. 54 (1964) 1459; Macleod, Thin-Film Optical
    Filters, ch. 7.
    """
    ratio = low / high
    return float(np.sqrt(high * low) if high_cavity else low / np.sqrt(1 - ratio + ratio**2))
