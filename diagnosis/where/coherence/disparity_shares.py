"""Shares of the squared disparity errors over all scenes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.where.coherence import disparity_split
from starling.diagnosis.where.coherence.bootstrap import (
    Table,
    estimates,
    pairs_of_rooms,
    quantities,
    ratio,
    with_total,
)
from starling.diagnosis.where.coherence.disparity_split import DISPARITY_BANDS, ErrorSpectra
from starling.diagnosis.where.coherence.shares import ALL, DisparityShares, Estimate


def disparity_shares(
    scenes: Sequence[ErrorSpectra], rooms: Sequence[str]
) -> tuple[Estimate, tuple[DisparityShares, ...]]:
    """Split the errors of one side.

    Args:
        scenes: at least one.
        rooms: room of each scene.

    Returns:
        The share near depth edges, and the shares on surfaces by band and over all.
    """
    edges = disparity_split.edge_shares(scenes)
    powers = np.stack([scene.powers for scene in scenes])
    predicted = disparity_split.image_shares(scenes, rooms) * powers
    pairs = {
        (first, second): disparity_split.camera_share(scenes[first], scenes[second])
        for first, second in pairs_of_rooms(rooms)
    }

    def pooled(times: NDArray[np.float64]) -> Table:
        power = times @ powers / times.sum()
        whole = with_total(power)
        fixed = disparity_split.pooled_camera_shares(pairs, times) * power
        following = np.maximum(times @ predicted / times.sum(), 0.0)
        camera, image = (ratio(with_total(part), whole) for part in (fixed, following))
        return {
            "rms_px": np.sqrt(whole),
            "camera": camera,
            "image": image,
            "rest": 1 - camera - image,
            "edges": np.array([float(times @ edges / times.sum())]),
        }

    values = estimates(pooled, rooms)
    bands = tuple(
        DisparityShares(
            band=band, **{name: values[name][number] for name in quantities(DisparityShares)}
        )
        for number, band in enumerate((*DISPARITY_BANDS, ALL))
    )
    return values["edges"][0], bands
