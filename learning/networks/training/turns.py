"""Order of samples, shuffled in each epoch, so that each has the same weight."""

from __future__ import annotations

from starling.sim.randomness import generator


def sample_at(place: int, count: int, seed: int, stage: str, effect: str) -> int:
    """Return the number of the sample at a position of the endless sequence of epochs.

    Args:
        place: position since training began.
        count: number of samples.
        seed: seed of all orders.
        stage, effect: name of the random stream (see `starling.sim.randomness.generator`).
    """
    turn, position = divmod(place, count)
    return int(generator(seed, turn, stage, effect).permutation(count)[position])
