"""Calibrate: simulate a camera that is off its data sheet, and find by how much from its images.

The camera's geometry is known here, so what the fit says can be checked. A wall alone leaves open
what only a second distance tells; the fit names it. A table before a wall settles it.

Usage:
    python examples/03_calibrate.py
    python examples/03_calibrate.py wall tabletop
"""

import sys
import tempfile
from pathlib import Path

from starling import calibration
from starling.calibration import parameters
from starling.sim.captures import capture
from starling.sim.commands import simulate_captures
from starling.sim.sensor import edits, presets

EDITS = ("width=424", "height=240", "fx_px=215", "fy_px=215", "cx_px=211.5", "cy_px=119.5")
PITCH = "imager.pixel_pitch_m=8.98e-6"  # Half as many pixels on the same chip.
TRUTH = {
    "baseline_m": 0.0518,
    "fx_px": 216.6,
    "projector.position_m.x": 0.0262,
    "projector.position_m.y": 0.0011,
    "projector.position_m.z": -0.003,
    "projector.rotation_deg.x": 0.3,
    "projector.rotation_deg.y": -0.7,
    "projector.rotation_deg.z": 0.4,
}


def main(*asked: str) -> None:
    """Fit the nominal camera to captures of the true one, and print both beside the start."""
    nominal = edits.apply(presets.load("d435"), (*EDITS, PITCH))
    true = parameters.with_values(nominal, TRUTH.items())
    for scenes in [asked] if asked else [("wall",), ("tabletop",)]:
        with tempfile.TemporaryDirectory() as name:
            captured = []
            for scene in scenes:
                out = Path(name, scene)
                simulate_captures.simulate_captures(scene, true, out, seed=1)
                captured += capture.open_set(str(out)).scenes
            free = ("baseline", "focal", "projector")
            found = calibration.fit(captured, nominal, free=free, heldout=(), folder=Path(name))
        print(f"\nfrom {' and '.join(scenes)}")
        print(f"{'':26}{'truth':>10}{'start':>10}{'fitted':>10}  +- sd")
        for one in found.estimates:
            sd = "not determined" if one.sd == float("inf") else f"{one.sd:.5f} {one.unit}"
            print(f"{one.name:26}{TRUTH[one.name]:10.5f}{one.start:10.5f}{one.value:10.5f}  {sd}")
        print("\n".join(found.undetermined) or "nothing is left open")


if __name__ == "__main__":
    main(*sys.argv[1:])
