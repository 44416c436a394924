"""Patterns recovered from simulated captures, against ground truth."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Literal

import numpy as np
import pytest

from starling import patterns
from starling.calibration import heldout, observation
from starling.calibration.fit_sensor import without_waves
from starling.calibration.observation import Observation
from starling.calibration.pattern import pattern_sensor, pattern_solution, recovery
from starling.calibration.pattern import views as seeing
from starling.calibration.pattern.recovery import RecoveredPattern
from starling.calibration.solution import Estimate, Solution
from starling.patterns.errors import InputError
from starling.sim.captures import capture, png, writer
from starling.sim.render import direct
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.scene.builtin import scenes as builtin
from starling.sim.scene.scene import Scene
from starling.sim.sensor.edits import with_values
from starling.sim.sensor.projector import Emitter
from starling.sim.sensor.sensor import Sensor
from starling.sim.simulate import infrared
from tests.unit.calibration import small_camera

SUBPIXELS = 3  # The fit samples only pixel centres.
PLACE = (0.0285, 7e-4, -1e-3)  # True position; the initial one is 1 to 1.5 mm off.
OFFSETS = ((-2.2e-3, 0.0, 0.0), (2.2e-3, 3e-4, 0.0))  # Offsets of emitters, 4.4 mm apart.
SCALES = (0.998, 1.001, 1.001)  # Pattern scales of the scenes; their mean is 1.
TRUE = {
    "right.alignment.offset_y_px": 0.4,
    "right.alignment.offset_x_px": 0.3,
    "right.alignment.roll_deg": 0.05,
}
SHORTER_M = 2e-4  # Nominal minus true baseline.

Kind = Literal["reference", "metric"]


def _nominal(name: str, width: int) -> Sensor:
    return small_camera.small(name, width, round(width * 9 / 32) * 2)


def _scenes() -> list[Scene]:
    drawn = (builtin.tabletop(1), builtin.clutter(2), builtin.staircase(0.6), builtin.tabletop(7))
    return [dataclasses.replace(scene, interreflection=0.0) for scene in drawn]


def _seen(
    folder: Path,
    truth: Sensor,
    claimed: Sensor,
    scales: tuple[float, ...],
    kind: Kind,
    *,
    drawn: list[Scene] | None = None,
    seed: int = 50,
) -> list[Observation]:
    """Write captures of the true sensor with nominal metadata, and read them."""
    small_camera.write_info(folder, claimed)
    scenes = (drawn or _scenes())[: len(scales)]
    for number, (scene, scale) in enumerate(zip(scenes, scales, strict=True)):
        sensor = with_values(truth, [("projector.pattern_scale", scale)])
        layers = direct.layers(MitsubaScene(scene), sensor, subpixels=SUBPIXELS)
        pair = infrared(layers, scene, sensor, seed=seed + number)
        place = folder / f"scene{number}"
        small_camera.write_scene(place, layers.truth.depth_m, (pair.left, pair.right), claimed)
        (place / "room").write_text(f"room{number}\n")
    observations = [observation.load(scene, claimed) for scene in capture.open_set(folder).scenes]
    if kind == "metric":
        return [
            dataclasses.replace(item, scene=scene, metric=True)
            for item, scene in zip(observations, scenes, strict=True)
        ]
    return observations


def _recovered(observations: list[Observation], sensor: Sensor) -> RecoveredPattern:
    """Recover and refine the pattern as `calibration.fit` does."""
    views = [view for item in observations for view in seeing.make_views(item, sensor)]
    recovered = recovery.recover(views, sensor)
    aligned = pattern_sensor.with_alignment(sensor, recovered.model)
    views = [view for item in observations for view in seeing.make_views(item, aligned)]
    return recovery.refine(recovered, views, aligned)


def _misaligned(sensor: Sensor) -> Sensor:
    return with_values(
        sensor,
        [*TRUE.items(), ("baseline_m", sensor.baseline_m - SHORTER_M)],
    )


@dataclasses.dataclass(frozen=True)
class Case:
    """A recovered pattern with its true sensor."""

    start: Sensor
    truth: Sensor
    recovered: RecoveredPattern
    solution: Solution

    def estimate(self, name: str) -> Estimate:
        """Return an estimate of the solution, including derived ones."""
        by_name = {item.name: item for item in (*self.solution.estimates, *self.solution.derived)}
        return by_name[name]


@pytest.fixture(scope="module", params=["reference", "metric"])
def lattices(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Case:
    """A D415 with two emitters, each with one lattice."""
    folder = tmp_path_factory.mktemp(request.param)
    start = _nominal("d415", 480)
    part = start.projector
    emitters = []
    for number, (angle, offset) in enumerate(zip((49.0, 60.0), OFFSETS, strict=True)):
        drawn = patterns.lattice(
            units=1,
            rotation_deg=angle,
            pitch_mrad=16.0,
            fwhm_mrad=4.5,
            fov_x_deg=part.fov_x_deg,
            fov_y_deg=part.fov_y_deg,
            background=0.2,
            power_spread=0.1,
            seed=number,
        ).image
        path = folder / f"unit{number}.png"
        path.write_bytes(png.encode(np.rint(drawn * (65535 / drawn.max())).astype(np.uint16)))
        emitters.append(Emitter(offset_m=offset, pattern=str(path)))
    light = dataclasses.replace(part, position_m=PLACE, emitters=tuple(emitters))
    truth = _misaligned(dataclasses.replace(start, projector=light))
    (folder / "set").mkdir()
    recovered = _recovered(_seen(folder / "set", truth, start, SCALES, request.param), start)
    solution = pattern_solution.solution(recovered, start, metric=request.param == "metric")
    return Case(start, truth, recovered, solution)


@pytest.mark.long
def test_two_emitters_are_recovered(lattices: Case) -> None:
    """Each emitter is within 0.1 mm; the initial error is at least 1.5 mm."""
    assert len(lattices.recovered.lattices) == 2
    positions = np.array([emitter.position_m for emitter in lattices.recovered.model.emitters])
    true = np.array(PLACE) + OFFSETS
    off = np.linalg.norm(positions[:, None] - true[None], axis=2)
    assert sorted(off.argmin(axis=1)) == [0, 1]
    assert off.min(axis=1).max() < 1e-4


@pytest.mark.long
def test_the_lattices_are_recovered(lattices: Case) -> None:
    """The pitch of 16 mrad is within 3e-4, the angles of 49 and 60 degrees within 0.02."""
    angles = []
    for number in range(2):
        cycles = lattices.estimate(f"emitter{number}.lattice.0.cycles").value
        assert cycles == pytest.approx(1 / 0.016, rel=3e-4)
        angle = lattices.estimate(f"emitter{number}.lattice.0.angle_deg").value % 90
        angles.append(angle)
    np.testing.assert_allclose(sorted(angles), [49, 60], atol=0.02)


@pytest.mark.long
def test_pattern_scales_are_recovered(lattices: Case) -> None:
    """Scales are within 3e-5, for a drift of 1e-3."""
    scales = list(lattices.recovered.model.scales.values())
    np.testing.assert_allclose(scales, SCALES, atol=3e-5)


@pytest.mark.long
def test_the_right_images_alignment_is_recovered(lattices: Case) -> None:
    """Sign and magnitude of the right image's alignment match the true sensor."""
    limits = {
        "right.alignment.offset_y_px": 0.01,
        "right.alignment.offset_x_px": 0.03,
        "right.alignment.roll_deg": 0.003,
    }
    for name, limit in limits.items():
        assert lattices.estimate(name).value == pytest.approx(TRUE[name], abs=limit), name
    true = lattices.truth.focal_baseline_px_m
    # An error of 0.1 mm in the baseline is 0.18 %.
    assert lattices.estimate("focal_baseline_px_m").value == pytest.approx(true, rel=5e-4)
    fitted = lattices.solution.sensor
    assert fitted.right.alignment.offset_y_px == pytest.approx(0.4, abs=0.01)
    assert fitted.baseline_m == pytest.approx(lattices.truth.baseline_m, abs=3e-5)


@pytest.mark.long
def test_intervals_are_plausible(lattices: Case) -> None:
    """Half of the 90 % intervals cover the truth, and no error exceeds 9.9 deviations.

    A deviation from three rooms has two degrees of freedom: 1 % of the errors exceed 9.9. Twelve
    parameters of one draw share errors and do not measure coverage.
    """
    middle = np.array(PLACE) + np.mean(OFFSETS, axis=0)
    true = {
        **TRUE,
        **{f"projector.position_m.{axis}": middle["xyz".index(axis)] for axis in "xyz"},
        "projector.rotation_deg.x": 0.0,
        "projector.rotation_deg.y": 0.0,
        "focal_baseline_px_m": lattices.truth.focal_baseline_px_m,
        **{
            f"projector.pattern_scale[{name}]": scale
            for name, scale in zip(lattices.recovered.model.scales, SCALES, strict=True)
        },
    }
    scores = np.array(
        [
            (lattices.estimate(name).value - value) / lattices.estimate(name).sd
            for name, value in true.items()
        ]
    )
    assert np.abs(scores).max() < 9.9, dict(zip(true, scores.round(1), strict=True))
    assert np.mean(np.abs(scores) < 1.645) >= 0.5, dict(zip(true, scores.round(1), strict=True))


@pytest.fixture(scope="module")
def scattered(tmp_path_factory: pytest.TempPathFactory) -> tuple[Case, list[Observation], Path]:
    """A D435, whose dots form no lattice, with an initial position error of 3 mm."""
    folder = tmp_path_factory.mktemp("scattered")
    start = _nominal("d435", 480)
    x, y, z = start.projector.position_m
    place = (x + 2.5e-3, y + 1.5e-3, z - 1e-3)
    truth = with_values(
        start,
        [
            *((f"projector.position_m.{k}", v) for k, v in zip("xyz", place, strict=True)),
            ("right.alignment.offset_y_px", 0.4),
        ],
    )
    (folder / "set").mkdir()
    observations = _seen(folder / "set", truth, start, (*SCALES, 1.0), "reference")
    recovered = _recovered(observations[:3], start)
    solution = pattern_solution.solution(recovered, start, metric=False)
    return Case(start, truth, recovered, solution), observations, folder


@pytest.mark.long
def test_an_image_and_its_emitters_position_are_recovered(
    scattered: tuple[Case, list[Observation], Path],
) -> None:
    """An initial position error of 3 mm is reduced to 0.15 mm."""
    case = scattered[0]
    assert not case.recovered.lattices
    (emitter,) = case.recovered.model.emitters
    off = emitter.position_m - case.truth.projector.position_m
    assert np.abs(off).max() < 1.5e-4
    assert case.estimate("right.alignment.offset_y_px").value == pytest.approx(0.4, abs=0.02)
    np.testing.assert_allclose(list(case.recovered.model.scales.values()), SCALES, atol=1e-4)
    true = case.truth.focal_baseline_px_m
    assert case.estimate("focal_baseline_px_m").value == pytest.approx(true, rel=2e-3)


@pytest.mark.long
def test_intervals_of_an_image_fit_cover(tmp_path: Path) -> None:
    """Nominal 90 % intervals of position and alignment cover 80 to 97 % of eight draws.

    Draws differ in scenes and noise. Seven parameters that share errors, in eight draws, give a
    sampling error of 4 %. Pattern scales of scenes are excluded. The quantisation error of a
    scene's reference is common to the scene, so no other room reveals it.
    """
    start = _nominal("d435", 480)
    x, y, z = start.projector.position_m
    place = dict(zip("xyz", (x + 1.5e-3, y + 1e-3, z - 7e-4), strict=True))
    moves = [(f"projector.position_m.{axis}", value) for axis, value in place.items()]
    truth = with_values(start, [*moves, ("right.alignment.offset_y_px", 0.3)])
    want = {
        **dict(moves),
        "right.alignment.offset_y_px": 0.3,
        "right.alignment.offset_x_px": 0.0,
        "right.alignment.roll_deg": 0.0,
        "focal_baseline_px_m": truth.focal_baseline_px_m,
    }
    inside = []
    for draw in range(8):
        first, second = builtin.tabletop(100 * draw + 1), builtin.clutter(100 * draw + 8)
        third = builtin.staircase(0.5 + 0.02 * draw) if draw % 2 else builtin.tabletop(77 + draw)
        drawn = [dataclasses.replace(item, interreflection=0.0) for item in (first, second, third)]
        folder = tmp_path / str(draw)
        folder.mkdir()
        seen = _seen(folder, truth, start, SCALES, "reference", drawn=drawn, seed=1000 * draw)
        solution = pattern_solution.solution(_recovered(seen, start), start, metric=False)
        by_name = {item.name: item for item in (*solution.estimates, *solution.derived)}
        inside += [
            abs(by_name[name].value - true) < 1.645 * by_name[name].sd
            for name, true in want.items()
        ]
    assert 0.80 <= np.mean(inside) <= 0.97


@pytest.mark.long
def test_a_held_out_scene_correlates_with_its_simulation(
    scattered: tuple[Case, list[Observation], Path],
) -> None:
    """The median NCC is above 0.9, and at chance level with the mirrored pattern."""
    case, observations, folder = scattered
    output_folder = folder / "found"
    output_folder.mkdir()
    fitted = pattern_sensor.with_pattern(case.start, case.recovered, output_folder)
    held_out = _held_out(folder, case.start)
    scale = recovery.scene_scale(
        seeing.make_views(held_out, case.start), case.start, case.recovered.model
    )
    assert scale == pytest.approx(1.0, abs=2e-4)
    scored = heldout.score(
        held_out,
        fitted,
        scale=scale,
        mirrored=pattern_sensor.with_mirrored_pattern(fitted, output_folder),
    )
    assert held_out.name not in [item.name for item in observations[:3]]
    for side in ("left", "right"):
        assert np.median(scored.ncc[side]) > 0.9
        assert abs(np.median(scored.mirrored[side])) < 0.05


def _held_out(folder: Path, sensor: Sensor) -> Observation:
    last = capture.open_set(folder / "set").scenes[-1]
    return observation.load(last, sensor, smoothing_px=heldout.SMOOTHING_PX)


def _flat(sensor: Sensor) -> Observation:
    """Return an observation without images."""
    return Observation(
        name="hall",
        room="hall",
        info=writer.info_of(sensor, source="none", licence="Apache-2.0", notes=""),
    )


def test_views_need_images_and_a_surface() -> None:
    sensor = _nominal("d415", 160)
    with pytest.raises(InputError, match="scene hall must have infrared images and reference"):
        seeing.make_views(_flat(sensor), sensor)


def test_a_projector_that_lights_nothing_is_refused() -> None:
    sensor = _nominal("d415", 160)
    shape = (sensor.height, sensor.width)
    dark = seeing.PatternView(
        scene="a",
        room="a",
        side="left",
        level_dn=np.zeros(shape, np.float32),
        points_m=np.ones((*shape, 3), np.float32),
        usable=np.zeros(shape, bool),
    )
    with pytest.raises(InputError, match="captures must show surfaces that the projector lights"):
        recovery.recover([dark], sensor)


def test_views_use_the_sensors_alignment() -> None:
    """A pixel of an image shifted by 3 px and 2 px shows the point of the unshifted pixel."""
    sensor = without_waves(_nominal("d415", 160))
    scene = _scenes()[0]
    layers = direct.layers(MitsubaScene(scene), sensor)
    pair = infrared(layers, scene, sensor, seed=0)
    assert pair.right is not None
    seen = dataclasses.replace(
        _flat(sensor),
        left=pair.left.astype(np.float32),
        right=pair.right.astype(np.float32),
        scene=scene,
        metric=True,
    )
    moved = with_values(
        sensor, [("right.alignment.offset_x_px", 3.0), ("right.alignment.offset_y_px", 2.0)]
    )
    left, right = seeing.make_views(seen, sensor)
    same, off = seeing.make_views(seen, moved)
    np.testing.assert_array_equal(same.points_m, left.points_m)
    moved_points, expected_points = off.points_m[10:-10, 10:-10], right.points_m[8:-12, 7:-13]
    both = off.usable[10:-10, 10:-10] & right.usable[8:-12, 7:-13]
    assert both.mean() > 0.3
    np.testing.assert_allclose(moved_points[both], expected_points[both], atol=1e-4)
    assert not off.usable[:2].any() and not off.usable[:, :3].any()
