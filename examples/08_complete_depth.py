"""Complete a simulated camera's depth, by plain fills and by a network, and see where each is off.

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

# A furnished room as a D415 sees it. Every hole says why it is there.
sensor = resolve.load("d415", edits=SIZE)
shot = simulate.simulate(sources.load("room:2", sensor), sensor, seed=0)
truth_m, depth = shot.layers.truth.depth_m, shot.depth
causes = {LABELS[one]: depth.reason == one for one in Reason if one and (depth.reason == one).any()}
print(f"{1 - depth.valid.mean():.1%} of the pixels have no depth")

# "small" has learnt from simulated rooms; the others learn nothing.
for name in (*methods.CLASSICAL, "small"):
    found = complete(methods.asked(name), shot.ir_left, depth.depth_m, depth.valid)
    told = score(
        found.depth_m,
        truth_m,
        depth.valid,
        focal_baseline_px_m=sensor.fx_px * sensor.baseline_m,
        causes=causes,
    )
    errors = {why: sums.figures()["mae_m"] for why, sums in told.reasons.items()}
    worst = max(errors, key=lambda why: errors[why] or 0.0)
    print(
        f"{name:14} off by {told.hole.figures()['mae_m']:.3f} m in holes, most where the reason "
        f"is {worst!r}: {errors[worst]:.3f} m"
    )

# What no method may do: guess where there is nothing to go by.
nothing = np.zeros_like(depth.valid)
print(complete(methods.asked("nearest"), shot.ir_left, depth.depth_m, nothing).said)
