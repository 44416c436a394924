"""Diagnose: images are darker in the corners than the sensor file predicts; find the cause.

Four captures of a camera with a vignette are compared with the assumed camera. Only a few families
of effects are tested, for a run of a minute; without `FAMILIES` all are.

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
# The matcher uses all output bits.
ASSUMED = ("imager.lens.vignetting=0", "imager.dropped_bits=0")
FAMILIES = ("vignetting", "veil", "read_noise", "tone_curve")
TRUE = ("vignetting=4",)


def main(*settings: str) -> None:
    """Capture four scenes with effects, and print a diagnosis that does not know the effects."""
    assumed = edits.apply(presets.load("d435"), (*EDITS, *ASSUMED))
    effects = dict(setting.split("=") for setting in settings or TRUE)
    with tempfile.TemporaryDirectory() as name:
        out = Path(name, "captures")
        for number in range(1, 5):
            folder = Path(name, str(number))
            simulate_captures.simulate_captures(
                f"clutter:{number}",
                assumed,
                folder,
                frames=2,
                seed=number,
                effects={effect: float(value) for effect, value in effects.items()},
            )
            for path in folder.iterdir():
                target = out / path.name
                target.parent.mkdir(exist_ok=True)
                if not target.exists():
                    path.rename(target)
        diagnosis = diagnose(capture.open_set(out), assumed, families=FAMILIES)
    print("\n".join(sentences.answer(diagnosis)))


if __name__ == "__main__":
    main(*sys.argv[1:])
