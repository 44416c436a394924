"""Coverage of the expected error by group of pixels and by tilt of measured surfaces.

`own` is the network's own sigma, `now` the calibrated one.

    python benchmarks/learning/completion_sigma_groups.py CAPTURES FOLDER --rooms 0742 e 3049 5074 k
"""

import argparse
import itertools
from collections import defaultdict
from pathlib import Path

import numpy as np

from starling.learning.completion.data.layouts import list_frames, read_frames, select_frames
from starling.learning.completion.data.pairs import Pair
from starling.learning.completion.evaluation.coverage import Coverage, coverage
from starling.learning.completion.method import Image
from starling.learning.completion.small.expected_error import change_m, group_masks
from starling.learning.completion.small.method import Small, load
from starling.sim.arrays import Mask
from starling.sim.console import progress

TILTS_DEG = (0, 45, 60, 70, 80, 90)


def regions(pair: Pair, depth_m: Image) -> dict[str, Mask]:
    """Return groups, and measured pixels by tilt of the completed depth."""
    masks = group_masks(pair.valid, depth_m == pair.depth_m)
    slope = change_m(depth_m, "measured") / depth_m * pair.camera.fx_px
    tilt_deg = np.degrees(np.arctan(slope))
    for low, high in itertools.pairwise(TILTS_DEG):
        inside = (tilt_deg >= low) & (tilt_deg < high)
        masks[f"measured, {low} to {high} deg"] = masks["measured"] & inside
    return masks


def main() -> None:
    """Print one line for each region."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("captures")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--rooms", nargs="+", required=True)
    arguments = parser.parse_args()
    ready = load(arguments.folder)
    sums: dict[tuple[str, str], Coverage] = defaultdict(Coverage)
    frames = select_frames(
        list_frames(arguments.captures, "captures", "ir_left"), arguments.rooms, None
    )
    with progress.on_stderr() as track:
        for pair in read_frames(frames, track, "complete"):
            for name, network in (("own", Small(ready.network)), ("now", ready)):
                result = network.fill(pair.frame)
                for region, mask in regions(pair, result.depth_m).items():
                    sums[region, name] += coverage(
                        result.depth_m, result.sigma_m, pair.truth(), mask, result.half_m
                    )
    for (region, name), total in sums.items():
        figures = {key: value for key, value in total.figures().items() if value is not None}
        print(region, name, *(f"{key} {value:.3g}" for key, value in figures.items()), sep="  ")


if __name__ == "__main__":
    main()
