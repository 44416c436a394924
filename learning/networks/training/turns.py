"""Samples in turn, in an order that is shuffled each time round, so that each weighs the same."""

from __future__ import annotations

from starling.sim.randomness import generator


def chosen(place: int, count: int, seed: int, stage: str, effect: str) -> int:
    """Number of the sample that comes at a place, of so many, whatever came before.

    Args:
        place: from the training's beginning on.
        count: of the samples.
        seed: fixes all orders.
        stage, effect: what is drawn (see `starling.sim.randomness.generator`).
    """
    turn, position = divmod(place, count)
    return int(generator(seed, turn, stage, effect).permutation(count)[position])
