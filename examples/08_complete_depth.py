"""Complete a simulated camera's depth by classical methods and a network, and compare errors.

Usage:
    python examples/08_complete_depth.py
"""

import numpy as np

from starling.learning.completion import methods
from starling.learning.completion.evaluation.metrics import score
from starling.learning.completion.method import complete
from starling.sim import simulate
from starling.sim.reason import LABELS, Reason
from starling.sim.scene import sources
from starling.sim.sensor import resolve

SIZE = ("width=640", "height=360", "fx_px=448", "fy_px=448", "cx_px=319.5", "cy_px=179.5")

# A furnished room, seen by a D415. Every hole has a reason.
sensor = resolve.load("d415", edits=SIZE)
shot = simulate.simulate(sources.load("room:2", sensor), sensor, seed=0)
truth_m, depth = shot.layers.truth.depth_m, shot.depth
reasons = [reason for reason in Reason if reason and (depth.reason == reason).any()]
causes = {LABELS[reason]: depth.reason == reason for reason in reasons}
print(f"{1 - depth.valid.mean():.1%} of the pixels have no depth")

# "small" was trained on simulated rooms; the other methods need no training.
for name in (*methods.CLASSICAL, "small"):
    completed = complete(methods.create(name), shot.ir_left, depth.depth_m, depth.valid)
    result = score(
        completed.depth_m,
        truth_m,
        depth.valid,
        focal_baseline_px_m=sensor.fx_px * sensor.baseline_m,
        causes=causes,
    )
    errors = {why: sums.figures()["mae_m"] for why, sums in result.reasons.items()}
    worst = max(errors, key=lambda why: errors[why] or 0.0)
    print(
        f"{name:14} error in holes {result.hole.figures()['mae_m']:.3f} m, greatest for the reason "
        f"{worst!r}: {errors[worst]:.3f} m"
    )

# Without any depth, no method makes a guess.
nothing = np.zeros_like(depth.valid)
print(complete(methods.create("nearest"), shot.ir_left, depth.depth_m, nothing).note)
