"""The fitted warp of the right image, against a known warp."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from starling.calibration import heldout
from starling.calibration.geometry import warp_fit
from starling.calibration.geometry.warp_fit import COLUMNS, fit_warp
from starling.calibration.observation import Observation
from starling.patterns.errors import InputError
from starling.sim.captures import writer
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.scene.builtin import scenes
from starling.sim.sensor.sensor import Sensor
from tests.unit.calibration.small_camera import small

SENSOR = small("d415", 640, 360)
ROWS = 18
ACROSS, DOWN = np.meshgrid(np.linspace(-1, 1, COLUMNS), np.linspace(-1, 1, ROWS))
TRUE_PX = 0.3 * np.cos(4 * np.hypot(ACROSS, 0.6 * DOWN))  # Rings.


def _warped(cells: np.ndarray) -> Sensor:
    warp = tuple(tuple(map(float, row)) for row in cells)
    aligned = replace(SENSOR.right.alignment, warp_px=warp)
    return replace(SENSOR, right=replace(SENSOR.right, alignment=aligned))


def _seen(room: str, distance_m: float, sensor: Sensor) -> Observation:
    scene = scenes.wall(distance_m=distance_m)
    images, _ = heldout.simulate(MitsubaScene(scene), sensor, 1.0)
    info = writer.info_of(SENSOR, source="drawn", licence="Apache-2.0", notes="")
    return Observation(
        name=room,
        room=room,
        info=info,
        left=np.rint(images["left"]),
        right=np.rint(images["right"]),
        scene=scene,
    )


@pytest.fixture(scope="module")
def captured() -> list[Observation]:
    return [_seen(f"{z:g} m", z, _warped(TRUE_PX)) for z in (0.8, 1.2)]


def test_the_warp_is_recovered(captured: list[Observation]) -> None:
    """Cells match, except at the border and in the right band, which only one imager sees."""
    result = fit_warp(captured, SENSOR)
    warp = np.array(result.sensor.right.alignment.warp_px)
    inside = np.s_[1:-1, 1:-3]
    assert np.sqrt(np.mean((warp - TRUE_PX)[inside] ** 2)) < 0.02
    (estimate,) = result.estimates
    assert estimate.value == pytest.approx(np.sqrt(np.mean(warp**2)))
    assert 0 < estimate.sd < 0.05 and estimate.start == 0
    assert any("which imager" in sentence.lower() for sentence in result.undetermined)


def test_a_fit_starts_from_the_sensors_warp(captured: list[Observation]) -> None:
    right = _warped(TRUE_PX)
    result = fit_warp(captured, right)
    moved = np.array(result.sensor.right.alignment.warp_px) - TRUE_PX
    assert np.sqrt(np.mean(moved**2)) < 0.02
    assert result.estimates[0].start == pytest.approx(np.sqrt(np.mean(TRUE_PX**2)))


def test_one_room_is_too_few(captured: list[Observation]) -> None:
    bare = replace(captured[1], right=None)
    with pytest.raises(InputError, match="must hold infrared pairs of 2 rooms for the warp; got 1"):
        fit_warp([captured[0], bare], SENSOR)


def test_differences_belong_to_cells_of_the_right_image() -> None:
    """A difference belongs to the matched cell; matches outside the image are dropped."""
    x = np.broadcast_to(np.arange(64), (36, 64))
    disparity = np.full((36, 64), 4.4, np.float32)
    pixel = np.rint(x - 4.4)
    result = warp_fit._medians((pixel // 2).astype(np.float32), disparity)
    assert result.shape == (18, COLUMNS)
    np.testing.assert_array_equal(result[:, :29], np.broadcast_to(np.arange(29), (18, 29)))
    assert np.isnan(result[:, 30:]).all()
    rows = np.broadcast_to(np.arange(36)[:, None] // 2, (36, 64)).astype(np.float32)
    down = warp_fit._medians(rows, disparity)
    np.testing.assert_array_equal(down[:, 5], np.arange(18))


def test_the_deviation_is_that_of_the_mean_over_rooms(
    captured: list[Observation], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Rooms at 0.1 and 0.3 px: mean 0.2 in each of two rounds, standard error 0.1."""
    memories = []

    def measured(observation, sensor, *, memory):
        memories.append(memory)
        return np.full((ROWS, COLUMNS), 0.1 if observation is captured[0] else 0.3)

    monkeypatch.setattr(warp_fit, "difference", measured)
    result = fit_warp(captured, SENSOR)
    (estimate,) = result.estimates
    assert estimate.sd == pytest.approx(0.1)
    assert result.covariance == pytest.approx(0.01)
    np.testing.assert_allclose(result.sensor.right.alignment.warp_px, -0.4, atol=1e-4)
    assert len(memories) == 4 and len({id(memory) for memory in memories}) == 1
    assert memories[0].most == 2


@pytest.mark.parametrize(("pixels", "known"), [(19, False), (20, True)])
def test_a_cell_needs_a_fifth_of_its_pixels(pixels: int, known: bool) -> None:
    """Cells of 320x180 pixels have 10 x 10 of them."""
    values = np.full((180, 320), np.nan, np.float32)
    block = np.full(100, np.nan, np.float32)
    block[:pixels] = np.arange(pixels)
    values[50:60, 100:110] = block.reshape(10, 10)
    cells = warp_fit._medians(values, np.zeros(values.shape, np.float32))
    assert cells.shape == (ROWS, COLUMNS)
    assert np.isfinite(cells[5, 10]) == known
    assert np.isfinite(cells).sum() == known
    assert not known or cells[5, 10] == np.median(np.arange(pixels))


@pytest.mark.parametrize(("match_px", "inside"), [(-0.4, True), (-0.6, False)])
@pytest.mark.parametrize("side", [0, 1])
def test_cells_end_half_a_pixel_outside_the_right_image(
    match_px: float, inside: bool, side: int
) -> None:
    """A single pixel of a small image fills a cell."""
    values = np.full((18, 32), np.nan, np.float32)
    disparity = np.zeros(values.shape, np.float32)
    column = (0, 31)[side]
    values[4, column] = 7
    disparity[4, column] = -match_px if side == 0 else match_px
    cells = warp_fit._medians(values, disparity)
    assert (cells == 7).sum() == inside
    assert not inside or cells[4, column] == 7


@pytest.mark.parametrize(("off_px", "accepted"), [(1.49, True), (-1.49, True), (1.51, False)])
def test_differences_above_one_and_a_half_pixels_are_wrong_matches(
    monkeypatch: pytest.MonkeyPatch, off_px: float, accepted: bool
) -> None:
    """A difference is captured minus simulated disparity."""
    image = np.zeros((18, 32), np.float32)
    pairs = {"captured": image + np.float32(off_px), "simulated": image}
    simulated = {"left": "simulated", "right": "right"}
    monkeypatch.setattr(warp_fit.heldout, "simulate", lambda *_: (simulated, None))
    monkeypatch.setattr(warp_fit, "_match_pair", lambda left, *_: pairs[left])
    seen = SimpleNamespace(left="captured", right="right", stage=None)
    cells = warp_fit.difference(seen, SENSOR)  # pyright: ignore[reportArgumentType]
    assert np.isfinite(cells).all() == accepted
    assert not accepted or cells == pytest.approx(off_px, abs=1e-6)


def test_the_mean_over_rooms_is_smoothed() -> None:
    """Cells that fewer than two rooms know take the value of their neighbours."""
    rooms = np.full((3, 9, 9), np.nan)
    rooms[:2, :, :5] = [[[1.0]], [[3.0]]]
    rooms[2, :, 5:] = 50.0
    cells = warp_fit._smooth_rooms(rooms)
    np.testing.assert_allclose(cells[:, :7], 2.0)
    assert not warp_fit._smooth_rooms(np.full((2, 9, 9), np.nan)).any()
    rooms[:2, 4, 2] = 12.0  # One cell is 10 above its surroundings.
    bump = warp_fit._smooth_rooms(rooms)[:, 2] - 2
    assert bump[4] == pytest.approx(10 / (2 * np.pi * 0.7**2), rel=0.1)
    rooms[2, :, :5] = 8.0  # A third room: the mean counts rooms.
    assert warp_fit._smooth_rooms(rooms)[0, 0] == pytest.approx(4.0)


def test_cells_at_the_border_are_smoothed_inwards_alone() -> None:
    """Nothing outside the image counts: the mean of a ramp is one-sided at its ends."""
    ramp = np.broadcast_to(np.arange(9.0), (2, 9, 9))
    smoothed = warp_fit._smooth_rooms(ramp)[4]
    share = np.exp(-(np.arange(4) ** 2) / (2 * 0.7**2))
    inwards = (share * np.arange(4)).sum() / share.sum()
    assert smoothed[0] == pytest.approx(inwards, rel=0.02)
    assert smoothed[8] == pytest.approx(8 - inwards, rel=0.02)
    np.testing.assert_allclose(smoothed[3:6], [3, 4, 5], atol=1e-6)


def test_a_warp_is_written_with_four_decimals() -> None:
    cells = np.full((2, 3), 0.12345678)
    moved = warp_fit._with_warp(SENSOR, cells)
    assert moved.right.alignment.warp_px == ((0.1235,) * 3,) * 2
    assert moved.left == SENSOR.left
    np.testing.assert_allclose(warp_fit._cells(moved, (4, 6)), 0.1235, atol=1e-6)
    np.testing.assert_array_equal(warp_fit._cells(SENSOR, (4, 6)), np.zeros((4, 6)))


def test_a_root_mean_square_of_nothing_is_infinite() -> None:
    assert warp_fit._rms(np.array([3.0, -4.0])) == pytest.approx(np.sqrt(12.5))
    assert np.isinf(warp_fit._rms(np.empty(0)))


@pytest.mark.parametrize(("ceiling_bits", "kind"), [(8, np.uint8), (10, np.uint16)])
def test_pairs_are_matched_in_the_imagers_codes(
    monkeypatch: pytest.MonkeyPatch, ceiling_bits: int, kind: type
) -> None:
    """Levels are rounded and clipped to the codes of the imager."""
    sensor = replace(SENSOR, left=replace(SENSOR.left, bit_depth=ceiling_bits))
    pairs: list[np.ndarray] = []

    def matched(left, right, matcher, *, memory):
        pairs.extend((left, right))
        return SimpleNamespace(disparity_px="disparity")

    monkeypatch.setattr(warp_fit, "match", matched)
    levels = np.array([[-3.0, 2.6, 1e5]])
    assert warp_fit._match_pair(levels, levels + 1, sensor) == "disparity"
    highest = 2**ceiling_bits - 1
    assert [image.dtype for image in pairs] == [kind, kind]
    assert pairs[0].tolist() == [[0, 3, highest]] and pairs[1].tolist() == [[0, 4, highest]]
