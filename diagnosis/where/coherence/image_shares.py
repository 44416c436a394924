"""Shares of the infrared power over all scenes, with what rooms have in common."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.where.coherence.bootstrap import (
    Table,
    estimates,
    pairs_of_rooms,
    quantities,
    ratio,
    with_total,
)
from starling.diagnosis.where.coherence.image_split import ScenePowers
from starling.diagnosis.where.coherence.repeats import Patterns, frame_repeats, separate
from starling.diagnosis.where.coherence.scene_split import SceneSplit
from starling.diagnosis.where.coherence.shares import ALL, ImageShares, RoomShares
from starling.diagnosis.where.coherence.spectra import BANDS


def image_shares(
    scenes: Sequence[SceneSplit], rooms: Sequence[str]
) -> tuple[tuple[ImageShares, ...], dict[str, RoomShares]]:
    """Pool the splits of scenes by band, and over all bands by room.

    Args:
        scenes: splits of the scenes.
        rooms: room of each scene.
    """
    if not len(scenes):
        return (), {}
    pairs = pairs_of_rooms(rooms)
    repeats = []
    for first, second in pairs:
        left, right = scenes[first].spectra, scenes[second].spectra
        repeats.append(
            (
                frame_repeats(left.camera, right.camera),
                frame_repeats(left.projector, right.projector),
            )
        )
    camera, projector = ([pair[frame] for pair in repeats] for frame in (0, 1))
    summaries = [(scene.powers, scene.shift_px) for scene in scenes]
    powers = [each for each, _ in summaries]

    def patterns(weights: NDArray[np.float64]) -> Patterns | None:
        return separate(camera, projector, weights) if weights.any() else None

    complete = patterns(np.ones(len(pairs)))
    apart = np.zeros(len(BANDS), bool) if complete is None else complete.separable

    def pooled(times: NDArray[np.float64]) -> Table:
        weights = np.array([times[first] * times[second] for first, second in pairs])
        return _table(powers, times, patterns(weights), apart)

    values = estimates(pooled, rooms)
    shares = tuple(
        ImageShares(band=band, **{name: values[name][number] for name in quantities(ImageShares)})
        for number, band in enumerate((*(band.name for band in BANDS), ALL))
    )
    by_room = {}
    for room in dict.fromkeys(rooms):
        members = np.array([float(name == room) for name in rooms])
        weights = np.array([float(members[first] != members[second]) for first, second in pairs])
        table = _table(powers, members, patterns(weights), apart)
        chosen = [each for each, member in zip(summaries, members, strict=True) if member]
        by_room[room] = RoomShares(
            windows=sum(each.windows for each, _ in chosen),
            shift_px=chosen[0][1],
            **{name: float(table[name][-1]) for name in quantities(RoomShares) if name in table},
        )
    return shares, by_room


def _table(
    powers: Sequence[ScenePowers],
    times: NDArray[np.float64],
    patterns: Patterns | None,
    apart: NDArray[np.bool_],
) -> Table:
    """Compute all shares by band and over all; each scene counts by its relative power.

    Args:
        powers: of the scenes.
        times: (scenes,) weight of each scene.
        patterns: what rooms have in common; None without two rooms.
        apart: (bands,) whether the frames can be separated.
    """

    def mean(name: str) -> NDArray[np.float64]:
        relative = [getattr(power, name) / power.total.sum() for power in powers]
        return times @ np.stack(relative) / times.sum()

    total, coherent, alone = mean("total"), mean("coherent"), mean("incoherent")
    simulated_alone = mean("simulated_incoherent")
    shares = np.zeros((3, len(total)))
    if patterns is not None:
        shares = np.nan_to_num(
            np.stack([patterns.projector, patterns.camera, patterns.imager]) * (coherent + alone)
        )
    pattern, fixed = np.where(apart, shares[:2], 0.0)
    parts = {
        "explained": mean("explained"),
        "pattern": pattern,
        "camera": fixed,
        "scene": np.where(apart, coherent - pattern - fixed, 0.0),
        "unseparated": np.where(apart, 0.0, coherent),
        "imager": shares[2],
        "noise": alone - shares[2],
    }
    whole = with_total(total)
    gains = [np.sqrt(np.maximum(power.gain[0] * power.gain[1], 0)) for power in powers]
    gain = times @ np.stack(gains) / times.sum()
    return {
        "power": whole / whole[-1],
        **{name: ratio(with_total(part), whole) for name, part in parts.items()},
        "coherent": ratio(with_total(coherent), with_total(coherent + alone)),
        "gain": np.append(gain, float(gain @ total / total.sum())),
        "simulated_noise": ratio(with_total(simulated_alone), with_total(mean("simulated_total"))),
        "noise_ratio": ratio(with_total(simulated_alone), with_total(alone)),
    }
