"""Coherence split of real D415 rooms: what simulation explains, pattern, texture, noise.

The script loads one scene of each room of `d415-faro`, simulates it once and prints the shares by
period and by room as Markdown. No effect is tried.

Usage:
    STARLING_CAPTURES=... python benchmarks/diagnosis/coherence_faro.py --rooms 0060 0742 1982 3049
    STARLING_CAPTURES=... python benchmarks/diagnosis/coherence_faro.py --sensor FILE --rooms 0060
"""

from __future__ import annotations

import argparse
import math
import os
import time
from collections.abc import Sequence
from pathlib import Path

from rooms import first_of_each

from starling.diagnosis.report.first_answer import coherence_sentences
from starling.diagnosis.scenes.scene_model import SceneModel, load_scene_model
from starling.diagnosis.scenes.shelf import Derived, shelve
from starling.diagnosis.where.coherence.shares import CoherenceSplit, Estimate
from starling.diagnosis.where.coherence.split import coherence_split
from starling.sim.sensor import resolve

_SHARES = ("explained", "coherent", "pattern", "camera", "scene", "noise_ratio", "gain")


def main() -> None:
    """Load, split and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sensor", default="d415")
    parser.add_argument("--rooms", nargs="*", default=[], help="rooms to split; default: all")
    options = parser.parse_args()
    captures = Path(os.environ["STARLING_CAPTURES"]) / "d415-faro"
    sensor = resolve.load(options.sensor, captures=str(captures))
    started = time.perf_counter()
    scenes = first_of_each(captures, options.rooms)
    models = [load_scene_model(scene, sensor) for scene in scenes.values()]
    loaded = time.perf_counter()
    split = split_models(models, list(scenes))
    ended = time.perf_counter()
    print("\n".join(coherence_sentences(split, None)))
    print_split(split)
    print(f"loaded in {loaded - started:.0f} s, split in {ended - loaded:.0f} s")


def split_models(models: Sequence[SceneModel], rooms: Sequence[str]) -> CoherenceSplit:
    """Simulate each scene once, and split all."""
    count = len(models)
    return coherence_split(
        shelve(model.observe(model.request({}, seed=0)) for model in models),
        Derived(count, lambda number: models[number].real),
        Derived(count, lambda number: models[number].strata),
        rooms,
        [model.sensor.projector.pattern_scale for model in models],
    )


def print_split(split: CoherenceSplit) -> None:
    """Print tables of the images by period and room, and of disparity errors."""
    print("\n| period | power |", " | ".join(_SHARES), "|")
    for shares in split.images:
        cells = [_written(getattr(shares, name)) for name in ("power", *_SHARES)]
        print(f"| {shares.band} |", " | ".join(cells), "|")
    names = [name for name in _SHARES if name != "gain"]
    print("\n| room | windows |", " | ".join(names), "|")
    for room, shares in split.rooms.items():
        cells = [f"{getattr(shares, name):.3f}" for name in names]
        print(f"| {room} | {shares.windows} |", " | ".join(cells), "|")
    print("\n| disparity | near edges | period | rms_px | camera | image | rest |")
    for side, bands in split.disparity.items():
        for shares in bands:
            names = ["rms_px", "camera", "image", "rest"]
            cells = [_written(getattr(shares, name)) for name in names]
            near = _written(split.edges[side])
            print(f"| {side} | {near} | {shares.band} |", " | ".join(cells), "|")


def _written(estimate: Estimate) -> str:
    value, low, high = estimate
    ends = [end for end in (low, high) if end is not None and not math.isnan(end)]
    return f"{value:.3f}" + (f" [{ends[0]:.3f}, {ends[1]:.3f}]" if len(ends) == 2 else "")


if __name__ == "__main__":
    main()
