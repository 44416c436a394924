"""Comparison of sampled holes with real ones: area, perimeter, run length, and flicker.

Holes are sampled once a scene from the stored probabilities of an evaluation by room, so that no
method was trained on the room. They are compared with one simulated frame and with the device's
holes. There are no real repeats: flicker is compared with simulated draws of noise.

    STARLING_CAPTURES=... python benchmarks/learning/ndp_holes.py EVALUATION --sensor TEMPLATE
"""

from pathlib import Path

import ndp_faro
import numpy as np

from starling.learning import registry
from starling.learning.commands.evaluate_captures import FOLDS, read_prediction
from starling.learning.data.example import known_holes
from starling.learning.features import holes
from starling.learning.sampling import sampling
from starling.sim.commands.simulate_captures import scene_seed
from starling.sim.console import progress
from starling.sim.console.names import file_name

FRAMES = 6  # Frames for the flicker rate.
SIMULATED = "one simulated frame"


def main() -> None:
    """Print a row of figures for each method."""
    parser = ndp_faro.parser(__doc__)
    parser.add_argument("evaluation", type=Path)
    options = parser.parse_args()
    real, drawn, overlap, flicker = [], {}, {}, {}
    with progress.on_stderr() as track:
        path = ndp_faro.captures()
        for scene, example in ndp_faro.scenes(options, path, track):
            ndp, counted = known_holes(example)
            real.append(holes.measure(ndp, counted))
            sequences = {SIMULATED: example.physics.one_draw_ndp[None]}
            for folder in sorted((options.evaluation / FOLDS / file_name(scene.room)).iterdir()):
                probability = read_prediction(folder / f"{scene.name}.png")
                physics = example.physics if folder.name in registry.ON_PHYSICS else None
                sequences[folder.name] = _sequence(probability, scene.name, physics)
                if physics is not None:
                    alone = _sequence(probability, scene.name, None)
                    sequences[f"{folder.name}, by noise alone"] = alone
            for method, frames in sequences.items():
                drawn.setdefault(method, []).append(holes.measure(frames[0], counted))
                both, either = frames[0] & ndp & counted, (frames[0] | ndp) & counted
                overlap.setdefault(method, []).append(both.sum() / max(either.sum(), 1))
                rate = (
                    _flicker_of_draws(example.physics, counted)
                    if method == SIMULATED
                    else holes.flicker_rate(frames, counted)
                )
                flicker.setdefault(method, []).append(rate)
    _table(holes.pool(real), drawn, overlap, flicker)


def _sequence(probability, scene, physics):
    how, seed = sampling.TYPICAL, scene_seed(0, scene)
    return np.stack(
        [
            sampling.ndp(probability, how, seed=seed, frame=frame, physics=physics)
            for frame in range(FRAMES)
        ]
    )


def _flicker_of_draws(physics, counted):
    """Share of pixels that differ between two independent draws."""
    without = physics.ndp[counted].astype(float) * physics.draws
    pairs = physics.draws * (physics.draws - 1)
    return float((2 * without * (physics.draws - without) / pairs).mean())


def _table(real, drawn, overlap, flicker):
    sizes = ("area_px", "perimeter_px", "run_px", "area_of_pixel_px")
    heads = "".join(f"{name.removesuffix('_px') + ' KS, log':>24}" for name in sizes)
    print(f"{'':32}{'rate %':>8}{'IoU':>7}{heads}{'flicker %':>11}")
    print(f"{'device':32}{100 * real.share:8.2f}")
    for method, measured in drawn.items():
        pooled = holes.pool(measured)
        cells = ""
        for name in sizes:
            far = holes.distance(getattr(pooled, name), getattr(real, name))
            cells += f"{far.kolmogorov_smirnov:15.3f}{far.wasserstein_log:9.3f}"
        print(
            f"{method:32}{100 * pooled.share:8.2f}{np.mean(overlap[method]):7.3f}{cells}"
            f"{100 * np.mean(flicker[method]):11.3f}"
        )


if __name__ == "__main__":
    main()
