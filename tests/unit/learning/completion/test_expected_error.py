"""Expected error of completion: groups, slope, files and fit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from starling.learning.completion.data.pairs import Pair
from starling.learning.completion.method import make_frame
from starling.learning.completion.small import expected_error, expected_error_fit, method
from starling.learning.completion.small.expected_error import (
    ExpectedError,
    GroupError,
    calibrated,
    change_m,
    group_masks,
)
from starling.learning.completion.small.expected_error_fit import RoomErrors
from starling.learning.completion.small.network import SmallNetwork
from starling.patterns.errors import InputError
from starling.sim.geometry.pinhole import Pinhole

SHAPE = (60, 80)
PER_PX = 0.004  # Relative change of depth of the inclined surface [1/px].
INCLINED = np.broadcast_to(np.exp(PER_PX * np.arange(80)), SHAPE).astype(np.float32)
CAMERA = Pinhole(width=80, height=60, fx_px=60, fy_px=60, cx_px=39.5, cy_px=29.5)
VALID = np.ones(SHAPE, bool)
VALID[:, :10] = VALID[20:40, 30:40] = False


def test_groups_are_disjoint_and_complete():
    measured = VALID.copy()
    measured[50:] = False
    masks = group_masks(VALID, measured)
    assert tuple(masks) == expected_error.GROUPS
    np.testing.assert_array_equal(np.sum(list(masks.values()), axis=0), 1)
    counts = {name: int(mask.sum()) for name, mask in masks.items()}
    assert counts == {"hole": 200, "border": 600, "measured": 3300, "replaced": 700}
    assert not masks["border"][:, 10:].any()


@pytest.mark.parametrize("group", expected_error.GROUPS)
def test_change_of_an_inclined_surface_is_its_slope(group: str):
    inside = (slice(20, 40), slice(20, 60))
    expected = PER_PX * INCLINED[inside]
    np.testing.assert_allclose(change_m(INCLINED, group)[inside], expected, rtol=1e-3)
    assert not change_m(np.full(SHAPE, 2, np.float32), group).any()


def test_sigma_is_wider_on_inclined_surfaces_and_intervals_are_known_by_group():
    own_sigma = np.full(SHAPE, 0.01, np.float32)
    error = ExpectedError(
        measured=GroupError(scale=2, shift_px=3), hole=GroupError(half_68=0.5, half_95=2)
    )
    masks = group_masks(VALID, VALID)
    sigma, halves = calibrated(error, INCLINED, own_sigma, masks)
    pixel = (30, 60)
    change = 3 * PER_PX * INCLINED[pixel]
    assert sigma[pixel] == pytest.approx(np.hypot(0.02, change), rel=1e-3)
    level, _ = calibrated(error, np.full(SHAPE, 2, np.float32), own_sigma, masks)
    assert level[pixel] == pytest.approx(0.02)
    np.testing.assert_array_equal(sigma[~VALID], own_sigma[~VALID])
    np.testing.assert_allclose(halves[68][masks["hole"]], 0.005)
    np.testing.assert_allclose(halves[95][masks["hole"]], 0.02)
    assert np.isnan(halves[95][~masks["hole"]]).all()
    assert calibrated(ExpectedError(), INCLINED, own_sigma, masks)[1] == {}


def test_a_network_uses_the_calibration_of_its_folder(tmp_path: Path):
    frame = make_frame(np.full(SHAPE, 90, np.uint8), INCLINED, VALID)
    network = method.to_device(SmallNetwork()).eval()
    method.save(method.Small(network), tmp_path)
    plain = method.load(tmp_path)
    assert plain.error == ExpectedError() and plain.fill(frame).half_m == {}
    error = ExpectedError(**{
        name: GroupError(scale=2, half_68=1, half_95=3) for name in expected_error.GROUPS
    })  # fmt: skip
    expected_error.save(error, tmp_path / expected_error.FILE)
    loaded = method.load(tmp_path)
    assert loaded.error == error
    before, after = plain.fill(frame), loaded.fill(frame)
    np.testing.assert_array_equal(after.depth_m, before.depth_m)
    np.testing.assert_allclose(after.sigma_m, 2 * before.sigma_m, rtol=1e-6)
    np.testing.assert_allclose(after.half_m[95], 3 * after.sigma_m, rtol=1e-6)
    method.save(plain, tmp_path)  # New weights end the calibration of the old ones.
    assert method.load(tmp_path).error == ExpectedError()


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"scale": 0}, "scale must be in"),
        ({"shift_px": -1}, "shift_px must be in"),
        ({"half_68": -1, "half_95": 1}, "half_68 must be in"),
        ({"half_68": 1}, "half_68 and half_95 must come together; got 1 and None"),
        ({"half_68": 2, "half_95": 1}, "half_68 must be at most half_95; got 2 and 1"),
    ],
)
def test_impossible_values_are_refused(values, message: str):
    with pytest.raises(InputError, match=message):
        GroupError(**values)


@pytest.mark.parametrize("text", ["{", '{"hole": {"scale": 0}}', '{"wall": {}}', "[]"])
def test_a_damaged_file_is_refused_by_name(tmp_path: Path, text: str):
    (tmp_path / expected_error.FILE).write_text(text)
    with pytest.raises(InputError, match=expected_error.FILE):
        expected_error.load(tmp_path)


def room(number: int, scale: float, shift_px: float) -> RoomErrors:
    """Normal errors whose variance has both terms."""
    rng = np.random.default_rng(number)
    own_sigma, change = rng.uniform(0.01, 0.05, 5000), rng.exponential(0.01, 5000)
    error = np.abs(rng.normal(0, np.hypot(scale * own_sigma, shift_px * change)))
    return RoomErrors(error=error, own_sigma=own_sigma, change=change)


@pytest.mark.parametrize(("scale", "shift_px"), [(1.5, 3.0), (2.0, 0.0), (0.5, 0.0)])
def test_the_fit_recovers_scale_and_shift_but_never_narrows_sigma(scale: float, shift_px: float):
    rooms = [room(number, scale, shift_px) for number in range(4)]
    group = expected_error_fit.fit(rooms)
    assert group.scale == pytest.approx(max(scale, 1), rel=0.05)
    assert group.shift_px == pytest.approx(shift_px, abs=0.25)


def test_rooms_are_left_out_and_every_one_is_inside_the_interval():
    rooms = [room(number, 1.2 + 0.3 * number, 2.0) for number in range(4)]
    ratios = expected_error_fit.left_out(rooms)
    rms = [np.sqrt(np.mean(ratio**2)) for ratio in ratios]
    assert rms == sorted(rms) and rms[0] < 1 < rms[-1]
    half = expected_error_fit.half_width(ratios, 0.95)
    shares = [float(np.mean(ratio <= half)) for ratio in ratios]
    assert min(shares) == pytest.approx(0.95, abs=1e-3)


def test_a_fit_without_rooms_or_pixels_is_refused():
    empty = RoomErrors(error=np.zeros(0), own_sigma=np.zeros(0), change=np.zeros(0))
    for rooms in ([], [empty]):
        with pytest.raises(InputError, match="rooms must each have pixels of the group"):
            expected_error_fit.fit(rooms)
    with pytest.raises(InputError, match="rooms must be at least two; got 1"):
        expected_error_fit.left_out([room(0, 1, 1)])


def test_errors_are_drawn_by_group_where_truth_is_known():
    truth = np.where(np.arange(60)[:, None] < 55, INCLINED, np.nan).astype(np.float32)
    pair = Pair(
        scene="a", room="b", number=0, camera=CAMERA,
        focal_baseline_px_m=3.0, image=np.zeros(SHAPE, np.uint8),
        depth_m=np.where(VALID, INCLINED, np.nan), truth_m=truth, causes=dict,
    )  # fmt: skip
    depth = np.where(VALID, INCLINED, INCLINED + np.float32(0.1))
    own_sigma = np.full(SHAPE, 0.02, np.float32)
    drawn = dict(expected_error_fit.sampled_errors(pair, depth, own_sigma, seed=0))
    assert {name: errors.error.size for name, errors in drawn.items()} == {
        "hole": 200, "border": 550, "measured": 3650}  # fmt: skip
    np.testing.assert_allclose(drawn["border"].error, 0.1, rtol=1e-5)
    assert not drawn["measured"].error.any()
