"""Calibrate: simulate a camera that differs from its data sheet, and estimate the differences.

The true geometry is known, so that the result can be checked. A wall at one distance does not
determine all parameters, and the fit lists the unidentifiable ones. A table before a wall does.

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
PITCH = "imager.pixel_pitch_m=8.98e-6"  # Half as many pixels on the same sensor area.
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


def main(*scene_names: str) -> None:
    """Fit the nominal camera to captures of the true one, and print truth, start and result."""
    nominal = edits.apply(presets.load("d435"), (*EDITS, PITCH))
    true = parameters.with_values(nominal, TRUTH.items())
    for scenes in [scene_names] if scene_names else [("wall",), ("tabletop",)]:
        with tempfile.TemporaryDirectory() as name:
            captured = []
            for scene in scenes:
                out = Path(name, scene)
                simulate_captures.simulate_captures(scene, true, out, seed=1)
                captured += capture.open_set(str(out)).scenes
            free = ("baseline", "focal", "projector")
            result = calibration.fit(captured, nominal, free=free, heldout=(), folder=Path(name))
        print(f"\nfrom {' and '.join(scenes)}")
        print(f"{'':26}{'truth':>10}{'start':>10}{'fitted':>10}  +- std")
        for fit in result.estimates:
            std = "not determined" if fit.sd == float("inf") else f"{fit.sd:.5f} {fit.unit}"
            print(f"{fit.name:26}{TRUTH[fit.name]:10.5f}{fit.start:10.5f}{fit.value:10.5f}  {std}")
        print("\n".join(result.undetermined) or "all parameters are determined")


if __name__ == "__main__":
    main(*sys.argv[1:])
