"""Geometry fits of small simulated sensors: recovered, undetermined or refused.

Simulation and fit use different seeds and sub-pixel positions.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import cv2
import numpy as np
import pytest

from starling.calibration import parameters
from starling.calibration.geometry import geometry_fit, residuals, start
from starling.calibration.observation import Observation
from starling.patterns.errors import InputError
from starling.sim import metrics
from starling.sim.captures import writer
from starling.sim.render import direct
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.scene.builtin import scenes as builtin
from starling.sim.scene.scene import Scene
from starling.sim.sensor import presets
from starling.sim.sensor.edits import with_values
from starling.sim.sensor.sensor import Sensor
from starling.sim.simulate import infrared

FREE = ("baseline", "focal", "projector")


def preset() -> Sensor:
    """Return a D435 of 320x180, with dots 1.3 px wide."""
    sensor = presets.load("d435")
    scale = 320 / sensor.width
    values = {
        "width": 320,
        "height": 180,
        "fx_px": sensor.fx_px * scale,
        "fy_px": sensor.fy_px * scale,
        "cx_px": 159.5,
        "cy_px": 89.5,
        "imager.pixel_pitch_m": sensor.left.pixel_pitch_m / scale,
    }
    return with_values(sensor, values.items())


def unit(sensor: Sensor) -> Sensor:
    """Return a device whose parameters are off within the tolerances."""
    part = sensor.projector
    return parameters.with_values(
        sensor,
        [
            ("baseline_m", sensor.baseline_m + 2.1e-3),
            ("fx_px", sensor.fx_px * 1.007),
            ("projector.position_m.x", part.position_m[0] - 3.3e-3),
            ("projector.position_m.y", 2.5e-3),
            ("projector.position_m.z", -3.9e-3),
            ("projector.rotation_deg.x", 0.8),
            ("projector.rotation_deg.y", -0.7),
            ("projector.rotation_deg.z", 0.9),
            ("projector.power_w", 1.6 * part.power_w),
        ],
    )


def observed(scenes: Sequence[Scene], truth: Sensor, **changes: object) -> list[Observation]:
    """Simulated captures of scenes known in metres."""
    observations = []
    for number, scene in enumerate(scenes):
        layers = direct.layers(MitsubaScene(scene), truth, subpixels=3)
        pair = infrared(layers, scene, truth, seed=40 + number)
        assert pair.right is not None
        seen = Observation(
            name=scene.name,
            room=scene.name,
            info=writer.info_of(preset(), source="a test", licence="", notes=""),
            left=pair.left.astype(np.float32),
            right=pair.right.astype(np.float32),
            truth_m=layers.truth.depth_m,
            scene=scene,
            metric=True,
        )
        observations.append(dataclasses.replace(seen, **changes))
    return observations


@pytest.fixture(scope="module")
def table() -> list[Observation]:
    """One unit's captures of a table."""
    return observed([builtin.tabletop(3)], unit(preset()))


def test_window_matching_finds_distant_dots(table: list[Observation]) -> None:
    """The initial values are within 15 % of the tolerances, a few hundredths of a pixel."""
    sensor, truth = preset(), unit(preset())
    rows = parameters.free(FREE, sensor)
    initial = start.find_start(residuals.make_views(table, sensor), sensor, rows)
    assert initial.correlation > 0.5
    fitted = start.apply_step(sensor, rows, initial.step)
    for row in rows:
        off = parameters.value(fitted, row.name) - parameters.value(truth, row.name)
        assert abs(off) < 0.15 * row.tolerance, row.name


@pytest.mark.long
def test_a_device_is_recovered(table: list[Observation]) -> None:
    """One scene of 320x180 meets the limits for three scenes of 640x360."""
    truth = unit(preset())
    solution = geometry_fit.fit_geometry(table, preset(), free=FREE)
    limits = {"baseline_m": 3e-5, "fx_px": 1e-3 * truth.fx_px}
    for estimate in solution.estimates:
        off = estimate.value - parameters.value(truth, estimate.name)
        limit = limits.get(estimate.name, 1.5e-4 if "position" in estimate.name else 0.01)
        assert abs(off) < limit, estimate.name
        assert abs(off) < 4 * estimate.sd < 4 * limit, estimate.name
    assert solution.undetermined == ()
    # Weights are recomputed at each step, so the cost hardly changes.
    assert solution.cost[0] > 0.999 and solution.cost[-1] == 1
    (both,) = (estimate for estimate in solution.derived if estimate.name == "focal_baseline_px_m")
    assert abs(both.value - truth.focal_baseline_px_m) < 4 * both.sd
    np.testing.assert_allclose(np.diagonal(solution.correlation), 1)


@pytest.mark.long
def test_one_wall_leaves_directions_undetermined() -> None:
    """A single fronto-parallel wall does not separate the projector's position and rotation."""
    wall = observed([builtin.wall(1.0)], unit(preset()))
    solution = geometry_fit.fit_geometry(wall, preset(), free=(*FREE, "centre", "alignment"))
    assert solution.undetermined
    named = " ".join(solution.undetermined)
    assert "cx_px" in named and "projector." in named
    opened = {estimate.name for estimate in solution.estimates if not np.isfinite(estimate.sd)}
    assert opened
    assert np.isfinite(solution.correlation).all()


def test_captures_without_the_dots_are_refused(table: list[Observation]) -> None:
    noise = np.random.default_rng(0).random((180, 320), np.float32) * 100
    dark = [dataclasses.replace(table[0], left=noise, right=noise[::-1].copy())]
    with pytest.raises(InputError, match="captures must show the sensor's dots"):
        geometry_fit.fit_geometry(dark, preset(), free=("baseline",))


def test_captures_that_cannot_be_fitted_are_refused(table: list[Observation]) -> None:
    with pytest.raises(InputError, match="captures must hold a scene"):
        geometry_fit.fit_geometry([], preset())
    for missing in ("scene", "left"):
        with pytest.raises(InputError, match="must have infrared images and a posed mesh"):
            geometry_fit.fit_geometry([dataclasses.replace(table[0], **{missing: None})], preset())


def test_gamma_is_inverted_and_saturation_masked(table: list[Observation]) -> None:
    """Levels are linear in light, and saturated pixels are not used."""
    left = np.full((180, 320), 255, np.float32)
    left[:90] = 104
    sensor = with_values(preset(), [("left.gamma", 2.0), ("left.black_level_dn", 4.0)])
    view = residuals.make_views([dataclasses.replace(table[0], left=left)], sensor)[0]
    np.testing.assert_allclose(view.level[:90], 255 * (100 / 255) ** 2, rtol=1e-4)
    assert view.usable[:90].all() and not view.usable[90:].any()


def test_pixels_near_edges_and_saturated_ones_are_unusable(table: list[Observation]) -> None:
    sensor = preset()
    view = residuals.make_views(table, sensor)[0]
    plain = residuals.predict(view, sensor)
    edges = metrics.depth_edges(plain.disparity_px)
    near_edges = cv2.dilate(edges.astype(np.uint8), np.ones((7, 7), np.uint8)) > 0
    assert edges.any() and not plain.usable[near_edges].any()
    row, column = np.argwhere(cv2.erode(plain.usable.astype(np.uint8), np.ones((3, 3))))[50]
    usable = view.usable.copy()
    usable[row, column] = False
    result = residuals.predict(dataclasses.replace(view, usable=usable), sensor).usable
    expected = plain.usable.copy()
    expected[row - 1 : row + 2, column - 1 : column + 2] = False
    np.testing.assert_array_equal(result, expected)


def test_another_body_in_a_tile_does_not_count(table: list[Observation]) -> None:
    """Doubling the reflectance of one body hardly changes the step."""
    sensor = unit(preset())
    view = residuals.make_views(table, sensor)[0]
    predicted = residuals.predict(view, sensor, parameters.free(("baseline", "focal"), sensor))
    size = residuals.tile_px([predicted])
    assert 12 <= size <= 48
    normal = residuals.normal_equations(predicted, size_px=size, blur_px=0.0, variance=None)
    bodies, counts = np.unique(predicted.body[predicted.usable], return_counts=True)
    chosen = bodies[np.argsort(counts)[-2]]
    level = np.where(predicted.body == chosen, 2 * view.level, view.level)
    bright = dataclasses.replace(predicted, view=dataclasses.replace(view, level=level))
    bright_normal = residuals.normal_equations(
        bright, size_px=size, blur_px=0.0, variance=normal.variances[0]
    )
    step, moved = (
        -np.linalg.solve(equations.information + np.eye(2), equations.gradient)
        for equations in (normal, bright_normal)
    )
    assert np.abs(moved - step).max() < 0.02  # In tolerances.
