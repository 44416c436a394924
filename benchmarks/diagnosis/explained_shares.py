"""Measure the explained share of right effects, and of effects in the place of others.

The second camera implementation captures eight development scenes with at most one effect on the
images. Each case is diagnosed with all effects, and without the family of the true one. WORK caches
light, captures and simulations.

Usage:
    python benchmarks/diagnosis/explained_shares.py --work WORK [--perfect] [--cases N]
"""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from imperfect_base import FRAMES, make_light

from starling.diagnosis.howfar.evaluation import held_out_segments
from starling.diagnosis.howfar.evidence import EffectEvidence, weigh_effects
from starling.diagnosis.scenes.scene_model import SceneModel, load_scene_model, with_capture
from starling.diagnosis.scenes.selection import split_test_rooms
from starling.diagnosis.validation.camera import nominal
from starling.diagnosis.validation.camera.imperfections import IMPERFECTIONS
from starling.diagnosis.validation.protocol import limits, plan, programs, shoot
from starling.diagnosis.validation.protocol.case import Case, draw
from starling.diagnosis.which.attribution import screen_segment
from starling.diagnosis.which.candidates import Segment
from starling.diagnosis.which.segment import (
    Screening,
    SegmentResult,
    diagnose_segment,
    restrict_to_families,
)
from starling.diagnosis.which.table import FeatureTable
from starling.sim.captures import capture
from starling.sim.sensor import resolve

ENTROPY = {False: 6401, True: 6402}  # Seed of the drawn cases, by perfect base.
NULLS = 4  # Cases without an effect.


def main() -> None:
    """Print the share of each accepted effect, with and without the scatter between scenes."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--perfect", action="store_true")
    parser.add_argument("--cases", type=int, default=24, help="number of single effects")
    options = parser.parse_args()
    light = make_light(options.work)
    scene_models: list[SceneModel] = []
    screened: tuple[FeatureTable, Screening] | None = None  # Serves all captures of the scenes.
    for case in draw_cases(light, options.cases, perfect=options.perfect):
        folder = options.work / ("perfect" if options.perfect else "imperfect") / case.name
        if not folder.exists():
            shoot.shoot(light, case, folder, frames=FRAMES)
        scene_models = load_capture(folder, light, scene_models)
        training, held_out = split_test_rooms(scene_models)
        if screened is None:
            screened = screen_segment(Segment.IMAGE, training, cache=options.work / "cache")
        table = screened[0].with_captures(training)
        for left_out, name, share, plain in shares(case, table, screened[1], held_out):
            true = " ".join(case.settings) or "no effect"
            place = f"in the place of {true}" if left_out else f"true {true}"
            print(f"{case.name} {place}: {name} {share:.2f}, without scatter {plain:.2f}")


def draw_cases(light: Path, count: int, *, perfect: bool) -> tuple[Case, ...]:
    """Draw nulls and effects on the images, none of them a row that names the world."""
    return draw(
        nominal.read(light / nominal.FILE),
        {"single": count, "null": NULLS},
        limits=limits.read(),
        leave_out={name for each in IMPERFECTIONS.values() for name in each.rows},
        imperfect=None if perfect else plan.ALL,
        entropy=ENTROPY[perfect],
    )


def load_capture(folder: Path, light: Path, known: list[SceneModel]) -> list[SceneModel]:
    """Load the scenes of a case; known models of the same scenes take its captures."""
    captures = capture.open_set(folder)
    if known:
        pairs = zip(known, captures.scenes, strict=True)
        return [with_capture(model, scene, against=None) for model, scene in pairs]
    sensor = resolve.load(str(light / programs.SENSOR), captures=str(folder))
    return [load_scene_model(scene, sensor) for scene in captures.scenes]


def shares(
    case: Case, table: FeatureTable, screening: Screening, held_out: list[SceneModel]
) -> Iterator[tuple[bool, str, float, float]]:
    """Yield whether the true effect is left out, an accepted effect, and its two shares."""
    for left_out in (False, True) if case.settings else (False,):
        tried = without_effect(screening, case) if left_out else screening
        result = diagnose_segment(table, tried)
        plain = dataclasses.replace(
            result,
            search=dataclasses.replace(
                result.search, residual=np.zeros_like(result.search.residual)
            ),
        )
        weighed = [weigh(each, held_out) for each in (result, plain)]
        for name, evidence in weighed[0].items():
            yield left_out, name, evidence.explained, weighed[1][name].explained


def without_effect(screening: Screening, case: Case) -> Screening:
    """Leave out the family of the true effect."""
    family = {
        each.candidate.effect.name: each.candidate.effect.family for each in screening.signatures
    }
    left_out = {family.get(name) for name in case.settings}
    return restrict_to_families(screening, set(family.values()) - left_out)


def weigh(result: SegmentResult, held_out: list[SceneModel]) -> dict[str, EffectEvidence]:
    """Weigh the accepted effects on held-out scenes."""
    (segment,) = held_out_segments([result], held_out)
    return weigh_effects(result, segment.table, segment.likelihood)


if __name__ == "__main__":
    main()
