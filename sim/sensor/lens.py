"""The lens of an imager, and its alignment error after rectification."""

from __future__ import annotations

from dataclasses import dataclass

from starling.patterns import errors


@dataclass(frozen=True, kw_only=True, slots=True)
class Lens:
    """Lens and band-pass filter. The defaults of all aberrations are neutral."""

    f_number: float = 2.0  # Aperture number.
    transmission: float = 1.0  # Transmission of lens and filter on the axis, at the band centre.
    blur_px: float = 0.0  # Sigma of the Gaussian spot [px].
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

    def __post_init__(self) -> None:
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
