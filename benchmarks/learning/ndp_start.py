"""Train the shipped models, hybrid and network, on varied cameras.

All cameras are assumed to be a D435 at 640x360. In each of 240 scenes the true camera differs from
it in ten effects (`learning/data/varied_cameras.py`). Captures, physics and models are kept in the
output folder and not computed again. Copy `hybrid-varied` and `network-varied`, weights and record,
to `learning/shipped`.

    python benchmarks/learning/ndp_start.py OUT
"""

import argparse
from pathlib import Path

from starling.learning import registry
from starling.learning.commands import train_captures
from starling.learning.data import varied_cameras
from starling.learning.data.captured import Simulation
from starling.sim.console import progress
from starling.sim.console.output import RECORD
from starling.sim.sensor import presets, resolve
from starling.sim.sensor.edits import with_values

SCENES = [f"tabletop:{n}" if n % 5 == 4 else f"clutter:{n}" for n in range(400, 640)]
BELIEVED = [
    *(("width", 640), ("height", 360), ("fx_px", 322.0), ("fy_px", 322.0)),
    *(("cx_px", 319.5), ("cy_px", 179.5)),
]
STEPS, SEED = 2400, 3


def main() -> None:
    """Compute captures, physics and models."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path)
    out = parser.parse_args().out
    with progress.on_stderr() as track:
        if not (out / "varied" / RECORD).is_file():
            assumed = with_values(presets.load("d435"), BELIEVED)
            varied_cameras.write(out / "varied", SCENES, assumed, seed=SEED, track=track)
        camera = resolve.load("d435", captures=str(out / "varied"))
        for method in ("hybrid", "network"):
            if (out / f"{method}-varied" / RECORD).is_file():
                continue
            train_captures.train_captures(
                method,
                str(out / "varied"),
                out / f"{method}-varied",
                simulation=Simulation(sensor=camera, cache=out / "physics")
                if method in registry.ON_PHYSICS
                else None,
                steps=STEPS,
                track=track,
            )


if __name__ == "__main__":
    main()
