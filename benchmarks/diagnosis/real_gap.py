"""What the images' gap in real rooms is made of: light by place, and the reference's pose.

The first scene of each room is diagnosed as captured rooms once were, evenly lit and with the
reference where its file has it. By the allowances and votes that this gives, the gap is told again
with light by place (`starling.sim.scene.captured.ambient_share`), and with the reference's pose fitted as well
(`starling.diagnosis.scenes.pose`).

Usage:
    STARLING_CAPTURES=... python benchmarks/diagnosis/real_gap.py --sensor FILE --rooms 0060 0742 ...
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator
from pathlib import Path
from unittest import mock

import numpy as np
from numpy.typing import NDArray
from rooms import first_of_each

from starling.diagnosis.scenes import fit_scene
from starling.diagnosis.scenes.scene_model import subject
from starling.diagnosis.which.attribution import screened
from starling.diagnosis.which.candidates import Arm
from starling.diagnosis.which.likelihood import squares
from starling.diagnosis.which.table import bench
from starling.sim.captures.capture import CapturedScene
from starling.sim.scene.captured import ambient_share
from starling.sim.sensor import resolve
from starling.sim.sensor.sensor import Sensor

FAMILIES = ("lens_blur", "read_noise", "vertical_offset", "vignetting")  # Whose votes count.
PARTS = {
    "pair and errors": ("pair", "error"),
    "where dots lie": ("dots",),
    "levels, texture, noise, holes": ("",),
}


def main() -> None:
    """Print sizes, a line a figure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sensor", required=True)
    parser.add_argument("--rooms", nargs="+", required=True)
    asked = parser.parse_args()
    path = Path(os.environ["STARLING_CAPTURES"]) / "d415-faro"
    sensor = resolve.load(asked.sensor, captures=str(path))
    first = first_of_each(path, asked.rooms)
    evenly = mock.patch.object(ambient_share, "told", return_value=None)
    unmoved = mock.patch.object(fit_scene, "of_reference", return_value={})
    with evenly, unmoved:
        read = [subject(one, sensor) for one in first.values()]
        table, screen = screened(Arm.IMAGE, read, families=FAMILIES, always=True)
    likelihood = screen.base.likelihood(table.real(), screen.weight)
    with unmoved:
        lit = gap(first, sensor, table.names)
    gaps = [likelihood.gap, lit, gap(first, sensor, table.names)]
    left = [one / likelihood.deviation for one in gaps]
    known = np.all([np.isfinite(one) for one in left], axis=0)
    counted = [squares(np.where(known, one, 0)) * screen.weight for one in left]
    votes = known @ screen.weight
    print("as it was, light by place, and pose")
    print("all", *(f"{one.sum() / votes.sum():.2f}" for one in counted))
    for number, room in enumerate(first):
        print(room, *(f"{one[number].sum() / votes[number]:.2f}" for one in counted))
    for name, mine in parts(table.names):
        print(name, *(f"{one[:, mine].sum() / votes.sum():.2f}" for one in counted))


def gap(
    first: dict[str, CapturedScene], sensor: Sensor, names: tuple[str, ...]
) -> NDArray[np.float64]:
    """Real less simulated (scenes, features); NaN where a feature is not told."""
    table = bench([subject(one, sensor) for one in first.values()], Arm.IMAGE)
    simulated = table.simulated({})
    assert simulated is not None
    told = dict(zip(table.names, (table.real() - simulated).T, strict=True))
    unknown = np.full(len(first), np.nan)
    return np.stack([told.get(name, unknown) for name in names], axis=1)


def parts(names: tuple[str, ...]) -> Iterator[tuple[str, list[int]]]:
    """Numbers of the features of each part; each feature is of the first that has it."""
    rest = set(range(len(names)))
    for name, starts in PARTS.items():
        mine = [number for number in sorted(rest) if names[number].startswith(starts)]
        rest -= set(mine)
        yield name, mine


if __name__ == "__main__":
    main()
