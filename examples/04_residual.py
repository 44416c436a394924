"""Learn what physics misses: train on a camera that differs from its model, and evaluate.

The camera is that of `starling.learning.data.virtual`. Its imagers, lenses and matcher differ from
the preset, and its scenes differ from their model in reflectance. The simulator alone is wrong
about some holes, and depth alone has no information on light. The hybrid starts from the simulator
and learns the rest. Few scenes and steps keep the run to a minute; docs has the reference figures.

Usage:
    python examples/04_residual.py
    python examples/04_residual.py 12 600    # scenes, steps
"""

import sys
import tempfile
from pathlib import Path

from starling.learning.commands.evaluate_captures import EvaluationPlan, evaluate_captures
from starling.learning.data.captured import Simulation
from starling.learning.data.virtual import captures
from starling.sim.sensor import resolve

METHODS = ("perfect", "simple", "physics", "network", "hybrid")


def main(scenes: int = 2, steps: int = 15) -> None:
    """Hold the first scene out and print the scores of each method."""
    with tempfile.TemporaryDirectory() as name:
        real = Path(name, "virtual")
        captures.write(real, [f"clutter:{number}" for number in range(scenes)], samples=4)
        assumed = resolve.load("d435", captures=str(real))
        result = evaluate_captures(
            str(real),
            Path(name, "evaluation"),
            EvaluationPlan(methods=METHODS, held=("clutter-0",), steps=steps),
            simulations=lambda _held_out: Simulation(sensor=assumed, draws=4),
        )
    print(f"{'':10}{'AUC':>8}{'TPR at FPR 10 %':>18}{'Brier skill':>14}{'ECE':>8}")
    for method, mean in result["methods"].items():
        print(
            f"{method:10}{mean['auc']:8.3f}{mean['tpr_at_fpr10']:18.3f}"
            f"{mean['brier_skill']:14.3f}{mean['ece']:8.3f}"
        )


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
