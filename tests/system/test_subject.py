"""Scenes under diagnosis: what is simulated of them depends on what is asked, and nothing else."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from starling.diagnosis.howfar import evaluation
from starling.diagnosis.scenes import observation
from starling.diagnosis.scenes.observation import Reading
from starling.diagnosis.scenes.scene_model import Subject, of_scene
from starling.diagnosis.which import null, rows
from starling.diagnosis.which import table as bench
from starling.diagnosis.which.candidates import Arm, candidates
from starling.diagnosis.which.predicted import Made
from starling.sim.effects.effect import Value
from starling.sim.scene.builtin import scenes as builtin
from starling.sim.scene.scene import Scene
from starling.sim.sensor import presets
from starling.sim.sensor.edits import with_values
from starling.sim.sensor.sensor import Sensor

NOTHING = Reading(left=None, right=None, ours_px=None, device_px=None)
SHOWN = 0.02  # Change of a feature that is above what the simulator is taken to be wrong by.


def sensor(*edits: tuple[str, Any]) -> Sensor:
    d435 = dataclasses.replace(
        presets.load("d435"), width=160, height=96, cx_px=80.0, cy_px=48.0, fx_px=100.0, fy_px=100.0
    )
    return with_values(d435, list(edits))


def subject(of: Sensor, scene: Scene | None = None, real: Reading = NOTHING) -> Subject:
    scene = builtin.clutter(1) if scene is None else scene
    return of_scene(scene, of, name="a", room="a", truth_m=None, real=real, frames=1)


def test_rows_of_moving_sensors_do_not_depend_on_what_was_asked_before():
    """How long it exposes has a part in what is rendered."""
    moves: dict[str, Any] = {"motion": 3.0}
    longer: dict[str, Any] = {"motion": 3.0, "exposure": 0.033}
    of = subject(sensor(("imager.auto_exposure_level", 0.0), ("imager.exposure_s", 0.008)))
    columns = bench.bench([of], Arm.IMAGE).columns

    def row(settings: dict[str, Any]) -> np.ndarray:
        found = rows.simulated_row(of, columns, settings, 0)
        assert found is not None
        return found

    first = [row(moves), row(longer)]
    of._last.clear()
    other = [row(longer), row(moves)][::-1]
    np.testing.assert_array_equal(first, other)
    assert np.nanmax(np.abs(first[0] - first[1])) > SHOWN


def test_kept_rows_are_of_one_scene_whatever_it_holds_out_of_view(tmp_path: Path):
    wall = builtin.wall(1.0)
    board = dataclasses.replace(
        wall.bodies[0],
        name="board",
        mesh=dataclasses.replace(
            wall.bodies[0].mesh, vertices=wall.bodies[0].mesh.vertices - np.float32([0, 0, 9])
        ),
    )
    more = dataclasses.replace(wall, bodies=(*wall.bodies, board))
    benches = [
        bench.bench([subject(sensor(), one)], Arm.IMAGE, cache=tmp_path) for one in (wall, more)
    ]
    rows = [one.simulated({}) for one in benches]
    np.testing.assert_array_equal(*rows)  # It stands behind the camera.
    assert benches[0]._digests != benches[1]._digests


def test_what_is_expected_is_without_speckle_and_flicker():
    """Their draw is one for all scenes: bins and residuals would show it in every one."""
    quiet = sensor(("projector.speckle_contrast", 0.0), ("projector.flicker", 0.0))
    loud = sensor(("projector.speckle_contrast", 0.25), ("projector.flicker", 0.3))
    one, other = (subject(of).ground.expected for of in (quiet, loud))
    np.testing.assert_array_equal(one, other)


def test_another_device_with_as_many_faulty_dots_is_no_gap():
    faulty = sensor(("projector.dropped_dots", 0.05))
    of = subject(faulty)
    table = bench.bench([of], Arm.IMAGE)
    base = null.base(table)
    ones = np.ones(len(table.names))
    other = table.another({}, number=50)
    assert other is not None
    likelihood = base.likelihood(other, ones)
    same = null.Base(
        np.stack([table.simulated({}, seed=seed) for seed in range(null.SEEDS)]), base.floor
    )
    before = same.likelihood(other, ones)
    assert likelihood.size(likelihood.nothing) < 2 * null.size(base, ones)
    assert before.size(before.nothing) > 5 * null.size(same, ones)


def test_bits_that_only_the_device_reads_are_an_effect_of_its_depth():
    scenes = [builtin.clutter(number) for number in (1, 2)]
    ten = [subject(sensor(), one) for one in scenes]
    eight = sensor(("imager.dropped_bits", 0))
    subjects = [
        subject(eight, one, of.capture({}, seed=5)) for one, of in zip(scenes, ten, strict=True)
    ]
    table = bench.bench(subjects, Arm.DEPTH)
    made = table.change({"dropped_bits": 2.0})
    base = null.base(table)
    likelihood = base.likelihood(table.real(), np.ones(len(table.names)))
    assert made is not None
    gap = np.nan_to_num(likelihood.gap)
    assert np.mean(np.clip(gap / base.deviation, -10, 10) ** 2) > 1
    unlike = [number for number, name in enumerate(table.names) if name.startswith("unlike.")]
    told, expected = gap[:, unlike], made[:, unlike]
    cosine = np.sum(told * expected) / np.sqrt(np.sum(told**2) * np.sum(expected**2))
    assert cosine > 0.9
    assert _gained(table, {"dropped_bits": 2.0}) > null.LEAST_GAIN
    for arm, tried in ((Arm.IMAGE, False), (Arm.DEPTH, True), (Arm.WHOLE, True)):
        names = [one.name for one in candidates(eight, scenes[0], arm)]
        assert ("dropped_bits" in names) is tried


def test_devices_share_what_is_rendered_but_for_their_faulty_dots():
    of = subject(sensor())
    columns = bench.bench([of], Arm.IMAGE).columns
    for name, shared in (("dot_blur", True), ("dropped_dots", False)):
        settings: dict[str, Any] = {name: 0.3, "hot_pixels": 0.01}
        alone = rows.another_row(subject(sensor()), columns, settings, 1)
        assert rows.simulated_row(of, columns, settings, 0) is not None
        (layers,) = of._last.values()
        np.testing.assert_array_equal(rows.another_row(of, columns, settings, 1), alone)
        assert (next(iter(of._last.values())) is layers) is shared


def test_floor_is_another_device_s():
    """Dots that are dropped elsewhere are no closer to the real ones than those of the fit."""
    of = subject(sensor())
    settings: dict[str, Any] = {"dropped_dots": 0.3}
    real = of.another(7).capture(settings, seed=7)
    taken = dataclasses.replace(of, real=real)
    _, after, floor = evaluation._figures(taken, settings)
    assert after["ndp_1_iou"] == pytest.approx(floor["ndp_1_iou"], rel=0.15)


def test_what_makes_depth_another_but_not_the_devices_explains_nothing():
    """It did where it was asked how far the device's depth is from our matcher's: that is nothing
    where our matcher is simulated, so anything helped, the more so by what it may be wrong by.
    """
    rng = np.random.default_rng(3)
    scenes = [builtin.clutter(number) for number in (1, 2)]
    subjects = [subject(sensor(("imager.dropped_bits", 0)), one) for one in scenes]
    for one in subjects:
        own = one.capture({}, seed=5)
        assert own.device_px is not None
        scatter = 0.1 * rng.standard_normal(own.device_px.shape).astype(np.float32)
        device_px = observation.written((own.device_px + scatter).astype(np.float32), one.sensor)
        one.real = dataclasses.replace(own, device_px=device_px)
    scattered = bench.bench(subjects, Arm.DEPTH)
    assert _gained(scattered, {"depth_unit": 0.00101}) < 0
    for one in subjects:
        one.real = one.rematch({"median": 0})
    assert _gained(bench.bench(subjects, Arm.DEPTH), {"median": 0}) > 100


def _gained(table: bench.Bench, settings: dict[str, Value]) -> float:
    likelihood = null.base(table).likelihood(table.real(), np.ones(len(table.names)))
    change = table.change(settings)
    assert change is not None
    cost = [likelihood.cost(made).sum() for made in (likelihood.nothing, Made(change))]
    return float(cost[0] - cost[1])
