"""Generate a small data set from a plan, verify it, and read it.

Usage:
    python examples/07_data_set.py
"""

import tempfile
from pathlib import Path

from starling.sim.captures import capture
from starling.sim.datasets import index
from starling.sim.datasets.generate import generate
from starling.sim.datasets.verify import verify

PLAN = """
seed = 7
scenes = 2
views = 2

[[source]]
kind = "builtin"
scene = "wall"
number = { low = 0.6, high = 1.5 }

[[sensor]]
preset = "d435"
[sensor.set]
width = 160
height = 96
fx_px = 80
fy_px = 80
cx_px = 79.5
cy_px = 47.5
[sensor.effects]
lens_blur = { low = 0.1, high = 0.8 }

[pose]
turn_deg = [{ low = -5, high = 5 }, 0, 0]
"""


def main() -> None:
    """Generate four views, and print their properties."""
    with tempfile.TemporaryDirectory() as name:
        plan, out = Path(name, "plan.toml"), Path(name, "set")
        plan.write_text(PLAN)
        result = generate(plan, out, workers=1)
        print(f"{result['frames']} frames of {result['bytes_per_frame'] / 1e3:.0f} kB")
        for row, scene in zip(index.read(out), capture.open_set(out).scenes, strict=True):
            blur = scene.frame(0).record["effects"]["lens_blur"]
            print(
                f"{row['name']} of {row['room']}: blur {blur:.2f} px, {row['ndp_rate']:.1%} holes"
            )
        print(f"{verify(out, sample=1)['differing']} differ")


if __name__ == "__main__":
    main()
