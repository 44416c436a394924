"""Results of an evaluation as plain values."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

from starling.learning.evaluation import evaluate
from starling.learning.evaluation.evaluate import Scores
from starling.learning.evaluation.figures import classification
from starling.learning.evaluation.figures.classification import Classification


def figures(methods: Mapping[str, Scores], *, seed: int) -> dict[str, Any]:
    """Collect all metrics by method.

    Args:
        methods: methods scored on the same rooms.
        seed: seed of the bootstrap.

    Returns:
        `{"methods": {NAME: {FIGURE, ..., "worst", "off_edges", "kinds"}}, "rooms": {ROOM: {NAME:
        {FIGURE, ...}}}, "differences": {NAME: {EARLIER NAME: {FIGURE: {"mean", "low", "high",
        "rooms", "above"}}}}}`: means over rooms, worst room of each metric, and the mean off depth
        edges. `differences` is missing if there is only one room.
    """
    result: dict[str, Any] = {
        "methods": {
            name: {
                **dataclasses.asdict(scores.mean),
                "worst": dataclasses.asdict(scores.worst),
                "off_edges": _mean(scores.rooms_off_edges),
                "kinds": {kind: dataclasses.asdict(score) for kind, score in scores.kinds.items()},
            }
            for name, scores in methods.items()
        },
        "rooms": {},
    }
    for name, scores in methods.items():
        for room, score in scores.rooms.items():
            result["rooms"].setdefault(room, {})[name] = dataclasses.asdict(score)
    if all(len(scores.rooms) > 1 for scores in methods.values()):
        differences = evaluate.differences(methods, seed=seed)
        result["differences"] = {
            later: {
                earlier: {name: dataclasses.asdict(value) for name, value in by_figure.items()}
                for earlier, by_figure in by_earlier.items()
            }
            for later, by_earlier in differences.items()
        }
    return result


def _mean(rooms: Mapping[str, Classification]) -> dict[str, float] | None:
    return dataclasses.asdict(classification.mean(rooms)) if rooms else None
