"""Wavelengths in nanometres: the grid of all spectra, and a range check."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors

Spectrum = NDArray[np.float64]

SHORTEST_NM, LONGEST_NM = 380.0, 1100.0  # Limits of lenses and of silicon.
GRID_NM: Spectrum = np.linspace(SHORTEST_NM, LONGEST_NM, 1441)  # Every half nanometre.


def in_silicon(name: str, value_nm: float) -> None:
    """Refuse a wavelength outside silicon's range, mostly one in a wrong unit.

    Raises:
        InputError: if `value_nm` is outside 380 to 1100 nm.
    """
    remedy = "Give nanometres."
    if isinstance(value_nm, (int, float)):
        for factor, unit in ((1e3, "micrometres"), (1e9, "metres"), (1e-3, "picometres")):
            if SHORTEST_NM <= value_nm * factor <= LONGEST_NM:
                remedy = f"In nanometres these {unit} are {value_nm * factor:g}."
    errors.in_interval(name, value_nm, SHORTEST_NM, LONGEST_NM, remedy)


def integral(spectrum: Spectrum) -> float:
    """Integrate a spectrum on `GRID_NM` (1441,) over wavelength."""
    return float(np.trapezoid(spectrum, GRID_NM))
