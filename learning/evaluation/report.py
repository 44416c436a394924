"""What an evaluation leaves: figures as plain values, and pictures."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

from starling.learning.evaluation import evaluate
from starling.learning.evaluation.evaluate import Scores
from starling.learning.evaluation.figures import classification
from starling.learning.evaluation.figures.classification import Classification


def figures(methods: Mapping[str, Scores], *, seed: int) -> dict[str, Any]:
    """Give all figures by method.

    Args:
        methods: judged on the same rooms.
        seed: of the bootstrap.

    Returns:
        `{"methods": {NAME: {FIGURE, ..., "worst", "off_edges", "kinds"}}, "rooms": {ROOM: {NAME:
        {FIGURE, ...}}}, "differences": {NAME: {EARLIER NAME: {FIGURE: {"mean", "low", "high",
        "rooms", "above"}}}}}`: means over rooms, then each room's worst and the mean off depth
        edges; differences are left out where there is one room.
    """
    found: dict[str, Any] = {
        "methods": {
            name: {
                **dataclasses.asdict(scores.mean),
                "worst": dataclasses.asdict(scores.worst),
                "off_edges": _mean(scores.rooms_off_edges),
                "kinds": {kind: dataclasses.asdict(one) for kind, one in scores.kinds.items()},
            }
            for name, scores in methods.items()
        },
        "rooms": {},
    }
    for name, scores in methods.items():
        for room, one in scores.rooms.items():
            found["rooms"].setdefault(room, {})[name] = dataclasses.asdict(one)
    if all(len(scores.rooms) > 1 for scores in methods.values()):
        between = evaluate.differences(methods, seed=seed)
        found["differences"] = {
            later: {
                earlier: {name: dataclasses.asdict(one) for name, one in by_figure.items()}
                for earlier, by_figure in of_earlier.items()
            }
            for later, of_earlier in between.items()
        }
    return found


def _mean(rooms: Mapping[str, Classification]) -> dict[str, float] | None:
    return dataclasses.asdict(classification.mean(rooms)) if rooms else None
