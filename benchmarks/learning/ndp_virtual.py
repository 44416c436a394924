"""Physics, network and hybrid on a virtual camera, trained on 1, 3, 10, 30 and 100 scenes.

The camera differs from its assumed parameters in imagers, optics, matcher, reflectances and light
(`learning/data/virtual/README.md`). Physics is a D435 with the data sheet's geometry. Methods are
trained on the first N of 100 scenes and evaluated on 30 others. Captures and models are kept in the
output folder and not computed again.

    python benchmarks/learning/ndp_virtual.py OUT [--scenes 1 3 10 30 100] [--methods physics
    network hybrid]
"""

import argparse
from pathlib import Path

from starling.learning import registry
from starling.learning.commands import train_captures
from starling.learning.commands.evaluate_captures import EvaluationPlan, evaluate_captures
from starling.learning.data.captured import Simulation
from starling.learning.data.virtual import captures
from starling.sim.captures import capture
from starling.sim.console import progress
from starling.sim.console.output import RECORD
from starling.sim.sensor import resolve

DATA_SHEET = (
    "projector.position_m.x=0.029",
    "projector.fov_x_deg=90",
    "projector.fov_y_deg=63",
)
LEARN = [f"tabletop:{n}" if n % 5 == 4 else f"clutter:{n}" for n in range(100)]
JUDGE = [f"tabletop:{n}" if n % 5 == 4 else f"clutter:{n}" for n in range(200, 230)]
METHODS = ("physics", "physics_recalibrated", "trees", "network", "hybrid", "hybrid_trees")
STARTED = ("network", "hybrid")  # Also trained from the shipped models.
DRAWS = 8


def main() -> None:
    """Simulate the captures, train, evaluate, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--scenes", type=int, nargs="*", default=[1, 3, 10, 30, 100])
    parser.add_argument("--methods", nargs="*", default=METHODS)
    options = parser.parse_args()
    with progress.on_stderr() as track:
        learn = _captured(options.out / "learn", LEARN, 1, track)
        judge = _captured(options.out / "judge", JUDGE, 2, track)
        assumed = resolve.load("d435", captures=str(learn), edits=DATA_SHEET)
        simulation = Simulation(sensor=assumed, draws=DRAWS, cache=options.out / "physics")
        rooms = [scene.room for scene in capture.open_set(learn).scenes]
        print(f"{'scenes':>8} {'method':26}{'AUC':>8}{'TPR 10 %':>10}{'Brier skill':>13}{'ECE':>8}")
        runs = [(method, None) for method in options.methods]
        runs += [(m, Path(f"{m}-varied")) for m in options.methods if m in STARTED]
        for count in options.scenes:
            for method, start in runs:
                name = method if start is None else f"{method} going on"
                model = options.out / f"{name.replace(' ', '-')}-{count}"
                _train(model, method, learn, rooms[:count], simulation, start, track)
                result = evaluate_captures(
                    str(judge),
                    options.out / f"judged-{model.name}",
                    EvaluationPlan(methods=(), models=(model,)),
                    simulations=lambda _room: simulation,
                    force=True,
                    track=track,
                )
                mean = result["methods"][method]
                print(
                    f"{count:8} {name:26}{mean['auc']:8.4f}{mean['tpr_at_fpr10']:10.3f}"
                    f"{mean['brier_skill']:13.4f}{mean['ece']:8.4f}",
                    flush=True,
                )


def _captured(folder, names, seed, track):
    if not (folder / RECORD).is_file():
        captures.write(folder, names, seed=seed, track=track)
    return folder


def _train(folder, method, learn, rooms, simulation, start, track):
    if not (folder / RECORD).is_file():
        train_captures.train_captures(
            method,
            str(learn),
            folder,
            simulation=simulation if method in registry.ON_PHYSICS else None,
            rooms=rooms,
            start=start,
            track=track,
        )


if __name__ == "__main__":
    main()
