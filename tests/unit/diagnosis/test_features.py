"""Strata and features of drawn images."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from starling.diagnosis.features import depth as depth_maps
from starling.diagnosis.features import infrared
from starling.diagnosis.scenes import observation
from starling.diagnosis.scenes.strata import Strata, stratify
from starling.patterns.errors import InputError
from starling.sim.captures.info import CaptureInfo
from starling.sim.sensor import presets

WIDTH, HEIGHT = 240, 160
INFO = CaptureInfo(
    sensor="d435", width=WIDTH, height=HEIGHT, fx_px=200, fy_px=200, cx_px=119.5, cy_px=79.5,
    baseline_m=0.05, depth_unit_m=0.001, source="drawn", licence="none", notes="",
)  # fmt: skip
BOX = slice(50, 110), slice(90, 160)  # Rows and columns of the box before the wall.
FAR_PX, NEAR_PX = 6.0, 18.0


def world(seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Return disparity of a box before a wall, and an image of dots on both (h, w)."""
    depth = np.full((HEIGHT, WIDTH), FAR_PX, np.float32)
    depth[BOX] = NEAR_PX
    rng = np.random.default_rng(seed)
    y, x = np.indices(depth.shape)
    image = np.full(depth.shape, 20.0)
    for dot_y, dot_x in rng.uniform((0, 0), depth.shape, size=(900, 2)):
        image += 60 * np.exp(-((y - dot_y) ** 2 + (x - dot_x) ** 2) / 2)
    return depth, image.astype(np.float32)


DISPARITY, EXPECTED = world()
BODY = np.where(DISPARITY == NEAR_PX, 2, 1).astype(np.uint32)
TANGENTS = np.stack(
    np.meshgrid((np.arange(WIDTH) - 119.5) / 200, (np.arange(HEIGHT) - 79.5) / 200), axis=-1
).astype(np.float32)


def strata_of(disparity_px: np.ndarray) -> Strata:
    return stratify(disparity_px, EXPECTED, INFO, body=BODY, projector=TANGENTS)


GROUND = strata_of(DISPARITY)


def test_bins_divide_the_counted_pixels():
    for name, covariate in GROUND.covariates.items():
        assert covariate.name == name
        if name != "dots":
            np.testing.assert_array_equal(covariate.label >= 0, GROUND.counted)
        assert covariate.label.max() < len(covariate.bins)
    assert not GROUND.counted[:, : int(FAR_PX)].any() and GROUND.counted[0, int(FAR_PX) :].all()


def test_edge_bins_have_sides():
    edge = GROUND.covariates["edge"]
    row = (BOX[0].start + BOX[0].stop) // 2
    left, right = BOX[1].start, BOX[1].stop
    assert edge.mask("left of a nearer thing")[row, left - 3 : left].all()
    assert edge.mask("beside a nearer thing")[row, right : right + 3].all()
    assert edge.mask("on its rim")[row, left : left + 3].all()
    assert edge.mask("open")[5, 200] and edge.mask("near an edge")[row, right + 8]


def test_dots_are_brighter_than_the_space_between():
    dots = GROUND.covariates["dots"]
    assert EXPECTED[dots.mask("on dots")].mean() > 2 * EXPECTED[dots.mask("between")].mean()


def test_an_unknown_reference_is_refused():
    with pytest.raises(InputError, match="reference depth must be known somewhere; got no pixel"):
        strata_of(np.full_like(DISPARITY, np.nan))


def test_percentiles_resolve_fractions_of_a_code():
    """If a tenth of the pixels rise by one code, the percentile rises by about a tenth."""
    rng = np.random.default_rng(0)
    dark = rng.integers(3, 6, EXPECTED.shape).astype(np.float32)
    lifted = dark + (rng.random(dark.shape) < 0.1)
    before, after = (
        np.exp(infrared.level_features(image, GROUND, 255.0)["level.percentile 25"]) - 1
        for image in (dark, lifted)
    )
    assert before == pytest.approx(2.5 + 0.25 * 3, abs=0.03)
    assert after - before == pytest.approx(0.1 * 0.75 / 0.9, abs=0.03)


@given(st.floats(0.5, 2.0))
def test_levels_follow_the_light(factor: float):
    before = infrared.level_features(EXPECTED, GROUND, 1e4)
    after = infrared.level_features(EXPECTED * np.float32(factor), GROUND, 1e4)
    name = "level.radius.ring.dots.on dots"
    assert after[name] - before[name] == pytest.approx(np.log(factor), abs=0.02)


def test_blur_reduces_sharpness():
    sharp = infrared.texture_features(EXPECTED, GROUND)
    soft = infrared.texture_features(cv2.GaussianBlur(EXPECTED, (0, 0), 1.0), GROUND)
    name = "texture.slope.radius.ring.dots.on dots"
    assert soft[name] < sharp[name] - 0.5


@pytest.mark.parametrize("sigma", [1.0, 4.0])
def test_noise_is_measured_as_a_standard_deviation(sigma: float):
    """The local fit of two parameters in 15 px windows absorbs less than 2 % of it."""
    rng = np.random.default_rng(1)
    image = EXPECTED + sigma * rng.standard_normal(EXPECTED.shape).astype(np.float32)
    features = infrared.residual_features(image, GROUND)
    assert features["noise.expected.1/4"] == pytest.approx(np.log(sigma), abs=0.1)
    rows = image + 3 * rng.standard_normal((HEIGHT, 1)).astype(np.float32)
    striped = infrared.residual_features(rows, GROUND)
    assert striped["noise.rows"] > features["noise.rows"] + 1
    assert striped["noise.columns"] < features["noise.columns"] + 0.5


def test_errors_and_holes_are_measured_by_bin():
    measured = DISPARITY + np.float32(0.1)
    measured[:, : WIDTH // 3] = np.nan
    features = depth_maps.disparity_features(measured, GROUND)
    assert features["error.bias.all"] == pytest.approx(0.1, abs=1e-5)
    assert features["holes.x.left"] == pytest.approx(np.pi / 2)
    assert features["holes.x.right"] == 0
    assert np.isnan(features["error.bias.x.left"])


def test_surface_features_respond_to_smoothing_and_steps():
    rng = np.random.default_rng(2)
    rough = DISPARITY + 0.1 * rng.standard_normal(DISPARITY.shape).astype(np.float32)
    smooth = cv2.blur(rough, (9, 9))
    before, after = (
        depth_maps.surface_features(np.asarray(image), GROUND) for image in (rough, smooth)
    )
    assert after["surface.alike x4"] > before["surface.alike x4"] + 0.3
    assert after["surface.rough x"] < before["surface.rough x"] - 1
    stepped = depth_maps.surface_features(np.round(rough * 4) / 4, GROUND)
    assert stepped["surface.equal x"] > before["surface.equal x"] + 0.3


def test_depth_is_compared_with_our_matcher_by_sign_and_with_the_device_by_distance():
    rng = np.random.default_rng(7)
    ours = DISPARITY + 0.1 * rng.standard_normal(DISPARITY.shape).astype(np.float32)
    device = np.where(np.arange(WIDTH) < 60, np.nan, ours + 0.2).astype(np.float32)
    assert depth_maps.bias_features(device, ours, GROUND)["against.bias.all"] == pytest.approx(0.2)
    assert depth_maps.bias_features(ours, ours, GROUND)["against.bias.all"] == 0
    equal = depth_maps.difference_features(device, device, GROUND)
    assert all(np.isnan(value) or value == 0 for value in equal.values())
    base = depth_maps.difference_features(ours, device, GROUND)
    assert base["unlike.disparity.all"] == pytest.approx(0.2)
    # Half of the device's holes is nearer to it; equally many holes elsewhere are farther from it.
    half = np.where(np.arange(WIDTH) < 33, np.nan, ours).astype(np.float32)
    elsewhere = np.where(np.arange(WIDTH) > WIDTH - 28, np.nan, ours).astype(np.float32)
    nearer, farther = (
        depth_maps.difference_features(depth, device, GROUND) for depth in (half, elsewhere)
    )
    assert nearer["unlike.holes.all"] < base["unlike.holes.all"] - 0.1
    assert farther["unlike.holes.all"] > base["unlike.holes.all"] + 0.1
    assert np.isnan(depth_maps.difference_features(np.full_like(ours, np.nan), device, GROUND)[
        "unlike.disparity.all"
    ])  # fmt: skip


def test_repeats_show_temporal_noise_and_filtering():
    rng = np.random.default_rng(3)
    frames = EXPECTED + 2 * rng.standard_normal((12, HEIGHT, WIDTH))
    features = infrared.infrared_repeat_features(frames, GROUND)
    assert features["time.noise.expected.2/4"] == pytest.approx(np.log(2), abs=0.05)
    maps = DISPARITY + 0.1 * rng.standard_normal((12, HEIGHT, WIDTH))
    independent = depth_maps.depth_repeat_features(maps, GROUND)
    assert independent["time.carried on"] == pytest.approx(-0.5, abs=0.02)
    filtered = np.cumsum(maps - DISPARITY, axis=0) + DISPARITY
    assert depth_maps.depth_repeat_features(filtered, GROUND)["time.carried on"] > -0.1
    assert "time.carried on" not in depth_maps.depth_repeat_features(maps[:2], GROUND)


def test_depth_in_whole_units_keeps_holes_and_changes_little():
    """At 10 px of disparity and f b of 10 px m, a millimetre is a hundredth of a pixel."""
    sensor = presets.load("d435")
    scale = sensor.fx_px * sensor.baseline_m
    maps = np.array([[[np.nan, 10.0, scale / 1.0004, 1e6]]], np.float32)
    rounded = observation.quantise_depth(maps, sensor)
    assert np.isnan(rounded[0, 0, 0]) and np.isnan(rounded[0, 0, 3])  # Less than one unit.
    assert rounded[0, 0, 2] == pytest.approx(scale / 1.0)
    step = 10.0**2 * sensor.post.depth_unit_m / scale
    assert abs(rounded[0, 0, 1] - 10.0) <= 0.51 * step


def test_bin_names_describe_their_pixels():
    def bins(strata: Strata, name: str, where: np.ndarray) -> set[str]:
        covariate = strata.covariates[name]
        return {covariate.bins[label] for label in covariate.label[where & strata.counted]}

    y, x = np.indices(DISPARITY.shape)
    rising = strata_of((6 + 6 * y / HEIGHT).astype(np.float32))
    for third, word in enumerate(("far", "middle", "near")):
        rows = np.abs(y / HEIGHT - (third + 0.5) / 3) < 0.15
        assert bins(rising, "depth", rows) == {word}
    for name, value, words in (
        ("x", x / WIDTH, ("left", "centre", "right")),
        ("y", y / HEIGHT, ("top", "middle", "bottom")),
        ("radius", np.hypot(x - 119.5, y - 79.5) / np.hypot(120, 80), ("centre", "ring", "corner")),
    ):
        for third, word in enumerate(words):
            assert bins(GROUND, name, np.abs(value - (third + 0.5) / 3) < 0.1) == {word}
    ordered = np.argsort(np.where(GROUND.counted, EXPECTED, np.nan), axis=None)
    ordered = ordered[: np.count_nonzero(GROUND.counted)]
    for number, word in enumerate(("1/4", "2/4", "3/4", "4/4")):
        quarter = np.zeros(EXPECTED.size, bool)
        quarter[ordered[number * len(ordered) // 4 :][: len(ordered) // 4 - 9]] = True
        assert word in bins(GROUND, "expected", quarter.reshape(EXPECTED.shape))
    level = cv2.blur(EXPECTED, (31, 31))
    dark, bright = np.quantile(level[GROUND.counted], (0.3, 0.7))
    assert bins(GROUND, "level", level < dark) == {"dark"}
    assert bins(GROUND, "level", level > bright) == {"bright"}
    for part in range(8):
        flat = strata_of(np.full_like(DISPARITY, 8 + (part + 0.5) / 8))
        assert bins(flat, "fraction", flat.counted) == {f"{part}/8"}


@pytest.mark.parametrize("degrees, word", [(20, "facing"), (50, "slanted"), (72, "grazing")])
def test_the_incidence_on_a_tilted_wall_is_its_angle(degrees: float, word: str):
    """Law: the disparity of a plane is linear in the pixel; the central ray is the axis."""
    x = (np.arange(WIDTH) - INFO.cx_px) / INFO.fx_px
    tilt = np.tan(np.radians(degrees))
    disparity_px = np.float32(8) * (1 + tilt * x).clip(0.05) * np.ones(DISPARITY.shape)
    incidence = strata_of(disparity_px.astype(np.float32)).covariates["incidence"]
    middle = incidence.label[60:100, WIDTH // 2 - 3 : WIDTH // 2 + 3]
    assert {incidence.bins[label] for label in middle.ravel()} == {word}
    value = incidence.value
    assert value is not None and value[80, 120] == pytest.approx(degrees, abs=1.5)
