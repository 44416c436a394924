"""Memory of a diagnosis: arrays of few scenes at a time, with the results of all in memory."""

from __future__ import annotations

import gc
import weakref
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from starling.diagnosis.howfar import evaluation
from starling.diagnosis.scenes import observation, shelf
from starling.diagnosis.scenes.request import CAPTURED, Request, Source
from starling.diagnosis.scenes.scene_model import SceneModel
from starling.diagnosis.scenes.shelf import MOST_HELD
from starling.diagnosis.where.location import locate_gap
from starling.diagnosis.where.remainder import remainder_places
from starling.diagnosis.which.candidates import Segment
from starling.diagnosis.which.table import build_feature_table
from starling.sim.console import record
from starling.sim.scene.builtin import scenes as builtin
from tests.system.test_scene_model import model_of, sensor

pytestmark = pytest.mark.long  # Nine scenes, rendered several times.

COUNT = 2 * MOST_HELD + 1
EFFECTS: tuple[dict[str, Any], ...] = ({"gamma": 1.2}, {"dot_blur": 0.3}, {"read_noise": 6.0})


@pytest.fixture
def own_shelf(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shelf, "_shelf", shelf._Shelf())
    shelf.use_folder(tmp_path)


def captured(count: int) -> list[SceneModel]:
    """Build scenes of four rooms with simulated captures."""
    camera, models = sensor(), []
    for number in range(count):
        model = model_of(camera, builtin.clutter(number % 3))
        model.name, model.room = f"scene {number}", f"room {number % 4}"
        model.real = model.observe(Request(source=Source.BOTH, seed=7 + number))
        models.append(model)
    return models


def results(scenes: list[SceneModel]) -> Any:
    """Compute what a diagnosis computes from the arrays of scenes."""
    rows = []
    for segment in (Segment.IMAGE, Segment.DEPTH):
        table = build_feature_table(scenes, segment)
        rows += [table.rows(request) for request in (table.request({}), CAPTURED)]
    image = build_feature_table(scenes, Segment.IMAGE)
    for settings in EFFECTS:
        rows += [
            image.rows(image.request(settings, seed=device, device=device)) for device in (0, 1)
        ]
    places = remainder_places(scenes, EFFECTS[0], ["image", "depth"])
    draws = [evaluation._draws(scene, {}) for scene in scenes]
    distances = [
        evaluation._distances(scene, each, EFFECTS[0])
        for scene, each in zip(scenes, draws, strict=True)
    ]
    maps = [each.maps for each in places.values()]
    return record.content([rows, locate_gap(scenes), places, maps, distances])


def test_results_do_not_depend_on_the_number_of_scenes_in_memory(
    own_shelf: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shelf, "MOST_HELD", 100)
    expected = results(captured(5))
    monkeypatch.setattr(shelf, "MOST_HELD", 1)
    assert results(captured(5)) == expected


def test_arrays_of_few_scenes_are_in_memory(own_shelf: None) -> None:
    scenes = captured(COUNT)
    table = build_feature_table(scenes, Segment.IMAGE)
    table.rows(table.request(EFFECTS[1]))
    locate_gap(scenes)
    arrays = []
    for scene in scenes:
        layers, real = scene._layers, observation.expect(scene.real, observation.FullObservation)
        rendered = [each.left.ambient for each in (layers, *scene._last.values())]
        arrays += map(weakref.ref, [*rendered, scene.strata.expected, real.left, real.device_px])
    del scene, layers, real, rendered
    gc.collect()
    assert len(arrays) == 5 * COUNT
    assert sum(array() is not None for array in arrays) <= 5 * MOST_HELD
    rows = sum(row.nbytes for row in table._rows.values())
    assert rows <= 2 * COUNT * 8 * len(table.names)
    assert np.isfinite(table.rows(CAPTURED)).any()
