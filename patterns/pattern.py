"""A pattern: the relative irradiance of a projector on a plane, and its dots."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from starling.patterns.dots import check_dots, draw
from starling.patterns.errors import in_interval, instance, numbers, positive, refuse
from starling.patterns.field import SMALLEST_SIDE_PX, Field


@dataclass(frozen=True, kw_only=True, eq=False)
class Pattern:
    """A projected pattern, as a pinhole image on the plane at unit distance.

    The image includes the projection onto the plane: off the axis, dots of equal power are
    larger, sparser and dimmer.

    Args:
        image: (h, w) float32 >= 0, mean 1, made read-only: relative irradiance on the plane
            perpendicular to the projector's axis, x right, y down. Build from any scale with
            `Pattern.from_image`.
        fov_x_deg: Full horizontal field of view [deg] that the image spans.
        fov_y_deg: Full vertical field of view [deg].
        name: Kind and origin of the pattern.
        dots: Optional (n, 3) float64, read-only: x [px], y [px], relative power of each spot.
        fwhm_mrad: Optional full width at half maximum of a spot [mrad].
        background: Optional share of the light that is not in dots, in [0, 1].

    Raises:
        InputError: if the image violates these rules, or a field of view is out of range.
    """

    image: np.ndarray
    fov_x_deg: float
    fov_y_deg: float
    name: str
    dots: np.ndarray | None = None
    fwhm_mrad: float | None = None
    background: float | None = None

    def __post_init__(self) -> None:
        Field(self.fov_x_deg, self.fov_y_deg)
        instance("name", self.name, str, "Give kind and origin of the pattern.")
        image = check_image(self.image)
        mean = float(image.mean(dtype=np.float64))
        if image.dtype != np.float32 or abs(mean - 1) > 1e-4:
            raise refuse(
                "image",
                "must be float32 with mean 1",
                f"{image.dtype}, mean {mean:.4g}",
                "Use Pattern.from_image, which normalises.",
            )
        self._store("image", image)
        if self.dots is not None:
            if self.fwhm_mrad is None or self.background is None:
                value = f"{self.fwhm_mrad}, {self.background}"
                raise refuse("fwhm_mrad and background", "must come with dots", value, "Give both.")
            positive("fwhm_mrad", self.fwhm_mrad, "Give the spot's full width at half maximum.")
            in_interval("background", self.background, 0.0, 1.0, "Give the light not in dots.")
            self._store("dots", check_dots(self.dots))

    def _store(self, name: str, array: np.ndarray) -> None:
        """Store a read-only copy, so that later writes do not change the pattern."""
        array = np.array(array)
        array.flags.writeable = False
        object.__setattr__(self, name, array)

    @classmethod
    def from_image(
        cls, image: np.ndarray, *, fov_x_deg: float, fov_y_deg: float, name: str
    ) -> Pattern:
        """Build a pattern from a linear irradiance image (h, w) of any scale.

        Raises:
            InputError: if the image is not 2-D, too small, negative, not finite or all zero.
        """
        image = check_image(image).astype(np.float64)
        return cls(
            image=(image / image.mean()).astype(np.float32),
            fov_x_deg=fov_x_deg,
            fov_y_deg=fov_y_deg,
            name=name,
        )

    @classmethod
    def from_dots(
        cls,
        x: np.ndarray,
        y: np.ndarray,
        power: np.ndarray,
        *,
        field: Field,
        width_px: int,
        fwhm_mrad: float,
        background: float,
        name: str,
    ) -> Pattern:
        """Build a pattern from dots; dots centred outside the field are dropped.

        Args:
            x: (n,) tangents x/z of the dots' directions.
            y: (n,) tangents y/z.
            power: (n,) relative power of each dot.
            field: Field of view.
            width_px: Image width [px]; the height follows with square pixels.
            fwhm_mrad: Spot width [mrad].
            background: Share of the light that is spread evenly over the plane, in [0, 0.99].
            name: Kind and origin of the pattern.

        Raises:
            InputError: if a parameter is out of range or no dot falls inside the field.
        """
        in_interval("background", background, 0.0, 0.99, "Give the share of light not in dots.")
        shape = instance("field", field, Field, "Give a Field.").shape(width_px)
        x, y, power = (
            numbers(name, values).astype(np.float64)
            for name, values in (("x", x), ("y", y), ("power", power))
        )
        if x.ndim != 1 or not x.shape == y.shape == power.shape:
            rule, got = "must be (n,), of one length", f"{x.shape}, {y.shape}, {power.shape}"
            raise refuse("x, y and power", rule, got, "Give one number for each dot.")
        x_px, y_px = field.pixels(x, y, shape)
        dots = check_dots(np.stack([x_px, y_px, power], axis=1))[field.holds(x, y)]
        if not dots[:, 2].any():
            raise refuse(
                "pattern", "must hold a dot with power", "none", "Raise the density or the field."
            )
        light = draw(dots, shape, field, fwhm_mrad)
        image = background + (1 - background) * light / light.mean()
        return cls(
            image=image.astype(np.float32),
            fov_x_deg=field.fov_x_deg,
            fov_y_deg=field.fov_y_deg,
            name=name,
            dots=dots,
            fwhm_mrad=fwhm_mrad,
            background=background,
        )

    @property
    def field(self) -> Field:
        """The field of view with its conversions."""
        return Field(self.fov_x_deg, self.fov_y_deg)

    @property
    def shape(self) -> tuple[int, int]:
        """Image shape (h, w)."""
        return self.image.shape[0], self.image.shape[1]

    def irradiance_w_m2(self, power_w: float, depth_m: float = 1.0) -> np.ndarray:
        """Irradiance [W/m^2] (h, w) of `power_w` of light on a plane at `depth_m`.

        Raises:
            InputError: if power or depth is outside [1e-6, 1e6].
        """
        in_interval("power_w", power_w, 1e-6, 1e6, "Give the projector's optical power in watts.")
        in_interval("depth_m", depth_m, 1e-6, 1e6, "Give the plane's depth in metres.")
        return self.image * np.float32(power_w / (self.field.area_m2 * depth_m**2))

    def __eq__(self, other: object) -> bool:
        """Compare all fields, arrays element by element."""
        if not isinstance(other, Pattern):
            return NotImplemented
        return self._scalars() == other._scalars() and all(
            (a is None and b is None) or (a is not None and b is not None and np.array_equal(a, b))
            for a, b in ((self.image, other.image), (self.dots, other.dots))
        )

    def __hash__(self) -> int:
        return hash(self._scalars())

    def _scalars(self) -> tuple[object, ...]:
        angles = self.fov_x_deg, self.fov_y_deg
        return (self.name, *angles, self.fwhm_mrad, self.background, self.shape)


def check_image(image: np.ndarray) -> np.ndarray:
    """Check an irradiance image and return it as an array.

    Raises:
        InputError: if it is not 2-D, smaller than 32x32, not real, negative, not finite or all
            zero.
    """
    image = numbers("image", image)
    if image.ndim != 2 or min(image.shape) < SMALLEST_SIDE_PX:
        raise refuse(
            "image",
            f"must be (h, w) with both sides >= {SMALLEST_SIDE_PX}",
            image.shape,
            "Give one grey channel at the projector's resolution.",
        )
    low, high = float(image.min()), float(image.max())
    if not (np.isfinite(low) and np.isfinite(high)) or low < 0 or high == 0:
        raise refuse(
            "image",
            "must be finite, >= 0 and not all zero",
            f"values in [{low:g}, {high:g}]",
            "Give linear irradiance.",
        )
    return image
