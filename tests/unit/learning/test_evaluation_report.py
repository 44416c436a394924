"""Results of an evaluation: plain values and pictures."""

from __future__ import annotations

import dataclasses
import json

import cv2
import numpy as np
import pytest

from starling.learning.evaluation import evaluate, metrics, pictures
from starling.learning.evaluation.evaluate import HolePrediction
from starling.learning.features.holes import KINDS
from starling.sim.console import record
from starling.sim.plotting import sheet
from tests.unit.learning.step_scenes import SHAPE, step_scene

FIGURES = [field.name for field in dataclasses.fields(metrics.Classification)]
PNG = b"\x89PNG\r\n\x1a\n"


def predictions(quality: float, *, scenes: int = 4, rooms: int = 4) -> list[HolePrediction]:
    """Synthetic scenes with a probability between chance (0) and the holes themselves (1)."""
    result = []
    for number in range(scenes):
        rng = np.random.default_rng(number)
        scene = step_scene(number, room=f"room{number % rooms}")
        assert scene.ndp is not None
        ndp = scene.ndp | (rng.random(SHAPE) < 0.02)
        probability = quality * ndp + (1 - quality) * rng.random(SHAPE)
        scene = dataclasses.replace(scene, ndp=ndp)
        result.append(HolePrediction(example=scene, probability=probability.astype(np.float32)))
    return result


def shown(picture: bytes) -> np.ndarray:
    """Pixels (h, w, 3) of a PNG."""
    assert picture.startswith(PNG)
    image = cv2.imdecode(np.frombuffer(picture, np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    return image


def test_figures_are_the_scores_as_plain_values():
    scores = {"dim": evaluate.scores(predictions(0.3)), "good": evaluate.scores(predictions(0.9))}
    result = evaluate.figures(scores, seed=4)
    assert json.loads(record.dumps(result)) == result
    assert list(result["methods"]) == ["dim", "good"]
    assert list(result["rooms"]) == ["room0", "room1", "room2", "room3"]
    for name, of_it in result["methods"].items():
        assert list(of_it) == [*FIGURES, "worst", "off_edges", "kinds"]
        assert list(of_it["kinds"]) == list(KINDS)
        assert list(of_it["kinds"]["edge"]) == ["share", "sure", "at_fpr10"]
        for figure in FIGURES:
            rooms = [room[name][figure] for room in result["rooms"].values()]
            assert of_it[figure] == pytest.approx(np.mean(rooms))
            assert of_it["worst"][figure] in (min(rooms), max(rooms))
        off_edges = [rooms_off_edge.auc for rooms_off_edge in scores[name].rooms_off_edges.values()]
        assert of_it["off_edges"]["auc"] == pytest.approx(np.mean(off_edges))
    between = evaluate.differences(scores, seed=4)["good"]["dim"]
    assert result["differences"]["good"]["dim"]["auc"] == dataclasses.asdict(between["auc"])
    gain = result["methods"]["good"]["auc"] - result["methods"]["dim"]["auc"]
    assert result["differences"]["good"]["dim"]["auc"]["mean"] == pytest.approx(gain)
    assert set(result["differences"]["good"]["dim"]["auc"]) == {
        *("mean", "low", "high", "rooms", "above"),
    }


def test_one_room_or_one_method_has_no_differences():
    of_room = predictions(0.5, scenes=2, rooms=1)
    one_room = {"a": evaluate.scores(of_room), "b": evaluate.scores(of_room)}
    assert "differences" not in evaluate.figures(one_room, seed=0)
    alone = evaluate.figures({"a": evaluate.scores(predictions(0.5))}, seed=0)
    assert alone["differences"] == {}


def test_curves_of_every_method_are_drawn():
    scores = {f"method {n}": evaluate.scores(predictions(n / 4)) for n in range(4)}
    all_of_them = shown(pictures.curves(scores))
    item = shown(pictures.curves({"method 3": scores["method 3"]}))
    assert all_of_them.shape == item.shape
    assert (all_of_them != item).any(axis=2).mean() > 1e-3


@pytest.fixture
def sheets(monkeypatch: pytest.MonkeyPatch) -> list[list[list[str]]]:
    """Titles of the panels of each drawn sheet, by row."""
    result: list[list[list[str]]] = []
    draw = sheet.draw

    def spied(rows, shape, **how):
        result.append([[panel.draw.keywords["title"] for panel in row] for row in rows])
        assert shape == SHAPE
        return draw(rows, shape, **how)

    monkeypatch.setattr(sheet, "draw", spied)
    return result


def test_scenes_show_reference_holes_and_every_method(sheets):
    methods = {"dim": predictions(0.3, scenes=2), "good": predictions(0.9, scenes=2)}
    shown(pictures.scenes(methods))
    assert len(sheets) == 1
    assert sorted(sheets[0]) == [
        [f"scene{n}: reference", "no depth", "dim", "good"] for n in range(2)
    ]


def test_scenes_with_the_most_holes_missed_by_the_last_method_come_first(sheets):
    """Five times n holes of scene n are missed."""
    several = []
    for number, item in enumerate(predictions(1.0, scenes=6, rooms=6)):
        counted = item.example.counted
        assert counted is not None
        holes = np.flatnonzero((item.probability > 0) & counted)
        probability = item.probability.copy().ravel()
        assert len(holes) > 25
        probability[holes[: number * 5]] = 0.49
        several.append(HolePrediction(example=item.example, probability=probability.reshape(SHAPE)))
    blind = [HolePrediction(example=o.example, probability=0 * o.probability) for o in several]
    shown(pictures.scenes({"blind": blind, "last": several}))
    assert [row[0] for row in sheets[0]] == [f"scene{n}: reference" for n in (5, 4, 3, 2)]
