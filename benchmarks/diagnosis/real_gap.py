"""Contributions of spatially varying light and of the reference pose to the gap of real images.

The first scene of each room is diagnosed with uniform ambient light and with the reference pose of
its file. The gap is measured twice more with the tolerances and feature weights of this fit. The
second time the ambient light varies over the image (`starling.sim.scene.captured.ambient_share`).
The third time the reference pose is fitted as well (`starling.diagnosis.scenes.pose`).

Usage:
    STARLING_CAPTURES=... python benchmarks/diagnosis/real_gap.py --sensor FILE \
        --rooms 0060 0742 ...
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rooms import first_of_each

from starling.diagnosis.scenes import fit_scene
from starling.diagnosis.scenes.fit_scene import Nuisances
from starling.diagnosis.scenes.request import CAPTURED
from starling.diagnosis.scenes.scene_model import SceneModel, load_scene_model
from starling.diagnosis.which.attribution import screen_segment
from starling.diagnosis.which.candidates import Segment
from starling.diagnosis.which.likelihood import clipped_squares
from starling.diagnosis.which.table import build_feature_table
from starling.sim.sensor import resolve

# Families of effects that define the feature weights.
FAMILIES = ("lens_blur", "read_noise", "vertical_offset", "vignetting")
PARTS = {
    "pair and errors": ("pair", "error"),
    "where dots lie": ("dots",),
    "levels, texture, noise, holes": ("",),
}


def main() -> None:
    """Print the size of the gap by room and by group of features."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sensor", required=True)
    parser.add_argument("--rooms", nargs="+", required=True)
    options = parser.parse_args()
    path = Path(os.environ["STARLING_CAPTURES"]) / "d415-faro"
    sensor = resolve.load(options.sensor, captures=str(path))
    first = first_of_each(path, options.rooms)

    def load(scales: Sequence[Nuisances | None], **light: bool) -> list[SceneModel]:
        return [
            load_scene_model(scene, sensor, fitted=scale, **light)
            for scene, scale in zip(first.values(), scales, strict=True)
        ]

    unmoved = [fit_scene.fit_pattern_scale(scene, sensor) for scene in first.values()]
    uniform = load(unmoved, even_ambient=True)
    table, screen = screen_segment(Segment.IMAGE, uniform, families=FAMILIES, always=True)
    likelihood = screen.base.likelihood(table.rows(CAPTURED), screen.weight)
    varying = (load(unmoved), load([None] * len(first)))
    gaps = [likelihood.gap, *(gap(models, table.names) for models in varying)]
    residuals = [values / likelihood.deviation for values in gaps]
    known = np.all([np.isfinite(values) for values in residuals], axis=0)
    sizes = [clipped_squares(np.where(known, values, 0)) * screen.weight for values in residuals]
    total = known @ screen.weight
    print("uniform light, varying light, varying light and fitted pose")
    print("all", *(f"{size.sum() / total.sum():.2f}" for size in sizes))
    for number, room in enumerate(first):
        print(room, *(f"{size[number].sum() / total[number]:.2f}" for size in sizes))
    for name, columns in parts(table.names):
        print(name, *(f"{size[:, columns].sum() / total.sum():.2f}" for size in sizes))


def gap(scene_models: Sequence[SceneModel], names: tuple[str, ...]) -> NDArray[np.float64]:
    """Return the gap, real minus simulated (scenes, features), NaN if a feature is missing."""
    table = build_feature_table(scene_models, Segment.IMAGE)
    simulated = table.rows(table.request({}))
    columns = dict(zip(table.names, (table.rows(CAPTURED) - simulated).T, strict=True))
    unknown = np.full(len(scene_models), np.nan)
    return np.stack([columns.get(name, unknown) for name in names], axis=1)


def parts(names: tuple[str, ...]) -> Iterator[tuple[str, list[int]]]:
    """Yield the feature indices of each part. A feature belongs to the first matching part."""
    rest = set(range(len(names)))
    for name, starts in PARTS.items():
        indices = [number for number in sorted(rest) if names[number].startswith(starts)]
        rest -= set(indices)
        yield name, indices


if __name__ == "__main__":
    main()
