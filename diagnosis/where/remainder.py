"""Where the remainder of a gap lies once the reported effects are simulated."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from starling.diagnosis.scenes.observation import SceneObservation, StereoObservation
from starling.diagnosis.scenes.scene_model import SceneModel
from starling.diagnosis.scenes.shelf import Derived, shelve
from starling.diagnosis.scenes.strata import Mask
from starling.diagnosis.where import frames, maps
from starling.diagnosis.where.frames import FixedFrame
from starling.diagnosis.where.maps import CAMERA, GapMap
from starling.sim.effects.effect import Value

Scale = Literal["pixels", "dots", "image"]

_EDGES_PX = (2.0, 16.0)  # Standard deviations of the filters that separate the scales [px].
_ROWS = ("top", "", "bottom")
_COLUMNS = ("left", "", "right")
_LEAST_RATIO = 1.5  # Least ratio of a zone's mean square to that of the whole image.
# Quantities of the maps of each segment; the first one has the zone.
_QUANTITIES = {"image": ("infrared",), "depth": ("holes", "error"), "whole": ("holes", "error")}


@dataclass(frozen=True, kw_only=True, slots=True)
class RemainderPlace:
    """Frame, place and scale of what the reported effects leave."""

    frame: FixedFrame | None  # Frame in which it is fixed; None if it is fixed in none.
    zone: str | None  # Part of the camera image where it is strongest: `top left`.
    scale: Scale | None  # Largest share of its variance beyond noise; None below noise.
    # Of levels, or of holes and disparity: captured minus simulated with the effects. Empty for one
    # room.
    maps: tuple[GapMap, ...] = field(default=(), compare=False)


def remainder_places(
    scenes: Sequence[SceneModel], settings: Mapping[str, Value], segments: Sequence[str]
) -> dict[str, RemainderPlace]:
    """Describe the remainder in each segment; nothing if two captures are compared.

    Args:
        scenes: scenes with captures.
        settings: value by reported effect.
        segments: segments with a remainder: `image`, `depth` or `whole`.
    """
    if not segments or any(scene.against is not None for scene in scenes):
        return {}
    simulated, repeated = (
        shelve(scene.observe(scene.request(settings, seed=seed)) for scene in scenes)
        for seed in (0, 1)
    )
    real = Derived(len(scenes), lambda scene: scenes[scene].real)
    strata = Derived(len(scenes), lambda scene: scenes[scene].strata)
    rooms = [scene.room for scene in scenes]
    gap_maps = maps.gap_maps(simulated, real, strata, rooms) if len(set(rooms)) > 1 else []
    return {
        segment: RemainderPlace(
            frame=frames.segment_frame(gap_maps, segment),
            zone=strongest_zone(gap_maps, _QUANTITIES[segment][0]),
            scale=dominant_scale(
                (
                    (difference(second, first, segment), difference(third, first, segment))
                    for first, second, third in zip(simulated, real, repeated, strict=True)
                ),
                (each.counted for each in strata),
            ),
            maps=tuple(each for each in gap_maps if each.quantity in _QUANTITIES[segment]),
        )
        for segment in segments
    }


def strongest_zone(gap_maps: Sequence[GapMap], quantity: str) -> str | None:
    """Name the ninth of the camera image with the largest mean square; None if none stands out."""
    for gap_map in gap_maps:
        if gap_map.frame == CAMERA and gap_map.quantity == quantity:
            squares = gap_map.mean**2
            zones = {
                f"{row} {column}".strip() or "centre": float(np.nanmean(cells))
                for row, band in zip(_ROWS, np.array_split(squares, 3), strict=True)
                for column, cells in zip(_COLUMNS, np.array_split(band, 3, axis=1), strict=True)
                if np.isfinite(cells).any()
            }
            zone = max(zones, key=zones.__getitem__, default=None)
            if zone is not None and zones[zone] >= _LEAST_RATIO * float(np.nanmean(squares)):
                return zone
    return None


def difference(
    second: SceneObservation, first: SceneObservation, segment: str
) -> NDArray[np.float64]:
    """Return the difference of two observations (h, w): of levels [DN], or of holes."""
    if (
        segment == "image"
        and isinstance(second, StereoObservation)
        and isinstance(first, StereoObservation)
    ):
        return second.left[0].astype(np.float64) - first.left[0]
    holes = [~np.isfinite(observation.depth_px[0]) for observation in (second, first)]
    return holes[0].astype(np.float64) - holes[1]


def dominant_scale(
    pairs: Iterable[tuple[NDArray[np.float64], NDArray[np.float64]]], counted: Iterable[Mask]
) -> Scale | None:
    """Find the scale at which differences exceed noise most.

    Two Gaussian filters divide the variance: detail finer than 2 px, coarser than 16 px, and what
    lies between, the scale of dots.

    Args:
        pairs: difference (h, w) of each scene, and one of noise alone.
        counted: (h, w) pixels that count.
    """
    excess = np.zeros(3)
    for (gap, noise), mask in zip(pairs, counted, strict=True):
        excess += _bands(gap, mask) - _bands(noise, mask)
    if excess.max() <= 0:
        return None
    scales: tuple[Scale, ...] = ("pixels", "dots", "image")
    return scales[int(np.argmax(excess))]


def _bands(values: NDArray[np.float64], counted: Mask) -> NDArray[np.float64]:
    """Return the mean square of fine, middle and coarse parts."""
    filled = np.where(counted, values, 0.0)
    weight = counted.astype(np.float64)
    smooth = [
        ndimage.gaussian_filter(filled, sigma)
        / np.maximum(ndimage.gaussian_filter(weight, sigma), 1e-6)
        for sigma in _EDGES_PX
    ]
    parts = (filled - smooth[0], smooth[0] - smooth[1], smooth[1])
    return np.array([float(np.mean(part[counted] ** 2)) for part in parts])
