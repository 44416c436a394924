"""Time of completion methods for one 640x480 frame of a simulated D415, and their size.

    python benchmarks/speed/completion_speed.py [--repeats 15]

The network is untrained, at the cost of a trained one. Medians without the first run.
"""

import argparse
import statistics
import time
from functools import partial

import cv2
import torch

from starling.learning.completion import methods
from starling.learning.completion.method import complete
from starling.learning.completion.small.method import Small
from starling.learning.completion.small.network import SmallNetwork
from starling.learning.networks.device import device, initialised
from starling.learning.networks.unet import parameter_count
from starling.sim import simulate
from starling.sim.scene import sources
from starling.sim.sensor import resolve

SIZE = ("width=640", "height=480", "fx_px=448", "fy_px=448", "cx_px=319.5", "cy_px=239.5")


def main() -> None:
    """Print a row for each method."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=15)
    options = parser.parse_args()
    sensor = resolve.load("d415", edits=SIZE)
    shot = simulate.simulate(sources.load("room:2", sensor), sensor, seed=0)
    depth = shot.depth
    network = initialised(SmallNetwork, 0).eval().requires_grad_(False)
    print(
        f"{torch.get_num_threads()} threads of torch, {cv2.getNumThreads()} of OpenCV, {device()}"
    )
    print(f"small has {parameter_count(network):,} parameters")
    for method in (Small(network), *map(methods.create, methods.CLASSICAL)):
        run = partial(complete, method, shot.ir_left, depth.depth_m, depth.valid)
        durations = []
        for _ in range(options.repeats + 1):
            start = time.perf_counter()
            run()
            durations.append(time.perf_counter() - start)
        print(f"{method.name:16}{1e3 * statistics.median(durations[1:]):8.1f} ms")


if __name__ == "__main__":
    main()
