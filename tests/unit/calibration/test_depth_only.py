"""Calibration from depth and missing depth of simulated captures, without infrared images."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from starling.calibration.depth import depth_only, hole_places
from starling.calibration.depth.depth_twin import render_twin
from starling.calibration.depth.disparity_scale import DisparityPair
from starling.calibration.observation import Observation
from starling.patterns import InputError
from starling.sim import simulate
from starling.sim.captures import writer
from starling.sim.effects import setting
from starling.sim.scene import sources
from starling.sim.sensor import presets
from starling.sim.sensor.edits import with_values
from starling.sim.sensor.sensor import Sensor
from starling.sim.stereo.depth import disparity_from_depth, from_code, to_code

TRUE = {  # Effects of the true sensor, relative to the preset.
    "baseline_error": 0.012,
    "disparity_offset": -0.3,
    "laser_speckle": 0.45,
    "uniqueness": 30.0,
    "texture_threshold": 0.8,
    "left_right_threshold": 0.4,
}


def _preset(width: int = 640) -> Sensor:
    """A D415 of fewer pixels, 16:9."""
    share, whole = width / 1280, presets.load("d415")
    return dataclasses.replace(
        whole,
        width=width,
        height=width * 9 // 16,
        **{name: getattr(whole, name) * share for name in ("fx_px", "fy_px", "cx_px", "cy_px")},
    )


def _observed(
    name: str, sensor: Sensor, settings: dict[str, float], *, seed: int, mesh: bool
) -> Observation:
    """Simulate a builtin scene with given effects; depth and reference in whole millimetres."""
    scene = sources.load(name, sensor)
    shot = simulate.simulate(scene, setting.on_sensor(sensor, settings), seed=seed)
    depth_m, truth_m = (
        from_code(to_code(z, 1e-3), 1e-3) for z in (shot.depth.depth_m, shot.layers.truth.depth_m)
    )
    return Observation(
        name=name,
        room=name,
        info=writer.info_of(sensor, source="made", licence="Apache-2.0", notes=""),
        depth_m=depth_m,
        truth_m=truth_m,
        scene=scene if mesh else None,
        metric=mesh,
    )


UNSEEN = (
    *(f"clutter:{number}" for number in (2, 3, 4, 5, 6, 7, 9, 10)),
    *(f"tabletop:{number}" for number in (5, 6, 7, 8)),
)


@pytest.mark.long
@pytest.mark.parametrize("mesh", [True, False])
def test_depth_parameters_are_recovered(mesh: bool) -> None:
    """f b is within 0.05 %, and the offset within 0.02 px.

    On twelve held-out scenes, the mean NMAD is within 10 % and the gap of hole rates is halved.
    With meshes the reflectance is known; otherwise a grey is assumed. In that case the texture and
    uniqueness thresholds absorb the error of the assumption and are not recovered. Device and
    simulation share the matcher, so the test does not validate a real matcher.
    """
    preset = _preset()
    names = ("clutter:1", "tabletop:2", "clutter:8", "tabletop:9", "clutter:11", "tabletop:10")
    fitted = [
        _observed(name, preset, TRUE, seed=100 + n, mesh=mesh) for n, name in enumerate(names)
    ]
    solution = depth_only.fit_depth(fitted, preset)
    estimates = {estimate.name: estimate for estimate in solution.estimates}

    true_fb = preset.focal_baseline_px_m * (1 + TRUE["baseline_error"])
    assert estimates["focal_baseline"].value == pytest.approx(true_fb, rel=5e-4)
    assert estimates["disparity_offset"].value == pytest.approx(TRUE["disparity_offset"], abs=0.02)
    assert solution.cost[-1] < solution.cost[0]
    if mesh:
        assert solution.cost[-1] < 0.5 * solution.cost[0]
        for name in ("laser_speckle", "texture_threshold"):
            assert abs(estimates[name].value - TRUE[name]) < 3 * estimates[name].sd
    assert any(line.startswith("Focal length and baseline") for line in solution.undetermined)
    assert solution.covariance.shape == (6, 6)

    held = [
        render_twin(_observed(name, preset, TRUE, seed=200 + n, mesh=mesh), preset, seed=50 + n)
        for n, name in enumerate(UNSEEN)
    ]
    rows = hole_places.compare_readings(held, preset, solution.sensor)
    row = {key: np.mean([figures[key] for figures in rows.values()]) for key in rows["clutter:3"]}
    assert row["nmad_px_after"] == pytest.approx(row["nmad_px_device"], rel=0.1)
    gap = {
        side: abs(row[f"ndp_rate_{side}"] - row["ndp_rate_device"]) for side in ("before", "after")
    }
    assert gap["after"] < 0.5 * gap["before"]
    assert row["ndp_iou_after"] > row["ndp_iou_before"]


def test_one_wall_does_not_separate_scale_from_offset() -> None:
    preset = _preset(320)
    wall = _observed("wall:1", preset, {"disparity_offset": -0.2}, seed=0, mesh=False)
    solution = depth_only.fit_depth([wall], preset, free=("baseline", "offset"))
    assert all(np.isinf(estimate.sd) for estimate in solution.estimates)
    assert any("cannot be separated" in line for line in solution.undetermined)
    assert any("scatter between rooms" in line for line in solution.undetermined)


def test_a_surface_from_reference_depth_keeps_its_position() -> None:
    """The surface is within 0.05 px of the reference, and fills a hole in it."""
    preset = _preset(320)
    seen = _observed("wall:1", preset, {}, seed=0, mesh=False)
    assert seen.truth_m is not None
    seen.truth_m[80:84, 200:204] = np.nan
    geometry = {"focal_px": preset.fx_px, "baseline_m": preset.baseline_m}
    truth_px = disparity_from_depth(seen.truth_m, **geometry)
    depth_twin = render_twin(seen, preset)
    assert len(depth_twin.stage.scene.bodies) == 1  # Nothing is behind a wall.
    off = disparity_from_depth(depth_twin.layers.truth.depth_m, **geometry) - truth_px
    assert np.nanmax(np.abs(off)) < 0.05
    assert np.isfinite(depth_twin.layers.truth.depth_m[82, 202])


def test_a_twin_matches_all_converter_bits() -> None:
    """The twin matches all bits of the converter, which matters in weak light."""
    dim = with_values(_preset(320), [("projector.power_w", 0.02)])
    assert dim.left.matched_bits > dim.left.bit_depth
    depth_twin = render_twin(_observed("clutter", dim, {}, seed=0, mesh=True), dim, seed=3)
    shot = simulate.expose(depth_twin.layers, depth_twin.stage.scene, dim, seed=3)
    read_m = from_code(to_code(shot.depth.depth_m, 1e-3), 1e-3)
    np.testing.assert_array_equal(depth_twin.reading(dim), depth_twin.info.disparity_px(read_m))


def _blank(**changes: object) -> Observation:
    """Return a minimal observation that is not rendered."""
    sensor = _preset(320)
    depth = np.full((sensor.height, sensor.width), 1.0, np.float32)
    info = writer.info_of(sensor, source="", licence="", notes="")
    seen = Observation(
        name="a",
        room="a",
        info=info,
        depth_m=depth,
        truth_m=depth,
    )
    return dataclasses.replace(seen, **changes)


def test_unsupported_inputs_are_refused() -> None:
    preset = _preset(320)
    with pytest.raises(InputError, match=r"free must be among .* without infrared; got 'pattern'"):
        depth_only.fit_depth([_blank()], preset, free=("pattern",))
    with pytest.raises(InputError, match=r"captures must not be empty"):
        depth_only.fit_depth([], preset)
    with pytest.raises(InputError, match=r"free must not be empty"):
        depth_only.fit_depth([_blank()], preset, free=())
    with pytest.raises(InputError, match=r"sensor.kind must be stereo without infrared"):
        depth_only.fit_depth([_blank()], presets.load("kinect-v1"))
    foreign = _blank(name="b", info=dataclasses.replace(_blank().info, fx_px=300.0))
    with pytest.raises(InputError, match=r"geometry of b must be that of a"):
        depth_only.fit_depth([_blank(), foreign], preset)
    with pytest.raises(InputError, match=r"scene a must hold depth.png"):
        depth_only.fit_depth([_blank(depth_m=None)], preset)
    with pytest.raises(InputError, match=r"scene a must have truth.png or a mesh in scene.toml"):
        depth_only.fit_depth([_blank(truth_m=None)], preset)


def test_a_reference_of_another_scale_is_refused() -> None:
    """The cause may be a wrong unit or the baseline of a wrong preset."""
    seen = _blank(depth_m=np.full((180, 320), 2.0, np.float32))
    with pytest.raises(InputError, match=r"depth of a must be the reference's .*; got 2 times it"):
        depth_only.fit_depth([seen], _preset(320))


def test_fit_by_simulation_recovers_offset_and_scale() -> None:
    """The iteration recovers offset and scale on a slanted surface."""
    down, along = np.mgrid[0:1:240j, 0:1:320j]
    truth_px = (12 + 30 * (0.4 * down + 0.6 * along)).astype(np.float32)
    noise = np.random.default_rng(0).normal(0, 0.02, truth_px.shape).astype(np.float32)
    start = {"baseline_error": 0.0, "disparity_offset": 0.1}
    sensor = setting.on_sensor(presets.load("d435"), start)
    device = setting.on_sensor(sensor, {"baseline_error": 0.01, "disparity_offset": 0.4})

    class Drawn:
        """A depth twin with disparity from offset and scale only."""

        def reading(self, model: Sensor) -> np.ndarray:
            offset_px = model.right.alignment.offset_x_px
            return (truth_px * (1 + model.baseline_error) - offset_px).astype(np.float32)

        def rendered(self, model: Sensor) -> Drawn:
            return self

        def pair_with(self, expected_px: np.ndarray) -> DisparityPair:
            return DisparityPair(
                name="a",
                room="a",
                device_px=self.reading(device) + noise,
                truth_px=truth_px,
                expected_px=expected_px,
                step_m=1e-5,
                focal_baseline_px_m=24.0,
            )

    drawn: Any = [Drawn()]
    fitted = depth_only.fit_by_simulation(drawn, sensor, ("scale", "offset")).sensor
    assert fitted.baseline_error == pytest.approx(0.01, abs=5e-4)
    assert fitted.right.alignment.offset_x_px == pytest.approx(0.4, abs=0.02)
