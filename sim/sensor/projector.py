"""The infrared pattern projector and its emitters."""

from __future__ import annotations

from dataclasses import dataclass, replace

from starling.patterns import errors

_LONGEST_VISIBLE_NM = 700.0  # Longer wavelengths are infrared [nm].
_MOST_EMITTERS = 16  # Each emitter costs a pass of shadow rays. Dots are not emitters.


@dataclass(frozen=True, kw_only=True, slots=True)
class Emitter:
    """One laser with its optics and pattern, posed in the projector's frame."""

    offset_m: tuple[float, float, float] = (0.0, 0.0, 0.0)  # In the projector's frame [m].
    rotation_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)  # Rotation vector [deg].
    pattern: str = ""  # As `Projector.pattern`, which is used if this is empty.
    power_share: float = 1.0  # Weight of its power; normalised over all emitters.

    def __post_init__(self) -> None:
        name = "projector.emitters"
        errors.vector(f"{name}.offset_m", self.offset_m, -0.5, 0.5, "Give metres.")
        errors.vector(f"{name}.rotation_deg", self.rotation_deg, -360.0, 360.0)
        errors.unicode_text(f"{name}.pattern", self.pattern)
        errors.positive(f"{name}.power_share", self.power_share, "Leave a dark emitter out.")


@dataclass(frozen=True, kw_only=True, slots=True)
class Projector:
    """The infrared pattern projector, posed in the left imager's frame."""

    power_w: float = 0.15  # Mean optical power during exposure [W]; 0 is off (passive stereo).
    # Laser line, or middle of a passive camera's band [nm]. It chooses the scene's reflectances.
    wavelength_nm: float = 850.0
    position_m: tuple[float, float, float] = (0.0, 0.0, 0.0)  # In the left imager's frame [m].
    rotation_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)  # Rotation vector [deg].
    fov_x_deg: float = 90.0  # Full horizontal field [deg].
    fov_y_deg: float = 63.0  # Full vertical field [deg].
    pattern: str = (
        "d435"  # Name of a generator (`GENERATORS` in `sim.render.emission`) or image file.
    )
    emitters: tuple[Emitter, ...] = ()  # Empty: a single one at the projector's position.
    # Direction cosines over those of the nominal pattern. Those of a diffractive element grow with
    # the wavelength.
    pattern_scale: float = 1.0
    pattern_seed: int = 0  # Seed of the generator.
    dot_density: float = (
        1.0  # Dots per solid angle over the generator's default, at equal total power.
    )
    dropped_dots: float = 0.0  # Share of dark dots; their light is lost.
    shifted_dots_mrad: float = 0.0  # Sigma of the dots' displacement on each axis [mrad].
    faults_seed: int = 0  # Seed of the dark dots and displacements, which belong to one device.
    dot_blur_mrad: float = 0.0  # Sigma of an additional blur of the dots [mrad].
    # Sigma [mrad] per |1/z - 1/focus_m| [1/m], z along the projector's axis. For a uniform aperture
    # it is a quarter of the width [mm]. Surfaces closer than 0.1 m count as at 0.1 m.
    defocus_mrad_m: float = 0.0
    focus_m: float = 1.0  # Distance in focus, along the axis [m].
    haze: float = 0.0  # Share of the light that is spread evenly over the field.
    falloff: float = 0.0  # Exponent n of cos^n about the projector's axis; 0 is none.
    speckle_contrast: float = 0.0  # Standard deviation / mean of the speckle in a pixel.
    flicker: float = 0.0  # Standard deviation / mean of the power over frames.

    @property
    def visible(self) -> bool:
        """Whether the wavelength is visible: a passive camera has it, which has no projector."""
        return self.wavelength_nm <= _LONGEST_VISIBLE_NM

    @property
    def faulty(self) -> bool:
        """Whether dots of the pattern are dark or displaced."""
        return self.dropped_dots > 0 or self.shifted_dots_mrad > 0

    def steady(self) -> Projector:
        """Return the projector without speckle and flicker; its mean light is unchanged."""
        return replace(self, speckle_contrast=0.0, flicker=0.0)

    def __post_init__(self) -> None:
        errors.in_interval("projector.power_w", self.power_w, 0.0, 10.0, "Give watts.")
        errors.in_interval(
            "projector.wavelength_nm", self.wavelength_nm, 300.0, 1100.0, "Give nanometres."
        )
        errors.vector("projector.position_m", self.position_m, -4.0, 4.0, "Give metres.")
        errors.vector("projector.rotation_deg", self.rotation_deg, -360.0, 360.0)
        errors.in_interval("projector.fov_x_deg", self.fov_x_deg, 1.0, 150.0)
        errors.in_interval("projector.fov_y_deg", self.fov_y_deg, 1.0, 150.0)
        errors.in_interval(
            "number of projector.emitters",
            len(errors.instance("projector.emitters", self.emitters, tuple, "Give a tuple.")),
            0,
            _MOST_EMITTERS,
            "The dots of one pattern need one.",
        )
        for emitter in self.emitters:
            errors.instance("entry of projector.emitters", emitter, Emitter, "Give Emitters.")
        errors.in_interval(
            "projector.pattern_scale", self.pattern_scale, 0.9, 1.1, "1 is as given."
        )
        errors.in_interval("projector.dot_density", self.dot_density, 0.02, 20.0, "1 is its own.")
        errors.in_interval("projector.dropped_dots", self.dropped_dots, 0.0, 0.99)
        errors.in_interval("projector.shifted_dots_mrad", self.shifted_dots_mrad, 0.0, 100.0)
        errors.whole_number("projector.pattern_seed", self.pattern_seed, 0, 2**63 - 1)
        errors.whole_number("projector.faults_seed", self.faults_seed, 0, 2**31 - 1)
        errors.in_interval("projector.dot_blur_mrad", self.dot_blur_mrad, 0.0, 50.0)
        errors.in_interval("projector.defocus_mrad_m", self.defocus_mrad_m, 0.0, 5.0)
        errors.in_interval("projector.focus_m", self.focus_m, 0.1, 1e4, "Give the distance [m].")
        errors.in_interval("projector.haze", self.haze, 0.0, 1.0, "1 is no dots at all.")
        errors.in_interval("projector.falloff", self.falloff, 0.0, 20.0)
        errors.in_interval(
            "projector.speckle_contrast", self.speckle_contrast, 0.0, 1.0, "1 is one laser mode."
        )
        errors.in_interval("projector.flicker", self.flicker, 0.0, 0.5)
        errors.unicode_text("projector.pattern", self.pattern)
        if not self.pattern:
            raise errors.refuse(
                "projector.pattern", "must name a pattern", "''", "Give a name or an image file."
            )
