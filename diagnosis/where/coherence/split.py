"""Coherence split of a capture set: shares of the infrared power, and of disparity errors."""

from __future__ import annotations

from collections.abc import Sequence

from starling.diagnosis.scenes.observation import SceneObservation, StereoObservation
from starling.diagnosis.scenes.strata import Strata
from starling.diagnosis.where.coherence.disparity_shares import disparity_shares
from starling.diagnosis.where.coherence.disparity_split import SIDES, error_spectra
from starling.diagnosis.where.coherence.image_shares import image_shares
from starling.diagnosis.where.coherence.scene_split import split_scene
from starling.diagnosis.where.coherence.shares import CoherenceSplit


def coherence_split(
    base: Sequence[SceneObservation],
    real: Sequence[SceneObservation],
    scene_strata: Sequence[Strata],
    rooms: Sequence[str],
    pattern_scales: Sequence[float],
) -> CoherenceSplit:
    """Split images and disparity errors of all scenes.

    Args:
        base: simulated observations, or other captures of the scenes.
        real: captured observations.
        scene_strata: pixel strata of each scene.
        rooms: room of each scene.
        pattern_scales: pattern scale fitted to each scene.
    """
    images, image_rooms, errors, error_rooms = [], [], [], []
    scenes = zip(base, real, scene_strata, rooms, strict=True)
    for number, (before, after, strata, room) in enumerate(scenes):
        if isinstance(before, StereoObservation) and isinstance(after, StereoObservation):
            split = split_scene(after, before, strata, pattern_scales[number])
            if split is not None:
                images.append(split)
                image_rooms.append(room)
        spectra = error_spectra(after, before, strata)
        if spectra is not None:
            errors.append(spectra)
            error_rooms.append(room)
    bands, by_room = image_shares(images, image_rooms)
    sides = {
        side: disparity_shares([spectra[side] for spectra in errors], error_rooms)
        for side in SIDES
        if errors
    }
    return CoherenceSplit(
        images=bands,
        rooms=by_room,
        edges={side: edges for side, (edges, _) in sides.items()},
        disparity={side: shares for side, (_, shares) in sides.items()},
    )
