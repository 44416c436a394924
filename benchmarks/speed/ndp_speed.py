"""Time of a network for one 640x480 image, and of a hybrid with its physics.

    python benchmarks/speed/ndp_speed.py [--repeats 30]

The networks are untrained, at the cost of trained ones. Medians.
"""

import argparse
import statistics
import time
from functools import partial

import torch

from starling.learning.data import simulated
from starling.learning.data.captured import DRAWS
from starling.learning.data.example import Example
from starling.learning.methods.network import Hybrid, HybridPredictor, Network
from starling.learning.networks.channels import channels
from starling.learning.networks.device import device, run_network, to_device
from starling.sim import simulate
from starling.sim.captures import writer
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.scene import sources
from starling.sim.sensor import resolve

SIZE = ("width=640", "height=480", "fx_px=380", "fy_px=380", "cx_px=319.5", "cy_px=239.5")


def main() -> None:
    """Print a row for each step."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=30)
    options = parser.parse_args()
    sensor = resolve.load("d435", edits=SIZE)
    stage = MitsubaScene(sources.load("clutter", sensor))
    shot = simulate.simulate(stage, sensor, seed=0)
    once_s, physics_s = (
        _median(partial(simulated.physics, stage, sensor, draws=draws), 5) for draws in (1, DRAWS)
    )
    example = Example(
        scene="clutter",
        room="clutter",
        info=writer.info_of(sensor, source="", licence="", notes=""),
        depth_m=shot.layers.truth.depth_m,
        physics=simulated.physics(stage, sensor, draws=DRAWS),
    )
    network = to_device(Network().untrained()).eval()
    hybrid = to_device(Hybrid().untrained()).eval()
    inputs = channels(example, with_reflectance=False, with_physics=False)
    predictor = HybridPredictor(hybrid, False, example.info.shape)
    rows = {
        "input channels": lambda: channels(example, with_reflectance=False, with_physics=False),
        "network": lambda: run_network(network, inputs),
        "hybrid without physics": lambda: predictor.probability(example),
    }
    print(f"{torch.get_num_threads()} threads, {device()}")
    print(f"{'physics, 1 draw':32}{1e3 * once_s:9.1f} ms")
    print(f"{f'physics, {DRAWS} draws':32}{1e3 * physics_s:9.1f} ms")
    taken_s = {name: _median(work, options.repeats) for name, work in rows.items()}
    for name, seconds in taken_s.items():
        print(f"{name:32}{1e3 * seconds:9.1f} ms")
    whole_s = physics_s + taken_s["hybrid without physics"]
    print(f"{'hybrid against physics':32}{whole_s / physics_s:9.2f}")
    print(f"{'hybrid against one frame':32}{whole_s / once_s:9.2f}")


def _median(work, repeats):
    work()
    durations = []
    for _ in range(repeats):
        start = time.perf_counter()
        work()
        durations.append(time.perf_counter() - start)
    return statistics.median(durations)


if __name__ == "__main__":
    main()
