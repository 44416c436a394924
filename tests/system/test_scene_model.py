"""Scene models: simulations depend on the requested effects and on nothing else."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from starling.diagnosis.howfar import evaluation
from starling.diagnosis.scenes import observation
from starling.diagnosis.scenes.observation import FullObservation, SceneObservation, expect
from starling.diagnosis.scenes.request import CAPTURED, Request, Source, simulation
from starling.diagnosis.scenes.scene_model import SceneModel, build_scene_model
from starling.diagnosis.which import null
from starling.diagnosis.which import table as feature_table
from starling.diagnosis.which.candidates import Segment, candidates
from starling.diagnosis.which.model import SUFFICIENT_SHARE
from starling.diagnosis.which.response import PredictedChange
from starling.diagnosis.which.table import FeatureTable, build_feature_table, compute_row
from starling.sim.effects.effect import Value
from starling.sim.scene.builtin import scenes as builtin
from starling.sim.scene.scene import Scene
from starling.sim.sensor import presets
from starling.sim.sensor.edits import with_values
from starling.sim.sensor.sensor import Sensor

DETECTABLE = 0.02  # Change of a feature above the model error of the simulator.


def sensor(*edits: tuple[str, Any]) -> Sensor:
    d435 = dataclasses.replace(
        presets.load("d435"), width=160, height=96, cx_px=80.0, cy_px=48.0, fx_px=100.0, fy_px=100.0
    )
    return with_values(d435, list(edits))


def model_of(
    camera: Sensor, scene: Scene | None = None, real: SceneObservation = observation.NOT_CAPTURED
) -> SceneModel:
    scene = builtin.clutter(1) if scene is None else scene
    return build_scene_model(scene, camera, name="a", room="a", truth_m=None, real=real, frames=1)


def test_rows_of_moving_sensors_do_not_depend_on_earlier_rows():
    """With motion, rendering depends on the exposure."""
    moves: dict[str, Any] = {"motion": 3.0}
    longer: dict[str, Any] = {"motion": 3.0, "exposure": 0.033}
    camera = sensor(("imager.auto_exposure_level", 0.0), ("imager.exposure_s", 0.008))
    model = model_of(camera)
    columns = build_feature_table([model], Segment.IMAGE).columns

    def row(settings: dict[str, Any]) -> np.ndarray:
        return compute_row(model, columns, simulation(Source.INFRARED, settings))

    first = [row(moves), row(longer)]
    model._last.clear()
    second = [row(longer), row(moves)][::-1]
    np.testing.assert_array_equal(first, second)
    assert np.nanmax(np.abs(first[0] - first[1])) > DETECTABLE


def test_cached_rows_belong_to_one_scene_including_its_parts_out_of_view(tmp_path: Path):
    wall = builtin.wall(1.0)
    board = dataclasses.replace(
        wall.bodies[0],
        name="board",
        mesh=dataclasses.replace(
            wall.bodies[0].mesh, vertices=wall.bodies[0].mesh.vertices - np.float32([0, 0, 9])
        ),
    )
    more = dataclasses.replace(wall, bodies=(*wall.bodies, board))
    tables = [
        build_feature_table([model_of(sensor(), scene)], Segment.IMAGE, cache=tmp_path)
        for scene in (wall, more)
    ]
    base_rows = [table.rows(table.request({})) for table in tables]
    np.testing.assert_array_equal(*base_rows)  # The board is behind the camera.
    assert tables[0]._digests != tables[1]._digests


def test_cached_rows_belong_to_one_version_of_the_features(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    model = model_of(sensor(), builtin.wall(1.0))
    again = [build_feature_table([model], Segment.IMAGE, cache=tmp_path) for _ in range(3)]
    assert again[0]._digests == again[1]._digests
    monkeypatch.setattr(feature_table, "FEATURES_VERSION", feature_table.FEATURES_VERSION + 1)
    assert again[0]._digests != again[2]._digests


def test_the_expected_image_has_no_speckle_or_flicker():
    """Their realisation is common to all scenes, so bins and residuals would show it in each."""
    quiet = sensor(("projector.speckle_contrast", 0.0), ("projector.flicker", 0.0))
    loud = sensor(("projector.speckle_contrast", 0.25), ("projector.flicker", 0.3))
    first, second = (model_of(camera).strata.expected for camera in (quiet, loud))
    np.testing.assert_array_equal(first, second)


def test_another_device_with_as_many_faulty_dots_is_no_gap():
    faulty = sensor(("projector.dropped_dots", 0.05))
    table = build_feature_table([model_of(faulty)], Segment.IMAGE)
    base = null.simulate_base(table)
    ones = np.ones(len(table.names))
    second = table.rows(table.request({}, seed=50, device=50))
    likelihood = base.likelihood(second, ones)
    one_device = null.BaseSamples(
        np.stack([table.rows(table.request({}, seed=seed)) for seed in range(null.SEEDS)]),
        base.floor,
    )
    gap = one_device.likelihood(second, ones)
    assert likelihood.size(likelihood.no_change) < 2 * null.noise_size(base, ones)
    assert gap.size(gap.no_change) > 5 * null.noise_size(one_device, ones)


def test_bits_that_only_the_matcher_reads_are_an_effect_on_depth():
    scenes = [builtin.clutter(number) for number in (1, 2)]
    ten = [model_of(sensor(), scene) for scene in scenes]
    eight = sensor(("imager.dropped_bits", 0))
    scene_models = [
        model_of(eight, scene, model.observe(Request(source=Source.BOTH, seed=5)))
        for scene, model in zip(scenes, ten, strict=True)
    ]
    table = build_feature_table(scene_models, Segment.DEPTH)
    change = table.change({"dropped_bits": 2.0})
    base = null.simulate_base(table)
    likelihood = base.likelihood(table.rows(CAPTURED), np.ones(len(table.names)))
    assert change is not None
    gap = np.nan_to_num(likelihood.gap)
    assert np.mean(np.clip(gap / base.deviation, -10, 10) ** 2) > 1
    unlike = [number for number, name in enumerate(table.names) if name.startswith("unlike.")]
    measured, expected = gap[:, unlike], change[:, unlike]
    cosine = np.sum(measured * expected) / np.sqrt(np.sum(measured**2) * np.sum(expected**2))
    assert cosine > 0.9
    assert _gain(table, {"dropped_bits": 2.0}) > null.LEAST_GAIN
    for segment, tried in ((Segment.IMAGE, False), (Segment.DEPTH, True), (Segment.WHOLE, True)):
        names = [candidate.name for candidate in candidates(eight, scenes[0], segment)]
        assert ("dropped_bits" in names) is tried


def test_devices_share_renderings_except_for_their_faulty_dots():
    model = model_of(sensor())
    columns = build_feature_table([model], Segment.IMAGE).columns
    for name, shared in (("dot_blur", True), ("dropped_dots", False)):
        settings: dict[str, Any] = {name: 0.3, "hot_pixels": 0.01}
        device = simulation(Source.INFRARED, settings, seed=1, device=1)
        alone = compute_row(model_of(sensor()), columns, device)
        assert compute_row(model, columns, simulation(Source.INFRARED, settings)).size
        (layers,) = model._last.values()
        np.testing.assert_array_equal(compute_row(model, columns, device), alone)
        assert (next(iter(model._last.values())) is layers) is shared


def test_the_noise_floor_is_that_of_another_device():
    """Dots dropped at other places are as far from the real ones as those of the simulation."""
    model = model_of(sensor())
    settings: dict[str, Any] = {"dropped_dots": 0.3}
    real = model.observe(simulation(Source.BOTH, settings, seed=7, device=7))
    captured = dataclasses.replace(model, real=real)
    _, after, floor = evaluation._distances(captured, evaluation._draws(captured, {}), settings)
    assert after["ndp_1_iou"] == pytest.approx(floor["ndp_1_iou"], rel=0.15)


def test_an_effect_that_only_scatters_depth_explains_nothing():
    """It would, if the distance of device depth from our matcher's were a feature.

    That distance is zero in simulation, so any effect on depth would increase it. A coarser unit
    widens some spreads of the error; that gain does not even suffice for a single effect.
    """
    rng = np.random.default_rng(3)
    scenes = [builtin.clutter(number) for number in (1, 2)]
    scene_models = [model_of(sensor(("imager.dropped_bits", 0)), scene) for scene in scenes]
    for model in scene_models:
        captured = expect(model.observe(Request(source=Source.BOTH, seed=5)), FullObservation)
        scatter = 0.1 * rng.standard_normal(captured.device_px.shape).astype(np.float32)
        device_px = (captured.device_px + scatter).astype(np.float32)
        device_px = observation.quantise_depth(device_px, model.sensor)
        model.real = dataclasses.replace(captured, device_px=device_px)
    scattered = build_feature_table(scene_models, Segment.DEPTH)
    assert _gain(scattered, {"depth_unit": 0.00101}) < SUFFICIENT_SHARE * null.LEAST_GAIN
    for model in scene_models:
        model.real = model.observe(simulation(Source.REMATCHED, {"median": 0}))
    assert _gain(build_feature_table(scene_models, Segment.DEPTH), {"median": 0}) > 100


def _gain(table: FeatureTable, settings: dict[str, Value]) -> float:
    likelihood = null.simulate_base(table).likelihood(
        table.rows(CAPTURED), np.ones(len(table.names))
    )
    change = table.change(settings)
    assert change is not None
    changes = (likelihood.no_change, PredictedChange(change))
    cost = [likelihood.cost(predicted).sum() for predicted in changes]
    return float(cost[0] - cost[1])
