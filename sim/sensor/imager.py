"""One near-infrared imager: lens, alignment after rectification, and electronics."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, get_args

from starling.patterns import errors
from starling.sim.quantities import QUANTITIES

BIT_DEPTHS = (8, 10, 12, 16)
Mosaic = Literal["none", "rggb"]  # Colour filters of the pixels, from the first row and column.
_ABOVE_ZERO = {  # Upper limits of fields > 0; larger values are in a wrong unit.
    "exposure_s": QUANTITIES["exposure_s"].high,
    "auto_exposure_max_s": QUANTITIES["exposure_s"].high,
    "gain": 1e3,
    "pixel_pitch_m": 1e-3,
    "full_well_e": 1e7,
}
_FROM_ZERO = {  # Upper limits of fields that are neutral at 0.
    "auto_exposure_max_gain": 1e3,
    "rolling_shutter_s": 1.0,
    "crosstalk": 0.5,
    "prnu": 0.5,
    "pattern_contrast": 0.5,
    "noise_correlation": 0.9,
    "dark_current_e_s": 1e6,
    "dsnu_e": 1e4,
    "column_noise_e": 1e4,
    "row_noise_e": 1e4,
    "hot_pixels": 0.1,
    "shot_noise": 1.0,
    "read_noise_e": 1e4,
    "blooming": 1.0,
    "smoothing_px": 5.0,
}

SHORTEST_WAVE_DEG = 1.0  # Shortest length of waves.

# Fields that set the exposure of both imagers; the right imager's are not used.
EXPOSURE = (
    *("exposure_s", "auto_exposure_level", "auto_exposure_roi"),
    *("auto_exposure_max_s", "auto_exposure_max_gain"),
)


@dataclass(frozen=True, kw_only=True, slots=True)
class Lens:
    """Lens and band-pass filter. The defaults of all aberrations are neutral."""

    f_number: float = 2.0  # Aperture number.
    transmission: float = 1.0  # Transmission of lens and filter on the axis, at the band centre.
    blur_px: float = 0.0  # Sigma of the spot along each axis [px].
    spot_shape: float = 0.0  # Shape at the same sigma: -1 disc, 0 Gaussian, 1 exponential tails.
    corner_blur_px: float = (
        0.0  # Sigma added in quadrature, linear in the radius, at half the diagonal [px].
    )
    defocus_px_m: float = 0.0  # Sigma [px] per |1/z - 1/focus_m| [1/m]: f^2 / (4 N pitch).
    focus_m: float = 1.0  # Distance in focus [m].
    vignetting: float = (
        0.0  # Exponent n of cos^n of the angle off the axis; natural vignetting has 4.
    )
    filter_width_nm: float = 0.0  # Band-pass, full width at half maximum [nm]; 0 is no filter.
    filter_centre_nm: float = 850.0  # Centre of the band on the axis [nm].
    filter_index: float = 2.0  # Effective index; a larger one shifts less with the angle.
    veil: float = 0.0  # Veiling glare: share of the mean light that is spread over the image.

    def __post_init__(self) -> None:
        errors.positive("lens.f_number", self.f_number)
        errors.in_interval("lens.transmission", self.transmission, 1e-6, 1.0)
        errors.in_interval("lens.blur_px", self.blur_px, 0.0, 20.0)
        errors.in_interval("lens.spot_shape", self.spot_shape, -1.0, 1.0)
        errors.in_interval("lens.corner_blur_px", self.corner_blur_px, 0.0, 20.0)
        errors.in_interval("lens.defocus_px_m", self.defocus_px_m, 0.0, 20.0)
        errors.in_interval("lens.focus_m", self.focus_m, 0.01, 1e4, "Give the distance [m].")
        errors.in_interval("lens.vignetting", self.vignetting, 0.0, 20.0)
        errors.in_interval("lens.filter_width_nm", self.filter_width_nm, 0.0, 500.0)
        errors.in_interval(
            "lens.filter_centre_nm", self.filter_centre_nm, 300.0, 1100.0, "Give nanometres."
        )
        errors.in_interval("lens.filter_index", self.filter_index, 1.0, 5.0)
        errors.in_interval("lens.veil", self.veil, 0.0, 1.0)


@dataclass(frozen=True, kw_only=True, slots=True)
class Alignment:
    """Residual alignment error of an imager after rectification.

    Positive offsets move the image right and down. Angles rotate the imager about its own axes by
    the right-hand rule (OpenCV frame: pitch about x, yaw about y, roll about z). With positive
    angles the imager looks up, looks right, and turns clockwise. Its image then moves down, moves
    left, and turns counter-clockwise.
    """

    offset_x_px: float = 0.0  # [px]
    offset_y_px: float = 0.0  # [px]
    roll_deg: float = 0.0  # [deg]
    pitch_deg: float = 0.0  # [deg]
    yaw_deg: float = 0.0  # [deg]
    magnification: float = 1.0  # Focal length over that of the intrinsics.
    distortion_px: float = 0.0  # Outward shift at half the diagonal, cubic in the radius [px].
    # Rightward shift per cell of an even grid over the image, rows from the top [px]; () is none.
    warp_px: tuple[tuple[float, ...], ...] = ()
    waves_px: float = 0.0  # RMS of a random rightward shift, drawn for each unit [px].
    waves_across_deg: float = 9.0  # Their length along rows [deg].
    waves_down_deg: float = 18.0  # Their length along columns [deg].

    def __post_init__(self) -> None:
        errors.in_interval("alignment.waves_px", self.waves_px, 0.0, 5.0)
        for name in ("waves_across_deg", "waves_down_deg"):
            value = getattr(self, name)
            errors.in_interval(f"alignment.{name}", value, SHORTEST_WAVE_DEG, 180.0)
        for name in ("offset_x_px", "offset_y_px", "distortion_px"):
            errors.in_interval(f"alignment.{name}", getattr(self, name), -50.0, 50.0)
        for name in ("roll_deg", "pitch_deg", "yaw_deg"):
            errors.in_interval(f"alignment.{name}", getattr(self, name), -10.0, 10.0)
        errors.in_interval("alignment.magnification", self.magnification, 0.8, 1.25)
        if len({len(row) for row in self.warp_px}) > 1 or () in self.warp_px:
            lengths = [len(row) for row in self.warp_px]
            raise errors.refuse(
                "alignment.warp_px", "must have rows of one length", lengths, "Give all cells."
            )
        for row in self.warp_px:
            for value in row:
                errors.in_interval("alignment.warp_px", value, -50.0, 50.0)


@dataclass(frozen=True, kw_only=True, slots=True)
class Imager:
    """One near-infrared imager, linear below saturation (EMVA 1288 model)."""

    lens: Lens = field(default_factory=Lens)
    alignment: Alignment = field(default_factory=Alignment)
    exposure_s: float = 8.5e-3  # Integration time with auto exposure off [s].
    gain: float = 1.0  # Analog gain, times the base conversion.
    auto_exposure_level: float = 0.0  # Auto exposure target: mean signal over full scale; 0 is off.
    auto_exposure_roi: float = 1.0  # Share of rows and columns, in the middle, that it meters.
    auto_exposure_max_s: float = 33e-3  # Longest exposure time of auto exposure [s].
    auto_exposure_max_gain: float = 0.0  # Highest gain at the longest exposure; 0 keeps the gain.
    rolling_shutter_s: float = 0.0  # Delay from the first to the last row [s]; 0 is global.
    quantum_efficiency: float = 1.0  # Electrons per photon at the laser's wavelength.
    pixel_pitch_m: float = 3.0e-6  # Side of a pixel's light-collecting square [m].
    full_well_e: float = 1.0e4  # Electrons that fill the scale at gain 1.
    crosstalk: float = 0.0  # Share of a pixel's charge that ends in its four neighbours.
    prnu: float = 0.0  # Standard deviation / mean of the pixels' sensitivities; fixed.
    pattern_contrast: float = 0.0  # Standard deviation / mean of a smooth sensitivity; fixed.
    pattern_px: float = 8.0  # Its length: the correlation falls to 1/e [px].
    noise_correlation: float = 0.0  # Of the temporal noise of adjacent pixels.
    dark_current_e_s: float = 0.0  # Mean dark current [electrons/s].
    dsnu_e: float = 0.0  # Standard deviation of the pixels' offsets [electrons]; fixed.
    column_noise_e: float = 0.0  # Standard deviation of the columns' offsets [electrons]; fixed.
    row_noise_e: float = 0.0  # Standard deviation of the rows' offsets [electrons]; new per frame.
    hot_pixels: float = 0.0  # Share of pixels that are always full; fixed.
    shot_noise: float = 0.0  # Share of the Poisson deviation: 0 none, 1 physical.
    read_noise_e: float = 0.0  # RMS at the pixel [electrons].
    mosaic: Mosaic = "none"  # Colour filters; the image is then the colours' luminance.
    blooming: float = 0.0  # Share of the charge above the full well that spills along the column.
    smoothing_px: float = 0.0  # Sigma of the blur by the device's resampling [px].
    gamma: float = 1.0  # Level = ceiling (signal / ceiling)^(1 / gamma) + black level.
    black_level_dn: float = 0.0  # Pedestal [DN].
    bit_depth: int = 16  # Bits of the output images; DN are their codes.
    dropped_bits: int = 0  # Finer bits of the converter, which only the matcher reads.

    def __post_init__(self) -> None:
        for name, high in _ABOVE_ZERO.items():
            errors.positive(f"imager.{name}", getattr(self, name))
            errors.in_interval(f"imager.{name}", getattr(self, name), 0.0, high)
        errors.in_interval("imager.quantum_efficiency", self.quantum_efficiency, 1e-6, 1.0)
        errors.in_interval("imager.auto_exposure_level", self.auto_exposure_level, 0.0, 0.9)
        errors.in_interval("imager.auto_exposure_roi", self.auto_exposure_roi, 0.05, 1.0)
        for name, high in _FROM_ZERO.items():
            errors.in_interval(f"imager.{name}", getattr(self, name), 0.0, high)
        errors.in_interval("imager.pattern_px", self.pattern_px, 0.1, 500.0)
        errors.in_interval("imager.gamma", self.gamma, 0.2, 5.0)
        errors.one_of("imager.mosaic", self.mosaic, get_args(Mosaic))
        if self.bit_depth not in BIT_DEPTHS:
            raise errors.refuse(
                "imager.bit_depth",
                "must be 8, 10, 12 or 16",
                repr(self.bit_depth),
                "Real depth cameras have 8 or 10.",
            )
        errors.whole_number("imager.dropped_bits", self.dropped_bits, 0, 8)
        errors.in_interval("imager.black_level_dn", self.black_level_dn, 0.0, self.ceiling_dn / 2)

    @property
    def ceiling_dn(self) -> int:
        """Highest output code [DN]."""
        return 2**self.bit_depth - 1

    @property
    def matched_bits(self) -> int:
        """Bits of the converter, which the matcher reads; at most 16."""
        return min(self.bit_depth + self.dropped_bits, 16)

    @property
    def saturation_dn(self) -> int:
        """Code of a full pixel [DN]: the ceiling, or less at a gain below 1."""
        share = self.gain ** (1 / self.gamma)
        return min(self.ceiling_dn, round(self.ceiling_dn * share + self.black_level_dn))

    @property
    def dn_per_electron(self) -> float:
        """Conversion at this gain [DN / electron]."""
        return self.gain * self.ceiling_dn / self.full_well_e
