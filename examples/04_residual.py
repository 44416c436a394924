"""Learn what physics misses: train on a camera that differs from its model, judge it elsewhere.

The camera is the virtual one of `starling.learning.data.virtual`: its imagers, lenses and matcher are not the
preset's, and its scenes reflect otherwise than their model says. So the simulator alone is wrong
about some holes, depth alone cannot know of light, and the hybrid starts from the one and learns
the rest. Few scenes and steps, for a minute's run: the figures of record are in docs/figures.md.

Usage:
    python examples/04_residual.py
    python examples/04_residual.py 12 600    # scenes, steps
"""

import sys
import tempfile
from pathlib import Path

from starling.learning.commands.evaluate_captures import Plan, evaluate_captures
from starling.learning.data.captured import Simulation
from starling.learning.data.virtual import captures
from starling.sim.sensor import resolve

METHODS = ("perfect", "simple", "physics", "network", "hybrid")


def main(scenes: int = 2, steps: int = 15) -> None:
    """Hold the first scene out and print what each method says of it."""
    with tempfile.TemporaryDirectory() as name:
        real = Path(name, "virtual")
        captures.write(real, [f"clutter:{number}" for number in range(scenes)], samples=4)
        believed = resolve.load("d435", captures=str(real))
        found = evaluate_captures(
            str(real),
            Path(name, "evaluation"),
            Plan(methods=METHODS, held=("clutter-0",), steps=steps),
            simulations=lambda _held_out: Simulation(sensor=believed, draws=4),
        )
    print(f"{'':10}{'AUC':>8}{'TPR at FPR 10 %':>18}{'Brier skill':>14}{'ECE':>8}")
    for method, mean in found["methods"].items():
        print(
            f"{method:10}{mean['auc']:8.3f}{mean['tpr_at_fpr10']:18.3f}"
            f"{mean['brier_skill']:14.3f}{mean['ece']:8.3f}"
        )


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
