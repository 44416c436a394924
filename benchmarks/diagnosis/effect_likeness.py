"""Which effects do the same to what the diagnosis looks at: measured, beside what their pages say.

Likeness is the cosine of two effects' changes of all features of all scenes, over their deviations
and with their votes, at the strengths of the screening that are most alike. From 0.95 on each
explains 90 % of what the other makes: a page that does not name the other is wrong. Such pairs are
printed, with a star where neither page names the other. Scenes have to be of development alone.

Usage:
    python benchmarks/diagnosis/effect_likeness.py CAPTURES --sensor FILE [--cache FOLDER] [--least 0.95]
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from starling.diagnosis.scenes.scene_model import subject
from starling.diagnosis.validation.adapters import families
from starling.diagnosis.which import attribution
from starling.diagnosis.which.likelihood import directions
from starling.diagnosis.which.segment import Screen
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
    asked = parser.parse_args()
    sensor = presets.load(asked.sensor)
    subjects = [subject(scene, sensor) for scene in capture.open_set(asked.captures).scenes]
    chosen, _ = attribution.parted(subjects)
    for arm in attribution.open_arms(subjects, chosen):
        with progress.on_stderr() as track:
            _, screen = attribution.screened(arm, chosen, always=True, cache=asked.cache, track=track)
        print(f"{arm.value}:")
        for likeness, one, other in pairs(screen, asked.least):
            known = other in families.twins(effects.named(one))
            print(f"  {likeness:.2f} {one}, {other}{'' if known else ' *'}")


def pairs(screen: Screen, least: float) -> Iterator[tuple[float, str, str]]:
    """Pairs of rows of different families that are so alike, the most alike first."""
    voted = screen.base.deviation / np.sqrt(screen.weight)
    owners, moves = directions(screen.rough, voted)
    rows = moves.reshape(len(moves), -1)
    cosines = rows @ rows.T
    found: dict[tuple[str, str], float] = {}
    for first, second in zip(*np.nonzero(cosines >= least), strict=True):
        one, other = owners[first].candidate.effect, owners[second].candidate.effect
        if one.name < other.name and one.family != other.family:
            key = (one.name, other.name)
            found[key] = max(found.get(key, 0.0), float(cosines[first, second]))
    for (one, other), likeness in sorted(found.items(), key=lambda each: -each[1]):
        yield likeness, one, other


if __name__ == "__main__":
    main()
