"""Where the gap lies: maps, objects, bins of covariates and rules."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from starling.diagnosis.scenes.observation import DepthObservation, StereoObservation
from starling.diagnosis.where import covariates, rules, swap
from starling.diagnosis.where import maps as maps_of
from starling.diagnosis.where.location import locate_gap, material_masks
from starling.sim.scene.builtin import scenes
from starling.sim.scene.scene import Material
from tests.unit.diagnosis.test_features import DISPARITY, EXPECTED, GROUND

SCENES = 6
AXES = (
    np.linspace(-0.5, 0.9, 240),
    np.linspace(-0.2, 0.6, 160),
)  # Horizontal and vertical tangents in the projector field.
ROOMS = [f"room {number}" for number in range(SCENES)]


def maps(seed: int, *, holes: float, noise_px: float = 0.1) -> np.ndarray:
    rng = np.random.default_rng(seed)
    disparity_px = DISPARITY + noise_px * rng.standard_normal(DISPARITY.shape)
    disparity_px[rng.random(DISPARITY.shape) < holes] = np.nan
    return disparity_px.astype(np.float32)[None]


def readings(seed: int, ours: float, device: float | None) -> list[StereoObservation]:
    dark = np.zeros((1, *DISPARITY.shape), np.uint8)
    pairs = [
        StereoObservation(left=dark, right=dark, ours_px=maps(seed + scene, holes=ours))
        for scene in range(SCENES)
    ]
    if device is None:
        return pairs
    return [
        pair.with_depth(maps(seed + 50 + scene, holes=device)) for scene, pair in enumerate(pairs)
    ]


def holes(seed: int, where: np.ndarray | None = None) -> np.ndarray:
    rng = np.random.default_rng(seed)
    chance = np.full(DISPARITY.shape, 0.03)
    if where is not None:
        chance[where] += 0.1
    return rng.random(DISPARITY.shape) < chance


def test_more_holes_in_one_bin_are_found_there():
    near = GROUND.covariates["x"].mask("left")
    first = [holes(scene) for scene in range(SCENES)]
    second = [holes(50 + scene, near) for scene in range(SCENES)]
    rows = covariates.bin_gaps(first, second, [GROUND] * SCENES, ROOMS)
    row = next(row for row in rows if (row.covariate, row.bin) == ("x", "left"))
    assert row.gap == pytest.approx(0.1, abs=0.01) and row.low < 0.1 < row.high
    assert row.share == pytest.approx(1, abs=0.15) and row.p < 0.06
    opposite = next(row for row in rows if (row.covariate, row.bin) == ("x", "right"))
    assert abs(opposite.gap) < 0.01 and opposite.p > 0.2


def test_a_material_is_one_more_covariate():
    """A tenth more of its pixels has no depth, in the scenes that contain it."""
    of_cloth = GROUND.counted & (np.arange(DISPARITY.shape[0])[:, None] < 40)
    of_wood = GROUND.counted & ~of_cloth
    first = [holes(scene) for scene in range(SCENES)]
    second = [holes(50 + scene, of_cloth if scene else None) for scene in range(SCENES)]
    parts = [{"cloth": of_cloth, "wood": of_wood}] * SCENES
    parts[0] = {"wood": GROUND.counted}
    rows = covariates.bin_gaps(first, second, [GROUND] * SCENES, ROOMS, parts)
    by_material = {row.bin: row for row in rows if row.covariate == "material"}
    assert by_material["cloth"].gap == pytest.approx(0.1, abs=0.01)
    assert abs(by_material["wood"].gap) < 0.01 and set(by_material) == {"cloth", "wood"}
    assert all(
        row.covariate != "material"
        for row in covariates.bin_gaps(first, second, [GROUND] * SCENES, ROOMS, [{}] * SCENES)
    )


def test_pixels_are_separated_by_material():
    cloth, wood = Material(name="cloth"), Material(name="wood")
    bodies = [SimpleNamespace(material=each) for each in (wood, cloth, wood)]
    columns = np.arange(DISPARITY.shape[1])
    body = np.broadcast_to(columns * 3 // columns.size + 1, DISPARITY.shape).astype(np.uint32)
    strata = dataclasses.replace(GROUND, body=body)
    scene: Any = SimpleNamespace(bodies=bodies)
    masks = material_masks(scene, strata)
    np.testing.assert_array_equal(masks["cloth"], GROUND.counted & (body == 2))
    np.testing.assert_array_equal(masks["wood"], GROUND.counted & (body != 2))
    alone: Any = SimpleNamespace(bodies=bodies[:1])
    assert material_masks(alone, strata) == {}  # A single material.
    unseen: Any = SimpleNamespace(bodies=bodies)
    first = dataclasses.replace(strata, body=np.minimum(body, 1))
    assert material_masks(unseen, first) == {}  # No pixel shows the second material.


def test_gaps_that_cancel_have_no_shares():
    """The gap is ten points on one side and minus ten on the other, each in half of a third."""
    shape = GROUND.disparity_px.shape
    half = np.indices(shape)[0] < shape[0] // 2
    left, right = (GROUND.covariates["x"].mask(word) & half for word in ("left", "right"))
    first = [holes(scene, right) for scene in range(SCENES)]
    second = [holes(50 + scene, left) for scene in range(SCENES)]
    rows = covariates.bin_gaps(first, second, [GROUND] * SCENES, ROOMS)
    assert all(np.isnan(row.share) for row in rows)
    assert (
        np.isnan(covariates.share_of_gap(0.05, 0.1, 1.0))
        and covariates.share_of_gap(0.06, 0.12, 1.0) == 0.5
    )
    found_rules = rules.find_rules(first, second, [GROUND] * SCENES, ROOMS)
    assert len(found_rules) >= 2 and all(np.isnan(rule.share) for rule in found_rules)


def test_bins_without_a_gap_are_rarely_significant():
    """In 20 sets without a gap, about one has a smallest p-value below 5 %.

    More than four occur once in 400 such tests.
    """
    named = 0
    for number in range(20):
        first = [holes(1000 * number + scene) for scene in range(8)]
        second = [holes(1000 * number + 500 + scene) for scene in range(8)]
        rows = covariates.bin_gaps(first, second, [GROUND] * 8, [str(scene) for scene in range(8)])
        named += rows[0].p < 0.05
    assert named <= 4


def images(seed: int, gain: np.ndarray | float) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.rint(gain * EXPECTED + rng.standard_normal(EXPECTED.shape) + 5).astype(np.uint8)[None]


def pair_of(seed: int, gain: np.ndarray | float, holes: float) -> StereoObservation:
    image = images(seed, gain)
    return StereoObservation(left=image, right=image, ours_px=maps(seed, holes=holes))


def test_maps_show_a_gap_in_its_frame():
    x = np.indices(DISPARITY.shape)[1]
    falling = 1 - 0.4 * (x / DISPARITY.shape[1])
    simulated = [pair_of(scene, 1.0, 0.02) for scene in range(SCENES)]
    real = [pair_of(50 + scene, falling, 0.05) for scene in range(SCENES)]
    gap_maps = {
        (each.quantity, each.frame): each
        for each in maps_of.gap_maps(simulated, real, [GROUND] * SCENES, ROOMS)
    }
    level = gap_maps["infrared", maps_of.CAMERA]
    row = level.mean[maps_of.ROWS // 2]
    row = row[np.isfinite(row)]
    assert row[0] > row[-1] + 0.2
    assert np.nanmedian(np.abs(level.deviations)) > 3
    holes = gap_maps["holes", maps_of.PROJECTOR].mean
    assert np.nanmean(holes) == pytest.approx(0.03, abs=0.005)
    assert np.isnan(holes[0, 0])  # The image does not reach the corner of the field.
    assert np.nanmean(np.abs(gap_maps["error", maps_of.CAMERA].mean)) < 0.05


SCENE = scenes.wall(1.0)
BODY = SCENE.bodies[0]  # The strata have a second body that the scene does not have.


def test_gap_is_reported_by_object():
    only = np.where(GROUND.body == 2, 2.0, 1.0)
    gaps = maps_of.body_gaps(
        [("a", SCENE)], [pair_of(0, 1.0, 0.02)], [pair_of(1, only, 0.02)], [GROUND]
    )
    assert [each.body for each in gaps] == [1, 2]
    assert [(each.name, each.material) for each in gaps] == [
        (BODY.name, BODY.material.name),
        ("", ""),
    ]
    assert abs(gaps[0].infrared) < 0.02 and gaps[1].infrared > 0.4
    assert all(abs(each.holes) < 0.03 for each in gaps)


def test_more_contrast_is_not_darker():
    """A chequerboard that the scene model lacks does not change the mean level."""
    board = np.where(np.indices(DISPARITY.shape).sum(0) % 2, 1.7, 0.3)
    before, after = [pair_of(n, 1.0, 0.02) for n in range(2)], [pair_of(2, board, 0.02)] * 2
    gap_maps = maps_of.gap_maps(before, after, [GROUND] * 2, ROOMS[:2])
    level = next(each.mean for each in gap_maps if each.quantity == "infrared")
    assert abs(np.nanmedian(level)) < 0.02
    [*_, last_body] = maps_of.body_gaps([("a", SCENE)], before[:1], after[:1], [GROUND])
    assert abs(last_body.infrared) < 0.02


def test_maps_need_no_infrared():
    bare = [DepthObservation(device_px=pair_of(n, 1.0, 0.02).depth_px) for n in range(2)]
    gap_maps = maps_of.gap_maps(bare, bare, [GROUND] * 2, ROOMS[:2])
    assert {each.quantity for each in gap_maps} == {"error", "holes"}
    assert np.isnan(maps_of.body_gaps([("a", SCENE)], bare[:1], bare[:1], [GROUND])[0].infrared)


def test_rule_describes_the_location_of_holes():
    near = GROUND.covariates["x"].mask("left")
    first = [holes(scene) for scene in range(SCENES)]
    second = [holes(50 + scene, near) for scene in range(SCENES)]
    rule = rules.find_rules(first, second, [GROUND] * SCENES, ROOMS)[0]
    assert "x < 0.33" in rule.text and "widths" in rule.text
    assert rule.gap == pytest.approx(0.1, abs=0.02)
    assert rule.share == pytest.approx(1, abs=0.15)
    assert rule.area == pytest.approx(near.sum() / GROUND.counted.sum(), abs=0.03)


def test_rule_can_have_two_conditions():
    where = GROUND.covariates["x"].mask("left") & GROUND.covariates["y"].mask("top")
    first = [holes(scene) for scene in range(SCENES)]
    second = [holes(50 + scene, where) for scene in range(SCENES)]
    text = rules.find_rules(first, second, [GROUND] * SCENES, ROOMS)[0].text
    assert "and" in text


def test_noise_gives_no_confirmed_rule():
    first = [holes(scene) for scene in range(SCENES)]
    second = [holes(50 + scene) for scene in range(SCENES)]
    assert all(
        abs(rule.gap) < 0.02 for rule in rules.find_rules(first, second, [GROUND] * SCENES, ROOMS)
    )


def test_rule_needs_rooms_that_agree_on_average():
    """Three of four rooms have slightly fewer holes there, and one has many more."""
    near = GROUND.covariates["x"].mask("left")
    rng = np.random.default_rng(0)

    def with_gap(gap: float) -> np.ndarray:
        mask = rng.random(DISPARITY.shape) < 0.4
        drawn = near & (rng.random(DISPARITY.shape) < abs(gap) / (0.4 if gap < 0 else 0.6))
        return mask & ~drawn if gap < 0 else mask | drawn

    def rules_for(judging: list[float]) -> list[rules.GapRule]:
        gaps = [each for judged in judging for each in (-0.2, judged)]
        first, second = ([with_gap(each) for each in many] for many in ([0] * len(gaps), gaps))
        rooms = [f"room {number}" for number in range(len(gaps))]
        return rules.find_rules(first, second, [GROUND] * len(gaps), rooms)

    assert any("x < 0.33" in rule.text for rule in rules_for([-0.2, -0.2, -0.2, 0.05]))
    assert not any("x < 0.33" in rule.text for rule in rules_for([-0.02, -0.02, -0.02, 0.6]))


def test_few_rooms_give_no_rule():
    near = GROUND.covariates["x"].mask("left")
    first = [holes(scene) for scene in range(SCENES)]
    second = [holes(50 + scene, near) for scene in range(SCENES)]
    rooms = ["hall", "hall", "attic", "attic", "porch", "porch"]
    assert rules.find_rules(first, second, [GROUND] * SCENES, rooms) == []


def test_two_rooms_give_no_interval():
    """Two rooms have no interval, regardless of the number of scenes."""
    rooms = ["hall"] * (SCENES - 1) + ["attic"]
    figures = swap.stage_figures(
        readings(0, 0.02, None), readings(100, 0.05, 0.11), [GROUND] * SCENES, rooms
    )["ndp_rate"]
    assert figures.image is not None and figures.image[1:] == (None, None)
    first, second = ([holes(seed + scene) for scene in range(SCENES)] for seed in (0, 50))
    row = covariates.bin_gaps(first, second, [GROUND] * SCENES, rooms)[0]
    assert np.isnan(row.low) and np.isnan(row.high)


def test_bin_in_two_of_many_rooms_has_no_interval():
    first, second = ([holes(seed + scene) for scene in range(SCENES)] for seed in (0, 50))
    everywhere = np.ones(DISPARITY.shape, bool)
    for many in (2, 3):
        seen = [{"felt": everywhere} if scene < many else {} for scene in range(SCENES)]
        rows = covariates.bin_gaps(first, second, [GROUND] * SCENES, ROOMS, seen)
        (felt,) = (row for row in rows if row.bin == "felt")
        assert np.isnan(felt.low) == np.isnan(felt.high) == (many < 3)


@pytest.mark.parametrize("count", [3, 6])
def test_maps_of_noise_are_rarely_significant(count):
    """One in 370 cells of noise exceeds three standard deviations, also for few scenes."""
    first = [pair_of(scene, 1.0, 0.02) for scene in range(count)]
    second = [pair_of(50 + scene, 1.0, 0.02) for scene in range(count)]
    gap_maps = maps_of.gap_maps(first, second, [GROUND] * count, ROOMS[:count])
    far = np.concatenate([each.deviations[np.isfinite(each.deviations)] for each in gap_maps])
    assert far.size > 1000 and np.mean(np.abs(far) > 3) < 0.01
    of_two = maps_of.gap_maps(first[:2], second[:2], [GROUND] * 2, ROOMS[:2])
    assert all(np.isnan(each.deviations).all() for each in of_two)


def test_infrared_map_uses_scenes_with_infrared():
    pairs = [pair_of(scene, 1.0, 0.02) for scene in range(3)]
    bare = DepthObservation(device_px=pairs[2].depth_px)
    gap_maps = maps_of.gap_maps([*pairs[:2], bare], [*pairs[:2], bare], [GROUND] * 3, ROOMS[:3])
    assert {each.quantity for each in gap_maps} == {"infrared", "error", "holes"}


def test_maps_have_the_sign_of_the_gap_and_the_axes_of_the_field():
    """A map has the sign of the gap; right and down in the field are right and down in the map."""
    more = dataclasses.replace(
        GROUND, projector=np.stack(np.meshgrid(*AXES), axis=-1).astype(np.float32)
    )
    assert (np.abs(more.projector) < 1).all()
    step = (0.2 * (more.projector[..., 0] > 0.25)).astype(np.float32)

    def off(each: StereoObservation, shift_px: np.ndarray | float) -> StereoObservation:
        return dataclasses.replace(each, ours_px=each.ours_px + np.float32(shift_px))

    plain = [pair_of(scene, 1.0, 0.0) for scene in range(SCENES)]
    for shift_px, sign in ((0.2, 1), (-0.2, -1)):
        real = [off(pair_of(50 + scene, 1.0, 0.0), shift_px) for scene in range(SCENES)]
        gap_maps = maps_of.gap_maps(plain, real, [GROUND] * SCENES, ROOMS)
        (error,) = (each for each in gap_maps if (each.quantity, each.frame) == ("error", "camera"))
        assert np.nanmean(error.mean) == pytest.approx(shift_px, abs=0.01)
        known = error.deviations[np.isfinite(error.deviations)]
        assert (sign * known > 3).all()
    real = [off(pair_of(50 + scene, 1.0, 0.0), step) for scene in range(SCENES)]
    gap_maps = maps_of.gap_maps(plain, real, [more] * SCENES, ROOMS)
    (error,) = (each for each in gap_maps if (each.quantity, each.frame) == ("error", "projector"))
    column = int((0.25 + 1) / 2 * maps_of.COLUMNS)
    assert np.nanmax(np.abs(error.mean[:, : column - 1])) < 0.06
    assert np.nanmin(error.mean[:, column + 1 :]) > 0.14
    first, last = np.flatnonzero(np.isfinite(error.mean).any(axis=1))[[0, -1]]
    rows = [(end + 1) / 2 * maps_of.ROWS for end in (AXES[1][0], AXES[1][-1])]
    assert (first, last) == (int(rows[0]), int(rows[1]))


def test_p_value_counts_rooms_not_scenes():
    """Signs of two rooms agree by chance in half of all cases."""
    left = GROUND.covariates["x"].mask("left")
    first = [holes(scene) for scene in range(SCENES)]
    second = [holes(50 + scene, left) for scene in range(SCENES)]
    rows = covariates.bin_gaps(first, second, [GROUND] * SCENES, ["hall"] * 3 + ["attic"] * 3)
    row = next(row for row in rows if (row.covariate, row.bin) == ("x", "left"))
    assert row.gap > 0.09 and row.p > 0.4


def test_areas_and_shares_refer_to_all_counted_pixels():
    left, right = (GROUND.covariates["x"].mask(word) for word in ("left", "right"))
    chance = np.random.default_rng(0).random(DISPARITY.shape)
    first, second = right & (chance < 0.06), left & (chance < 0.1)
    rows = covariates.bin_gaps([first] * SCENES, [second] * SCENES, [GROUND] * SCENES, ROOMS)
    by_bin = {row.bin: row for row in rows if row.covariate == "x"}
    total = second.sum() - first.sum()
    for word, net in (("left", second.sum()), ("right", -first.sum()), ("centre", 0)):
        area = GROUND.covariates["x"].mask(word).sum() / GROUND.counted.sum()
        assert by_bin[word].area == pytest.approx(area)
        assert by_bin[word].share == pytest.approx(net / total)


def test_wrong_depth_is_separate_from_holes():
    left = GROUND.covariates["x"].mask("left")
    true = DISPARITY[None]
    off = true + np.float32(1.5) * left

    def subject(number: int) -> Any:
        plain, real = (DepthObservation(device_px=each) for each in (true, off))
        return SimpleNamespace(
            name=f"scene {number}",
            room=f"room {number}",
            real=real,
            against=plain,
            strata=GROUND,
            scene=SimpleNamespace(bodies=()),
            estimates=number > 0,
        )

    location = locate_gap([subject(number) for number in range(4)])
    row = next(row for row in location.error_bins if (row.covariate, row.bin) == ("x", "left"))
    assert row.gap == pytest.approx(1.0) and row.share == pytest.approx(1.0)
    assert {body.scene for body in location.bodies} == {"scene 0"}
    assert all(row.gap == 0 for row in location.hole_bins)


def test_rule_needs_half_of_the_learned_gap_and_a_least_gap():
    assert not rules._confirmed(0.1, np.full(4, 0.04)) and rules._confirmed(0.1, np.full(4, 0.06))
    assert not rules._confirmed(0.004, np.full(4, 0.004))
