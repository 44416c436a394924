"""Measure which effects change the features in the same way, and compare with their pages.

The similarity of two effects is the cosine of their changes of all features of all scenes. Changes
are divided by their standard deviations and weighted. The most similar strengths of the screening
count. At 0.95 each effect explains 90 % of the change of the other, so their pages must name each
other. The script prints such pairs, with a star if neither page names the other effect. Use
development scenes only.

Usage:
    python benchmarks/diagnosis/effect_likeness.py CAPTURES --sensor FILE [--cache FOLDER] \
        [--least 0.95]
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from starling.diagnosis.scenes.scene_model import load_scene_model
from starling.diagnosis.scenes.selection import split_test_rooms
from starling.diagnosis.validation.adapters import families
from starling.diagnosis.which import attribution
from starling.diagnosis.which.likelihood import change_directions
from starling.diagnosis.which.segment import Screening
from starling.sim import effects
from starling.sim.captures import capture
from starling.sim.console import progress
from starling.sim.sensor import presets


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("captures", type=Path)
    parser.add_argument("--sensor", required=True)
    parser.add_argument("--cache", type=Path)
    parser.add_argument("--least", type=float, default=0.95)
    options = parser.parse_args()
    sensor = presets.load(options.sensor)
    scene_models = [
        load_scene_model(scene, sensor) for scene in capture.open_set(options.captures).scenes
    ]
    chosen, _ = split_test_rooms(scene_models)
    for segment in attribution.available_segments(scene_models, chosen):
        with progress.on_stderr() as track:
            _, screen = attribution.screen_segment(
                segment, chosen, always=True, cache=options.cache, track=track
            )
        print(f"{segment.value}:")
        for similarity, name, similar in similar_pairs(screen, options.least):
            known = similar in families.confusable(effects.named(name))
            print(f"  {similarity:.2f} {name}, {similar}{'' if known else ' *'}")


def similar_pairs(screen: Screening, least: float) -> Iterator[tuple[float, str, str]]:
    """Yield pairs of effects of different families, in descending order of similarity."""
    scale = screen.base.deviation / np.sqrt(screen.weight)
    owners, moves = change_directions(screen.signatures, scale)
    rows = moves.reshape(len(moves), -1)
    cosines = rows @ rows.T
    similarities: dict[tuple[str, str], float] = {}
    for first, second in zip(*np.nonzero(cosines >= least), strict=True):
        effect_a, effect_b = owners[first].candidate.effect, owners[second].candidate.effect
        if effect_a.name < effect_b.name and effect_a.family != effect_b.family:
            key = (effect_a.name, effect_b.name)
            similarities[key] = max(similarities.get(key, 0.0), float(cosines[first, second]))
    for (name, similar), similarity in sorted(similarities.items(), key=lambda item: -item[1]):
        yield similarity, name, similar


if __name__ == "__main__":
    main()
