"""Holes of a Kinect v1 without infrared and reference: train, predict, and corrupt.

The reference depth is estimated from the depth of the device. Methods learn from `learn*` and
`capture*`, and predict the other scenes.

*Moved holes*: holes of another scene are moved
and cut into the depth before the estimate. The trained methods must not find them; otherwise they
would see where the estimate filled depth.

    STARLING_CAPTURES=... python benchmarks/learning/ndp_without_infrared.py OUT
"""

import argparse
import os
import time
from pathlib import Path

import numpy as np

from starling.learning import registry
from starling.learning.data import captured, estimated_reference
from starling.learning.data.example import Example
from starling.learning.evaluation import evaluate
from starling.learning.evaluation.evaluate import HolePrediction
from starling.learning.residual import LearnedHoles
from starling.sim.captures import capture
from starling.sim.corrupt import Corruptor
from starling.sim.sensor import presets

HELD = ("test", "milk")
FIGURES = ("auc", "tpr_at_fpr10", "brier_skill", "ece")


def main() -> None:
    """Print the scores of held-out scenes, holes of corrupted depth, and frames a second."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--steps", type=int, default=150)
    parser.add_argument("--methods", nargs="*", default=["simple", "network"])
    options = parser.parse_args()
    scenes = capture.open_set(Path(os.environ["STARLING_CAPTURES"]) / "kinect-v1-tables").scenes
    real = [example_of(scene, depth := depth_of(scene), np.isnan(depth)) for scene in scenes]
    moved = moved_holes(scenes, real)
    print("| method | holes | " + " | ".join(FIGURES) + " | auc of the worst scene |")
    learnt = [each for each in real if not each.scene.startswith(HELD)]
    for method in options.methods:
        folder = options.out / method
        predictor = registry.method(method, steps=options.steps).fit(learnt, folder=folder, seed=0)
        for name, examples in (("real", real), ("moved", moved)):
            held = [each for each in examples if each.scene.startswith(HELD)]
            scores = evaluate.scores(
                [
                    HolePrediction(example=each, probability=predictor.probability(each))
                    for each in held
                ]
            )
            cells = [f"{getattr(scores.mean, figure):.3f}" for figure in FIGURES]
            worst = f"{scores.worst.auc:.3f}"
            print(f"| {method} | {name} | {' | '.join(cells)} | {worst} |", flush=True)
    held = [each for each in real if each.scene.startswith(HELD)]
    print_holes(held, LearnedHoles(predictor))


def depth_of(scene):
    return scene.frame(0).depth_m


def example_of(scene, depth_m, ndp, where=True):
    """Return an example whose reference is estimated from a depth image."""
    reference_m = estimated_reference.estimate(depth_m, scene.info)
    counted = captured.counted_pixels(scene, reference_m) & where
    return Example(
        scene=scene.name,
        room=scene.room,
        info=scene.info,
        depth_m=reference_m,
        ndp=ndp,
        counted=counted,
    )


def moved_holes(scenes, real):
    """Return examples of the holes of another scene, at places that no geometry predicts."""
    rng = np.random.default_rng(0)
    examples = []
    for number, scene in enumerate(scenes):
        donor, depth_m = real[(number + 7) % len(scenes)], depth_of(scene).copy()
        holes = np.roll(donor.ndp & donor.counted, tuple(rng.integers(100, 400, 2)), (0, 1))
        known = np.isfinite(depth_m)
        depth_m[holes] = np.nan
        examples.append(example_of(scene, depth_m, holes & known, known))
    return examples


def print_holes(held, residual) -> None:
    """Compare the holes of corrupted references with those of the device."""
    info = held[0].info
    sensor = info.geometry_into(presets.load("kinect-v1"))
    matrix = np.array([[info.fx_px, 0, info.cx_px], [0, info.fy_px, info.cy_px], [0, 0, 1]])
    print("| depth | holes | IoU | wall [s] | CPU [s] |")
    device = [float((each.ndp & each.counted).sum() / each.counted.sum()) for each in held]
    print(f"| device | {np.mean(device):.4f} | 1.000 | | |")
    for name, model in (("physics", None), ("with the residual", residual)):
        camera = Corruptor(sensor, matrix, residual=model)
        camera.warm(info.shape)
        shares, overlaps, walls, processor = [], [], [], []
        for each in held:
            started, used = time.perf_counter(), time.process_time()
            reading = camera(each.depth_m, seed=1)
            walls.append(time.perf_counter() - started)
            processor.append(time.process_time() - used)
            ours, theirs = np.isnan(reading.depth_m) & each.counted, each.ndp & each.counted
            shares.append(ours.sum() / each.counted.sum())
            overlaps.append((ours & theirs).sum() / (ours | theirs).sum())
        medians = f"{np.median(walls):.2f} | {np.median(processor):.2f}"
        print(f"| {name} | {np.mean(shares):.4f} | {np.mean(overlaps):.3f} | {medians} |")


if __name__ == "__main__":
    main()
