"""The nominal camera, known to both the check and the diagnosis: `nominal.json`."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.validation.camera import json_file
from starling.diagnosis.validation.camera.errors import refusal

FILE = "nominal.json"
_ANY_SIGN = {"cx_px", "cy_px", "projector_x_m"}
_MAY_BE_ZERO = {
    "ambient_w_m2",
    "ambient_gradient",
    "black_level_dn",
    "read_noise_e",
    "shot_noise",
    "lens_blur_px",
    "lens_halo",
    "lens_disc",
    "smoothing_px",
    "speckle_contrast",
}


@dataclass(frozen=True, kw_only=True, slots=True)
class Nominal:
    """Settings of the camera before any effect. Both imagers share one pinhole model."""

    width: int  # [px]
    height: int  # [px]
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    baseline_m: float
    exposure_s: float
    power_w: float  # Optical power of the projector.
    ambient_w_m2: float
    ambient_gradient: float
    full_well_e: float
    bit_depth: int
    dn_per_e: float  # DN = black_level_dn + gain * dn_per_e * electrons.
    gain: float
    black_level_dn: float
    depth_unit_m: float
    read_noise_e: float
    shot_noise: float  # Standard deviation over that of a Poisson law.
    lens_blur_px: float  # Gaussian sigma of the lens spot.
    projector_x_m: float
    quantum_efficiency: float
    pixel_pitch_m: float
    f_number: float
    wavelength_nm: float
    lens_halo: float = 0.0  # Share of the lens spot's light in a halo; its variance stays.
    lens_disc: float = 0.0  # Share of it in a disc of the same variance.
    smoothing_px: float = 0.0  # Gaussian sigma of the device's averaging of codes.
    speckle_contrast: float = 0.0  # Speckle contrast per pixel before smoothing.
    pattern_px: float = 8.0  # Length of the smooth fixed pattern.
    lens_focus_m: float = 1.0
    projector_focus_m: float = 1.0

    def __post_init__(self) -> None:
        for item in dataclasses.fields(self):
            value = getattr(self, item.name)
            if isinstance(value, bool) or not isinstance(value, int | float):
                raise refusal(item.name, "must be a number", repr(value), f"Correct {FILE}.")
            if not math.isfinite(value):
                raise refusal(item.name, "must be finite", value, f"Correct {FILE}.")
            if item.name in _ANY_SIGN:
                continue
            zero_allowed = item.name in _MAY_BE_ZERO
            if value < 0 if zero_allowed else value <= 0:
                rule = "must be >= 0" if zero_allowed else "must be > 0"
                raise refusal(item.name, rule, value, f"Correct {FILE}.")

    @property
    def shape(self) -> tuple[int, int]:
        """(h, w) of every image."""
        return self.height, self.width

    @property
    def focal_baseline_px_m(self) -> float:
        """Disparity [px] times depth [m]."""
        return self.fx_px * self.baseline_m

    @property
    def half_diagonal_px(self) -> float:
        """Half the image diagonal [px], the unit of radii on the effect pages."""
        return 0.5 * math.hypot(self.width, self.height)

    def tangents(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return x / z and y / z of the rays through the pixel centres, (h, w) each."""
        x = (np.arange(self.width, dtype=np.float64) - self.cx_px) / self.fx_px
        y = (np.arange(self.height, dtype=np.float64) - self.cy_px) / self.fy_px
        across, down = np.meshgrid(x, y)
        return across, down

    def radius(self) -> NDArray[np.float64]:
        """Return the distance from the principal point over half the diagonal, (h, w)."""
        x = np.arange(self.width) - self.cx_px
        y = np.arange(self.height) - self.cy_px
        return np.hypot(x[None, :], y[:, None]) / self.half_diagonal_px


def from_table(table: Mapping[str, Any]) -> Nominal:
    """Build the camera from the table of the file. Unknown keys are ignored.

    Raises:
        WithheldError: if a key is missing or a value is out of range.
    """
    fields = dataclasses.fields(Nominal)
    for item in fields:
        if item.default is dataclasses.MISSING and item.name not in table:
            raise refusal(FILE, f"must have the key {item.name}", sorted(table), "Add it.")
    return Nominal(**{item.name: table[item.name] for item in fields if item.name in table})


def read(path: Path) -> Nominal:
    """Read `nominal.json`.

    Raises:
        WithheldError: if the file is missing or no JSON object, lacks a key or has a value out of
            range.
    """
    return from_table(_table(path))


def read_existing_effects(path: Path) -> frozenset[str]:
    """Read the names of the effects that the camera of a `nominal.json` already has.

    Raises:
        WithheldError: if the file is missing or no JSON object, or the names are no texts.
    """
    names = _table(path).get("has", [])
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise refusal("has", "must be a list of texts", repr(names), f"Correct {FILE}.")
    return frozenset(names)


def _table(path: Path) -> Mapping[str, Any]:
    table = json_file.read(path, FILE)
    if not isinstance(table, dict):
        raise refusal(FILE, "must be one object", path, "Write {...}.")
    return table
