"""Alignment of objects in the depth of methods and of a real D415, after a paper's Table I.

Sweeney, Izatt and Tedrake, ICRA 2019. Objects are segmented in the scanner's surface, and their
poses are disturbed. ICP aligns them in the depth image of each method and in the real one. A
method's depth image is the reference with the holes that it samples, and with the simulator's
errors if the method uses physics. Probabilities come from an evaluation by room, so that no
method was trained on the room.

    STARLING_CAPTURES=... starling evaluate ... --out EVALUATION
    STARLING_CAPTURES=... python benchmarks/learning/ndp_icp.py EVALUATION --sensor TEMPLATE
"""

from pathlib import Path

import ndp_faro

from starling.learning import registry
from starling.learning.commands.evaluate_captures import FOLDS, read_prediction
from starling.learning.evaluation.evaluate import HolePrediction
from starling.learning.icp import case_study
from starling.learning.icp.study import REAL, Disturbance
from starling.sim.captures import capture
from starling.sim.console import progress
from starling.sim.console.names import file_name

PUBLISHED = {  # Sweeney et al. 2019, Table I [percent].
    "perfect": (3.90, 18.4, 77.8, 49.8),
    "simple": (3.60, 18.0, 77.2, 49.7),
    "network": (3.60, 6.90, 3.74, 0.10),
    "pix2pix": (187, 179, 53.8, 99.3),
    "cyclegan": (62.3, 196, 227, 95.8),
}
DISTURBANCES = ((0.01, 5.0), (0.03, 15.0), (0.08, 40.0))  # [m], [deg]
ALONE = ", holes alone"  # Without the simulator's errors and the shapes of its holes.


def main() -> None:
    """Print a table for each disturbance."""
    parser = ndp_faro.parser(__doc__)
    parser.add_argument("evaluation", type=Path)
    parser.add_argument("--captures", type=Path, help="d415-faro if not given")
    parser.add_argument("--trials", type=int, default=10)
    options = parser.parse_args()
    path = options.captures or ndp_faro.captures()
    predictions: dict[str, list[HolePrediction]] = {}
    with progress.on_stderr() as track:
        for scene, example in ndp_faro.scenes(options, path, track):
            for folder in sorted((options.evaluation / FOLDS / file_name(scene.room)).iterdir()):
                view = HolePrediction(
                    example=example, probability=read_prediction(folder / f"{scene.name}.png")
                )
                predictions.setdefault(folder.name, []).append(view)
                if folder.name in registry.ON_PHYSICS:
                    predictions.setdefault(folder.name + ALONE, []).append(view)
        for move_m, turn_deg in DISTURBANCES:
            outcomes = case_study.case_study(
                capture.open_set(path),
                predictions,
                trials=options.trials,
                disturbance=Disturbance(most_m=move_m, most_deg=turn_deg),
                track=track,
            )
            _table(outcomes, move_m, turn_deg)


def _table(outcomes, move_m, turn_deg):
    real = outcomes[REAL]
    print(f"\ninitial poses off by up to {1e3 * move_m:g} mm and {turn_deg:g} deg; difference [%]")
    print(f"{'':34}{'position: mean, variance':>26}{'rotation: mean, variance':>26}{'objects':>9}")
    for name, outcome in outcomes.items():
        if name == REAL:
            continue
        compared = case_study.against_real(outcome, real)
        cells = "".join(f"{value:13.1f}" for value in compared.difference)
        published = PUBLISHED.get(name)
        note = f"  published {published}" if published else ""
        print(f"{name:34}{cells}{compared.objects:9}  {compared.trials} trials{note}")
    best = "hybrid"
    if best in outcomes:
        for baseline in ("perfect", "simple", "network", "physics"):
            if baseline in outcomes:
                gain = case_study.paired_advantage(outcomes[best], outcomes[baseline], real, seed=0)
                spans = "  ".join(
                    f"{low:.1f} to {high:.1f}"
                    for low, high in zip(gain.low, gain.high, strict=True)
                )
                print(
                    f"{best} closer to real than {baseline} by [points, 95 %]: {spans}", flush=True
                )


if __name__ == "__main__":
    main()
