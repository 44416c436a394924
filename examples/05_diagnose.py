"""Diagnose: a camera's images are darker in the corners than its sensor file says; find out why.

Four captures of a camera with a vignette are compared with the camera that its user believes in.
Few families of effects are tried, for a minute's run; without `FAMILIES` all are.

Usage:
    python examples/05_diagnose.py
    python examples/05_diagnose.py veil=0.05
"""

import sys
import tempfile
from pathlib import Path

from starling.diagnosis import diagnose
from starling.diagnosis.report import sentences
from starling.sim.captures import capture
from starling.sim.commands import simulate_captures
from starling.sim.sensor import edits, presets

EDITS = ("width=320", "height=180", "fx_px=162", "fy_px=162", "cx_px=159.5", "cy_px=89.5")
BELIEVED = ("imager.lens.vignetting=0", "imager.dropped_bits=0")  # Matched as it is put out.
FAMILIES = ("vignetting", "veil", "read_noise", "tone_curve")
TRUE = ("vignetting=4",)


def main(*asked: str) -> None:
    """Capture four scenes with effects, forget them, and print what the diagnosis says."""
    believed = edits.apply(presets.load("d435"), (*EDITS, *BELIEVED))
    effects = dict(one.split("=") for one in asked or TRUE)
    with tempfile.TemporaryDirectory() as name:
        out = Path(name, "captures")
        for number in range(1, 5):
            one = Path(name, str(number))
            simulate_captures.simulate_captures(
                f"clutter:{number}",
                believed,
                one,
                frames=2,
                seed=number,
                effects={effect: float(value) for effect, value in effects.items()},
            )
            for path in one.iterdir():
                target = out / path.name
                target.parent.mkdir(exist_ok=True)
                if not target.exists():
                    path.rename(target)
        found = diagnose(capture.open_set(out), believed, families=FAMILIES)
    print("\n".join(sentences.answer(found)))


if __name__ == "__main__":
    main(*sys.argv[1:])
