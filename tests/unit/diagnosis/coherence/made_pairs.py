"""Pairs whose power has known shares: continuous fields seen by two imagers on slanted walls."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from starling.diagnosis.scenes.observation import StereoObservation
from starling.diagnosis.scenes.strata import Strata, stratify
from starling.sim.captures.info import CaptureInfo

HEIGHT, WIDTH = 224, 384
INFO = CaptureInfo(
    sensor="d435", width=WIDTH, height=HEIGHT, fx_px=300, fy_px=300, cx_px=191.5, cy_px=111.5,
    baseline_m=0.05, depth_unit_m=0.001, source="drawn", licence="none", notes="",
)  # fmt: skip
LEVEL_DN = 64.0
TILE, FINER = 448, 3  # Period of a field [px], and its samples per pixel.
PARALLAX = 0.5  # Displacement of the projector's field per disparity.


@dataclass(frozen=True, kw_only=True)
class Amplitudes:
    """Standard deviation of each part [DN]."""

    explained: float = 0.0
    pattern: float = 0.0
    camera: float = 0.0
    scene: float = 0.0
    imager: float = 0.0
    noise: float = 0.0
    simulated_noise: float = 0.5
    right_gain: float = 1.0

    @property
    def total(self) -> float:
        parts = self.explained, self.pattern, self.camera, self.scene, self.imager, self.noise
        return float(np.sum(np.square(parts)))


@dataclass(frozen=True, kw_only=True)
class Wall:
    """Disparity of a wall [px]: affine in the pixel, so that both views are known exactly."""

    offset_px: float
    slope_x: float = 0.0
    slope_y: float = 0.0

    def disparity(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return self.offset_px + self.slope_x * x + self.slope_y * y

    def left_x(self, right_x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return the left column that sees the point of a right column."""
        return (right_x + self.offset_px + self.slope_y * y) / (1 - self.slope_x)


WALLS = (
    Wall(offset_px=9.0, slope_x=0.02),
    Wall(offset_px=24.3, slope_y=0.03),
    Wall(offset_px=41.0, slope_x=-0.03),
    Wall(offset_px=60.5, slope_x=0.01, slope_y=-0.02),
)


@lru_cache(maxsize=64)
def field(seed: int, shortest_px: float = 3.0, longest_px: float = 12.0) -> np.ndarray:
    """Draw a periodic field of unit power between two periods, with fine samples."""
    size = TILE * FINER
    frequency = np.hypot(
        np.fft.fftfreq(size, 1 / FINER)[:, None], np.fft.rfftfreq(size, 1 / FINER)[None]
    )
    passed = (frequency > 1 / longest_px) & (frequency < 1 / shortest_px)
    noise = np.fft.rfft2(np.random.default_rng(seed).standard_normal((size, size)))
    values = np.fft.irfft2(noise * passed, s=(size, size))
    return (values / values.std()).astype(np.float32)


def at(values: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Sample a field at continuous coordinates."""
    rim = 4
    padded = np.pad(values, rim, mode="wrap")
    columns, rows = ((each % TILE * FINER + rim).astype(np.float32) for each in (x, y))
    return cv2.remap(padded, columns, rows, cv2.INTER_CUBIC)


def strata_of(wall: Wall, *, error_px: float = 0.0) -> Strata:
    """Return the strata of a wall; its reference is wrong by a constant."""
    y, x = np.indices((HEIGHT, WIDTH), np.float64)
    disparity = wall.disparity(x, y)
    projector = np.stack(
        [(x - PARALLAX * disparity - INFO.cx_px) / INFO.fx_px, (y - INFO.cy_px) / INFO.fy_px], -1
    )
    return stratify(
        (disparity + error_px).astype(np.float32),
        np.full((HEIGHT, WIDTH), LEVEL_DN, np.float32),
        INFO,
        body=np.ones((HEIGHT, WIDTH), np.uint32),
        projector=projector.astype(np.float32),
    )


def pair(
    wall: Wall, amplitudes: Amplitudes, *, seed: int, down_px: float = 0.0
) -> tuple[StereoObservation, StereoObservation]:
    """Draw a captured and a simulated pair.

    Args:
        wall: surface.
        amplitudes: of the parts.
        seed: of what changes between rooms.
        down_px: vertical offset of the captured right image.
    """
    y, x = np.indices((HEIGHT, WIDTH), np.float64)
    left = x, y
    below = y + down_px
    right = wall.left_x(x, below), below
    rng = np.random.default_rng(1000 + seed)
    real, base = [], []
    for side, (u, v) in enumerate((left, right)):
        simulated = (wall.left_x(x, y) if side else x), y
        along = u - PARALLAX * wall.disparity(u, v)
        image = (
            amplitudes.explained * at(field(100 + seed), u, v)
            + amplitudes.pattern * at(field(1), along, v)
            + amplitudes.camera * at(field(2), u, v)
            + amplitudes.scene * at(field(200 + seed), u, v)
        ) * (amplitudes.right_gain if side else 1.0)
        image += amplitudes.imager * at(field(3 + side), x, y)
        real.append(_codes(image + amplitudes.noise * band_noise(rng)))
        expected = amplitudes.explained * at(field(100 + seed), *simulated)
        base.append(_codes(expected + amplitudes.simulated_noise * band_noise(rng)))
    return _observation(real), _observation(base)


def band_noise(rng: np.random.Generator) -> np.ndarray:
    """Draw noise of unit power in the periods of `field`."""
    seed = int(rng.integers(10**6)) + 10**6
    y, x = np.indices((HEIGHT, WIDTH), np.float64)
    return at(field.__wrapped__(seed), x, y)


def rooms_of(
    amplitudes: Amplitudes, walls: Sequence[Wall] = WALLS
) -> tuple[list[StereoObservation], list[StereoObservation], list[Strata], list[str], list[float]]:
    """Draw one scene of each of several rooms: base, real, strata, names, pattern scales."""
    pairs = [pair(wall, amplitudes, seed=seed) for seed, wall in enumerate(walls)]
    return (
        [base for _, base in pairs],
        [real for real, _ in pairs],
        [strata_of(wall) for wall in walls],
        [f"room {number}" for number in range(len(walls))],
        [1.0] * len(walls),
    )


def _codes(image: np.ndarray) -> np.ndarray:
    """Write levels as 16-bit codes in steps of 1/256 DN, which quantise without loss."""
    return np.rint(np.clip(image + LEVEL_DN, 0, 255) * 256).astype(np.uint16)


def _observation(images: list[np.ndarray]) -> StereoObservation:
    left, right = (image[None] for image in images)
    empty = np.full(left.shape, np.nan, np.float32)
    return StereoObservation(left=left, right=right, ours_px=empty)
