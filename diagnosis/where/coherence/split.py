"""Coherence split of a capture set: shares of the infrared power, and of disparity errors."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple, TypeVar

from starling.diagnosis.scenes.observation import SceneObservation, StereoObservation
from starling.diagnosis.scenes.shelf import Derived, shelve
from starling.diagnosis.scenes.strata import Strata
from starling.diagnosis.where.coherence.disparity_shares import disparity_shares
from starling.diagnosis.where.coherence.disparity_split import SIDES, ErrorSpectra, error_spectra
from starling.diagnosis.where.coherence.image_shares import image_shares
from starling.diagnosis.where.coherence.scene_split import SceneSplit, split_scene
from starling.diagnosis.where.coherence.shares import CoherenceSplit

T = TypeVar("T")


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
    scenes = [
        _Scene(number, base, real, scene_strata, pattern_scales) for number in range(len(rooms))
    ]
    images, image_rooms = _shelve_known((_images(scene) for scene in scenes), rooms)
    errors, error_rooms = _shelve_known((_errors(scene) for scene in scenes), rooms)
    bands, by_room = image_shares(images, image_rooms)
    sides = {
        side: disparity_shares(_side(errors, side), error_rooms) for side in SIDES if len(errors)
    }
    return CoherenceSplit(
        images=bands,
        rooms=by_room,
        edges={side: edges for side, (edges, _) in sides.items()},
        disparity={side: shares for side, (_, shares) in sides.items()},
    )


class _Scene(NamedTuple):
    """Number of a scene, and the sequences that hold its parts."""

    number: int
    base: Sequence[SceneObservation]
    real: Sequence[SceneObservation]
    strata: Sequence[Strata]
    pattern_scales: Sequence[float]


def _images(scene: _Scene) -> SceneSplit | None:
    before, after = scene.base[scene.number], scene.real[scene.number]
    if not isinstance(before, StereoObservation) or not isinstance(after, StereoObservation):
        return None
    return split_scene(
        after, before, scene.strata[scene.number], scene.pattern_scales[scene.number]
    )


def _errors(scene: _Scene) -> dict[str, ErrorSpectra] | None:
    number = scene.number
    return error_spectra(scene.real[number], scene.base[number], scene.strata[number])


def _side(errors: Sequence[dict[str, ErrorSpectra]], side: str) -> Sequence[ErrorSpectra]:
    return Derived(len(errors), lambda number: errors[number][side])


def _shelve_known(
    values: Iterable[T | None], rooms: Sequence[str]
) -> tuple[Sequence[T], list[str]]:
    """Move the known values to files as they are computed; return them with their rooms."""
    known_rooms: list[str] = []

    def known() -> Iterator[T]:
        for value, room in zip(values, rooms, strict=True):
            if value is not None:
                known_rooms.append(room)
                yield value

    return shelve(known()), known_rooms
