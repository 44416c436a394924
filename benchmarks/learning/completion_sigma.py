"""Calibrate the expected error of a completion network in rooms that it was not trained on.

Prints errors over sigma of each room, with sigma fitted to the other rooms, and writes `sigma.json`
to the folder of weights.

    python benchmarks/learning/completion_sigma.py CAPTURES FOLDER --rooms 0060 1982 4426 6422 g
"""

import argparse
import dataclasses
from collections import defaultdict
from pathlib import Path

import numpy as np

from starling.learning.completion.data.layouts import list_frames, read_frames, select_frames
from starling.learning.completion.method import LEVELS
from starling.learning.completion.small import expected_error, expected_error_fit
from starling.learning.completion.small.expected_error import ExpectedError, GroupError
from starling.learning.completion.small.expected_error_fit import RoomErrors
from starling.learning.completion.small.method import Small, load
from starling.sim.console import progress


def errors_by_group(captures: str, rooms: list[str], network: Small) -> dict[str, list[RoomErrors]]:
    """Complete all frames and return the errors of each group by room."""
    frames = select_frames(list_frames(captures, "captures", "ir_left"), rooms, None)
    drawn: dict[str, dict[str, list[RoomErrors]]] = defaultdict(lambda: defaultdict(list))
    with progress.on_stderr() as track:
        for number, pair in enumerate(read_frames(frames, track, "complete")):
            completed = network.fill(pair.frame)
            sampled = expected_error_fit.sampled_errors(
                pair, completed.depth_m, completed.sigma_m, seed=number
            )
            for group, errors in sampled:
                drawn[group][pair.room].append(errors)
    return {group: [_joined(parts) for parts in drawn[group].values()] for group in drawn}


def _joined(parts: list[RoomErrors]) -> RoomErrors:
    names = [field.name for field in dataclasses.fields(RoomErrors)]
    return RoomErrors(
        **{name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
    )


def calibrated_group(name: str, rooms: list[RoomErrors]) -> GroupError:
    """Fit one group and print its errors in rooms left out."""
    ratios = expected_error_fit.left_out(rooms)
    halves = {
        f"half_{level}": round(expected_error_fit.half_width(ratios, level / 100), 3)
        for level in LEVELS
    }
    group = dataclasses.replace(expected_error_fit.fit(rooms), **halves)
    own_rms = [np.sqrt(np.mean((room.error / room.own_sigma) ** 2)) for room in rooms]
    rms = [np.sqrt(np.mean(ratio**2)) for ratio in ratios]
    print(name, group)
    print("  own sigma", np.round(own_rms, 2), "left out", np.round(rms, 2))
    return group


def main() -> None:
    """Calibrate and save."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("captures")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--rooms", nargs="+", required=True)
    arguments = parser.parse_args()
    network = Small(load(arguments.folder).network)
    errors = errors_by_group(arguments.captures, arguments.rooms, network)
    groups = {name: calibrated_group(name, errors[name]) for name in expected_error.GROUPS}
    expected_error.save(ExpectedError(**groups), arguments.folder / expected_error.FILE)


if __name__ == "__main__":
    main()
