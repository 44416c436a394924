"""Do objects align as badly in a method's depth as in a real D415's? After a paper's Table I.

Sweeney, Izatt and Tedrake, ICRA 2019. Objects are cut from the scanner's surface, their poses
disturbed, and aligned by ICP in the depth image of each method and in the real one. A method's
depth image is the reference with the holes that it draws; where it builds on physics, with the
simulator's own errors too. Probabilities come from an evaluation by room, so no method has learnt
from the room it is tried in.

    STARLING_CAPTURES=... starling evaluate ... --out EVALUATION
    STARLING_CAPTURES=... python benchmarks/learning/ndp_icp.py EVALUATION --sensor TEMPLATE
"""

from pathlib import Path

import ndp_faro

from starling.learning import registry
from starling.learning.commands.evaluate_captures import FOLDS, read_told
from starling.learning.evaluation.evaluate import Told
from starling.learning.icp import case_study, comparison
from starling.learning.icp.alignment import Disturbance
from starling.learning.icp.study import REAL
from starling.sim.captures import capture
from starling.sim.console import progress

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
    asked = parser.parse_args()
    path = asked.captures or ndp_faro.captures()
    told: dict[str, list[Told]] = {}
    with progress.on_stderr() as track:
        for scene, example in ndp_faro.scenes(asked, path, track):
            for folder in sorted((asked.evaluation / FOLDS / scene.room).iterdir()):
                view = Told(example=example, probability=read_told(folder / f"{scene.name}.png"))
                told.setdefault(folder.name, []).append(view)
                if folder.name in registry.ON_PHYSICS:
                    told.setdefault(folder.name + ALONE, []).append(view)
        for move_m, turn_deg in DISTURBANCES:
            outcomes = case_study.case_study(
                capture.open_set(path),
                told,
                trials=asked.trials,
                disturbance=Disturbance(most_m=move_m, most_deg=turn_deg),
                track=track,
            )
            _table(outcomes, move_m, turn_deg)


def _table(outcomes, move_m, turn_deg):
    real = outcomes[REAL]
    print(f"\nfirst guesses off by up to {1e3 * move_m:g} mm and {turn_deg:g} deg; difference [%]")
    print(f"{'':34}{'position: mean, variance':>26}{'rotation: mean, variance':>26}{'objects':>9}")
    for name, outcome in outcomes.items():
        if name == REAL:
            continue
        one = comparison.against_real(outcome, real)
        cells = "".join(f"{value:13.1f}" for value in one.difference)
        published = PUBLISHED.get(name)
        beside = f"  published {published}" if published else ""
        print(f"{name:34}{cells}{one.objects:9}  {one.trials} trials{beside}")
    best = "hybrid"
    if best in outcomes:
        for other in ("perfect", "simple", "network", "physics"):
            if other in outcomes:
                gain = comparison.nearer(outcomes[best], outcomes[other], real, seed=0)
                spans = "  ".join(
                    f"{low:.1f} to {high:.1f}"
                    for low, high in zip(gain.low, gain.high, strict=True)
                )
                print(f"{best} nearer than {other} by [points, 95 %]: {spans}", flush=True)


if __name__ == "__main__":
    main()
