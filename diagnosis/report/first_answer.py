"""Sentences known before any effect is tried: the stage ablation and the coherence split."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from starling.diagnosis.report.words import SideNames, side_names
from starling.diagnosis.scenes.observation import SceneObservation, StereoObservation
from starling.diagnosis.scenes.scene_model import SceneModel
from starling.diagnosis.where.coherence.image_split import ScenePowers
from starling.diagnosis.where.coherence.scene_split import split_scene
from starling.diagnosis.where.coherence.shares import (
    ALL,
    CoherenceSplit,
    DisparityShares,
    Estimate,
    ImageShares,
)
from starling.diagnosis.where.location import GapLocation
from starling.sim.console.progress import Note

_ANNOUNCED = 4  # Scenes; the pooled split follows those of the first ones.


def first_answer(location: GapLocation, against: str | None) -> list[str]:
    """Return all sentences, each of at most 25 words.

    Args:
        location: location of the gap.
        against: capture set that is compared; None for comparison with simulation.
    """
    return [*coherence_sentences(location.coherence, against), *stage_sentences(location)]


def announcement(note: Note, against: str | None) -> Callable[[SceneModel], None]:
    """Return a function that notes the split of each of the first scenes as it is loaded.

    Args:
        note: takes the sentence.
        against: capture set that is compared; None for comparison with simulation.
    """
    names: list[str] = []

    def announce(model: SceneModel) -> None:
        names.append(model.name)
        if len(names) <= _ANNOUNCED:
            base = model.against or model.observe(model.request({}, seed=0))
            powers = scene_powers(base, model)
            if powers is not None:
                note(_room(model.name, powers, side_names(against)))

    return announce


def scene_powers(base: SceneObservation, model: SceneModel) -> ScenePowers | None:
    """Split the images of one scene; None without pairs, or with too few windows."""
    if not isinstance(base, StereoObservation) or not isinstance(model.real, StereoObservation):
        return None
    split = split_scene(model.real, base, model.strata, model.sensor.projector.pattern_scale)
    return None if split is None else split.powers


def _room(name: str, powers: ScenePowers, sides: SideNames) -> str:
    total, explained, coherent, alone, simulated = (
        float(each.sum())
        for each in (
            powers.total,
            powers.explained,
            powers.coherent,
            powers.incoherent,
            powers.simulated_incoherent,
        )
    )
    return (
        f"{name}: {sides.have[1]} explain {_rounded(explained / total)} of the image power; of the "
        f"rest, both imagers see {_rounded(coherent / (total - explained))}; noise ratio "
        f"{simulated / alone:.2f}."
    )


def stage_sentences(location: GapLocation) -> list[str]:
    """Divide the difference in pixels without depth between images and matcher."""
    part = location.parts["ndp_rate"]
    if part.image_share is None or part.image is None or part.matcher is None:
        return []
    images, matcher = (100 * change[0] for change in (part.image, part.matcher))
    return [
        f"The share of pixels without depth differs by {images + matcher:+.1f} points: "
        f"{images:+.1f} from images, {matcher:+.1f} from matcher and filters."
    ]


def coherence_sentences(split: CoherenceSplit, against: str | None) -> list[str]:
    """Describe which parts of image and disparity the simulation lacks."""
    sides = side_names(against)
    return [*_images(split.images, sides), *_disparity(split)]


def whole(shares: tuple[ImageShares, ...]) -> ImageShares | None:
    """Return the shares over all periods."""
    return next((each for each in shares if each.band == ALL), None)


def _images(shares: tuple[ImageShares, ...], sides: SideNames) -> Iterator[str]:
    total = whole(shares)
    if total is None:
        return
    first, second = sides.have
    yield (
        f"On surfaces, {second} explain {percent(total.explained)} of the image power of {first}."
    )
    rest = 1 - total.explained[0]
    if rest <= 0:
        return
    pattern, camera, scene = (
        _rounded(part[0] / rest) for part in (total.pattern, total.camera, total.scene)
    )
    yield f"Of the unexplained power, {percent(total.coherent)} is common to both imagers."
    if total.unseparated[0] <= 0.5 * total.coherent[0] * rest:
        yield (
            f"Between rooms, {pattern} of the unexplained power repeats in the projector field, "
            f"{camera} in the camera image, {scene} in neither: texture, light."
        )
    largest = max(shares, key=_unexplained)
    yield f"Most unexplained power has periods of {largest.band}."
    ratio = total.noise_ratio
    ends = _ends(ratio, 1, ".2f")
    yield (
        f"The power of single imagers, mostly noise, is {ratio[0]:.2f} times as large in {second}"
        f"{ends}."
    )


def _unexplained(shares: ImageShares) -> float:
    """Return the unexplained power of a band; 0 for all bands together."""
    return 0.0 if shares.band == ALL else shares.power[0] * (1 - shares.explained[0])


def _disparity(split: CoherenceSplit) -> Iterator[str]:
    shares: tuple[DisparityShares, ...] = split.disparity.get("gap", ())
    total = next((each for each in shares if each.band == ALL), None)
    if total is None:
        return
    yield f"Of the squared disparity gap, {percent(split.edges['gap'])} lies near depth edges."
    yield (
        f"On surfaces, {_rounded(total.camera[0])} of it repeats in the camera image, "
        f"{_rounded(total.image[0])} follows the image."
    )


def percent(share: Estimate) -> str:
    """Write a share with its interval: `55 % (95 %: 31 to 84)`."""
    return f"{_rounded(share[0])}{_ends(share, 100, '.0f')}"


def _ends(share: Estimate, scale: float, digits: str) -> str:
    _, low, high = share
    if low is None or high is None:
        return ""
    return f" (95 %: {max(scale * low, 0):{digits}} to {scale * high:{digits}})"


def _rounded(share: float) -> str:
    return f"{max(100 * share, 0):.0f} %"
