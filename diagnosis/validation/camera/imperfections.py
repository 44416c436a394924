"""Imperfections of a base: how the captured world differs from it, apart from any effect.

The diagnosis has a base without them. A strength of 0 is no imperfection.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from starling.diagnosis.validation.camera import sky, texture
from starling.diagnosis.validation.camera.catalogue import Strengths
from starling.diagnosis.validation.camera.draws import Draws
from starling.diagnosis.validation.camera.errors import refusal
from starling.diagnosis.validation.camera.light import SceneLight
from starling.diagnosis.validation.camera.nominal import Nominal

OCCLUDED_SKY, DISC_SPOT, TAILED_SPOT = "occluded_sky", "disc_spot", "tailed_spot"
TEXTURE, EXPOSURE, OTHER_MATCHER = "texture", "exposure", "other_matcher"
SPOTS = (DISC_SPOT, TAILED_SPOT)  # A lens has at most one of them.


@dataclass(frozen=True, kw_only=True, slots=True)
class Imperfection:
    """Range of one imperfection's strength, and what names it.

    Strengths are drawn uniformly.
    """

    least: float
    most: float
    rows: tuple[str, ...]  # Effects of the diagnosis' table that truly name it.


IMPERFECTIONS = {
    # Reach of the blocking surfaces [m].
    OCCLUDED_SKY: Imperfection(least=0.15, most=0.5, rows=("ambient_occlusion",)),
    # Share of the lens spot's light in a disc, or in a halo.
    DISC_SPOT: Imperfection(least=0.6, most=1.0, rows=("spot_shape",)),
    TAILED_SPOT: Imperfection(least=0.1, most=0.3, rows=("spot_shape",)),
    # Deviation over mean of the reflectance.
    TEXTURE: Imperfection(least=0.05, most=0.2, rows=("texture",)),
    # Largest logarithm of a factor that differs by scene; no effect of a device is its name.
    EXPOSURE: Imperfection(least=0.1, most=0.4, rows=()),
    # 1: depth by the second matcher. It differs in structure, so no effect is its name.
    OTHER_MATCHER: Imperfection(least=1.0, most=1.0, rows=()),
}


def check(strengths: Mapping[str, float]) -> None:
    """Check the strengths of imperfections.

    Raises:
        WithheldError: for an unknown name, a strength outside 0 to 1, or two lens spots.
    """
    for name, value in strengths.items():
        if name not in IMPERFECTIONS:
            advice = f"Give some of {list(IMPERFECTIONS)}."
            raise refusal("imperfection", "must be a known one", name, advice)
        if not 0.0 <= value <= 1.0:
            raise refusal(name, "must be 0 to 1", value, "Give a strength in this range.")
    spots = [name for name in SPOTS if strengths.get(name, 0.0) > 0.0]
    if len(spots) > 1:
        raise refusal("lens spot", "must have one shape", spots, "Give one of them.")


def with_spot(camera: Nominal, imperfections: Mapping[str, float]) -> Nominal:
    """Return the camera with another lens spot of the same variance."""
    halo = imperfections.get(TAILED_SPOT, 0.0)
    disc = imperfections.get(DISC_SPOT, 0.0)
    return dataclasses.replace(camera, lens_halo=halo, lens_disc=disc) if halo or disc else camera


def on_surfaces(
    scene: SceneLight, camera: Nominal, imperfections: Mapping[str, float], draws: Draws
) -> SceneLight:
    """Return the light of a scene with occluded ambient light and textured surfaces."""
    scene = sky.occlude(scene, camera, imperfections.get(OCCLUDED_SKY, 0.0))
    return texture.apply(scene, camera, imperfections.get(TEXTURE, 0.0), draws)


def exposure_factors(
    scenes: Sequence[str], imperfections: Mapping[str, float], seed: int
) -> dict[str, float]:
    """Return the factor on the exposure time of each scene.

    Logarithms are uniform within the strength of the imperfection, before their mean is removed. A
    common factor would be the effect `exposure`.

    Args:
        scenes: Names of all scenes of a capture set.
        imperfections: Strength by name.
        seed: Seed of the case.
    """
    reach = imperfections.get(EXPOSURE, 0.0)
    streams = [Draws(seed=seed, scene=name).scene_rng("exposure") for name in scenes]
    logarithms = [stream.uniform(-reach, reach) for stream in streams]
    mean = math.fsum(logarithms) / max(len(logarithms), 1)
    return {name: math.exp(log - mean) for name, log in zip(scenes, logarithms, strict=True)}


def exposed(strengths: Strengths, factor: float) -> Strengths:
    """Return the strengths with a factor on the exposure time."""
    values = {**strengths.values, "exposure": factor * strengths["exposure"]}
    return Strengths(nominal=strengths.nominal, values=values)
