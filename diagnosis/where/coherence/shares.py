"""Results of the coherence split."""

from __future__ import annotations

from dataclasses import dataclass, field

Estimate = tuple[float, float | None, float | None]  # Value and interval; none with few rooms.

ALL = "all"  # Band of all periods.


@dataclass(frozen=True, kw_only=True, slots=True)
class ImageShares:
    """Shares of the real images' power in one band; those from `explained` to `noise` sum to 1."""

    band: str
    power: Estimate  # Share of the band in all power.
    explained: Estimate  # By the simulation.
    pattern: Estimate  # On surfaces; repeats between rooms in the projector's field.
    camera: Estimate  # On surfaces; repeats in the camera image.
    scene: Estimate  # On surfaces; repeats in neither frame.
    unseparated: Estimate  # On surfaces; rooms differ too little in depth to compare frames.
    imager: Estimate  # In a single imager; repeats in its image.
    noise: Estimate  # In a single imager; does not repeat.
    coherent: Estimate  # Of the unexplained power, what lies on surfaces.
    gain: Estimate  # Real over simulated amplitude.
    simulated_noise: Estimate  # Share of single imagers in the simulated power.
    noise_ratio: Estimate  # Power of single imagers, simulated over real.


@dataclass(frozen=True, kw_only=True, slots=True)
class RoomShares:
    """The same shares over all periods of one room."""

    windows: int
    shift_px: tuple[float, float]  # Right image against the reference, right and down.
    explained: float
    pattern: float
    camera: float
    scene: float
    unseparated: float
    imager: float
    noise: float
    coherent: float
    noise_ratio: float


@dataclass(frozen=True, kw_only=True, slots=True)
class DisparityShares:
    """Shares of the squared disparity errors on surfaces in one band; the three sum to 1."""

    band: str
    rms_px: Estimate
    camera: Estimate  # Repeats between rooms in the camera image.
    image: Estimate  # Follows the image by a filter that other rooms share.
    rest: Estimate


@dataclass(frozen=True, kw_only=True, slots=True)
class CoherenceSplit:
    """Parts of image and disparity by what they move with."""

    images: tuple[ImageShares, ...] = ()  # By band, then of all periods; empty without infrared.
    rooms: dict[str, RoomShares] = field(default_factory=dict)
    # By side (real, simulated, gap): share of squared disparity errors near depth edges.
    edges: dict[str, Estimate] = field(default_factory=dict)
    disparity: dict[str, tuple[DisparityShares, ...]] = field(default_factory=dict)  # By side.
