"""Where the gap lies: parts of the chain, bins of covariates."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from starling.diagnosis.scenes.observation import Reading
from starling.diagnosis.where import covariates, rules, swap
from starling.diagnosis.where import maps as maps_of
from starling.diagnosis.where.location import where
from starling.diagnosis.where.materials import materials
from starling.sim.scene.builtin import scenes
from starling.sim.scene.scene import Material
from tests.unit.diagnosis.test_features import DISPARITY, EXPECTED, GROUND

SCENES = 6
AXES = (np.linspace(-0.5, 0.9, 240), np.linspace(-0.2, 0.6, 160))  # Across and down a field.
ROOMS = [f"room {number}" for number in range(SCENES)]


def maps(seed: int, *, holes: float, noise_px: float = 0.1) -> np.ndarray:
    rng = np.random.default_rng(seed)
    found = DISPARITY + noise_px * rng.standard_normal(DISPARITY.shape)
    found[rng.random(DISPARITY.shape) < holes] = np.nan
    return found.astype(np.float32)[None]


def readings(seed: int, ours: float, device: float | None) -> list[Reading]:
    return [
        Reading(
            left=None,
            right=None,
            ours_px=maps(seed + scene, holes=ours),
            device_px=None if device is None else maps(seed + 50 + scene, holes=device),
        )
        for scene in range(SCENES)
    ]


def holes(seed: int, where: np.ndarray | None = None) -> np.ndarray:
    rng = np.random.default_rng(seed)
    chance = np.full(DISPARITY.shape, 0.03)
    if where is not None:
        chance[where] += 0.1
    return rng.random(DISPARITY.shape) < chance


def test_more_holes_in_one_bin_are_found_there():
    near = GROUND.covariates["x"].where("left")
    first = [holes(scene) for scene in range(SCENES)]
    second = [holes(50 + scene, near) for scene in range(SCENES)]
    rows = covariates.table(first, second, [GROUND] * SCENES, ROOMS)
    row = next(row for row in rows if (row.covariate, row.bin) == ("x", "left"))
    assert row.gap == pytest.approx(0.1, abs=0.01) and row.low < 0.1 < row.high
    assert row.share == pytest.approx(1, abs=0.15) and row.p < 0.06
    other = next(row for row in rows if (row.covariate, row.bin) == ("x", "right"))
    assert abs(other.gap) < 0.01 and other.p > 0.2


def test_a_material_is_one_more_covariate():
    """A tenth more of what is made of it has no depth, in the scenes that have it."""
    of_cloth = GROUND.counted & (np.arange(DISPARITY.shape[0])[:, None] < 40)
    of_wood = GROUND.counted & ~of_cloth
    first = [holes(scene) for scene in range(SCENES)]
    second = [holes(50 + scene, of_cloth if scene else None) for scene in range(SCENES)]
    parts = [{"cloth": of_cloth, "wood": of_wood}] * SCENES
    parts[0] = {"wood": GROUND.counted}
    rows = covariates.table(first, second, [GROUND] * SCENES, ROOMS, parts)
    found = {row.bin: row for row in rows if row.covariate == "material"}
    assert found["cloth"].gap == pytest.approx(0.1, abs=0.01)
    assert abs(found["wood"].gap) < 0.01 and set(found) == {"cloth", "wood"}
    assert all(
        row.covariate != "material"
        for row in covariates.table(first, second, [GROUND] * SCENES, ROOMS, [{}] * SCENES)
    )


def test_pixels_are_parted_by_what_bodies_are_made_of():
    cloth, wood = Material(name="cloth"), Material(name="wood")
    bodies = [SimpleNamespace(material=one) for one in (wood, cloth, wood)]
    columns = np.arange(DISPARITY.shape[1])
    body = np.broadcast_to(columns * 3 // columns.size + 1, DISPARITY.shape).astype(np.uint32)
    ground = dataclasses.replace(GROUND, body=body)
    scene: Any = SimpleNamespace(bodies=bodies)
    found = materials(scene, ground)
    np.testing.assert_array_equal(found["cloth"], GROUND.counted & (body == 2))
    np.testing.assert_array_equal(found["wood"], GROUND.counted & (body != 2))
    alone: Any = SimpleNamespace(bodies=bodies[:1])
    assert materials(alone, ground) == {}  # All of one.
    unseen: Any = SimpleNamespace(bodies=bodies)
    first = dataclasses.replace(ground, body=np.minimum(body, 1))
    assert materials(unseen, first) == {}  # And of two, where no pixel shows the other.


def test_gaps_that_cancel_have_no_shares():
    """Ten points more on one side, as many fewer on the other."""
    left, right = (GROUND.covariates["x"].where(word) for word in ("left", "right"))
    first = [holes(scene, right) for scene in range(SCENES)]
    second = [holes(50 + scene, left) for scene in range(SCENES)]
    rows = covariates.table(first, second, [GROUND] * SCENES, ROOMS)
    assert all(np.isnan(row.share) for row in rows)
    assert np.isnan(covariates.share(0.05, 0.1, 1.0)) and covariates.share(0.06, 0.12, 1.0) == 0.5
    told = rules.rules(first, second, [GROUND] * SCENES, ROOMS)
    assert len(told) >= 2 and all(np.isnan(rule.share) for rule in told)


def test_rows_of_no_gap_are_rarely_named():
    """20 sets of scenes without a gap: the smallest chance of all rows is below 5 % in about
    one; in more than four once in 400 such tests."""
    named = 0
    for number in range(20):
        first = [holes(1000 * number + scene) for scene in range(8)]
        second = [holes(1000 * number + 500 + scene) for scene in range(8)]
        rows = covariates.table(first, second, [GROUND] * 8, [str(scene) for scene in range(8)])
        named += rows[0].p < 0.05
    assert named <= 4


def images(seed: int, gain: np.ndarray | float) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.rint(gain * EXPECTED + rng.standard_normal(EXPECTED.shape) + 5).astype(np.uint8)[None]


def pair_of(seed: int, gain: np.ndarray | float, holes: float) -> Reading:
    image = images(seed, gain)
    return Reading(left=image, right=image, ours_px=maps(seed, holes=holes), device_px=None)


def test_maps_show_a_gap_in_the_frame_that_it_stands_in():
    x = np.indices(DISPARITY.shape)[1]
    falling = 1 - 0.4 * (x / DISPARITY.shape[1])
    simulated = [pair_of(scene, 1.0, 0.02) for scene in range(SCENES)]
    real = [pair_of(50 + scene, falling, 0.05) for scene in range(SCENES)]
    found = {
        (one.quantity, one.frame): one
        for one in maps_of.maps(simulated, real, [GROUND] * SCENES, ROOMS)
    }
    level = found["infrared", maps_of.CAMERA]
    row = level.mean[maps_of.ROWS // 2]
    row = row[np.isfinite(row)]
    assert row[0] > row[-1] + 0.2
    assert np.nanmedian(np.abs(level.deviations)) > 3
    holes = found["holes", maps_of.PROJECTOR].mean
    assert np.nanmean(holes) == pytest.approx(0.03, abs=0.005)
    assert np.isnan(holes[0, 0])  # The image does not reach the field's corner.
    assert np.nanmean(np.abs(found["error", maps_of.CAMERA].mean)) < 0.05


SCENE = scenes.wall(1.0)
BODY = SCENE.bodies[0]  # The second that the ground has is none of the scene's.


def test_a_gap_on_one_object_is_told_of_it():
    only = np.where(GROUND.body == 2, 2.0, 1.0)
    found = maps_of.bodies(
        [("a", SCENE)], [pair_of(0, 1.0, 0.02)], [pair_of(1, only, 0.02)], [GROUND]
    )
    assert [one.body for one in found] == [1, 2]
    assert [(one.name, one.material) for one in found] == [
        (BODY.name, BODY.material.name),
        ("", ""),
    ]
    assert abs(found[0].infrared) < 0.02 and found[1].infrared > 0.4
    assert all(abs(one.holes) < 0.03 for one in found)


def test_more_contrast_is_not_darker():
    """What the scene's model has not, as a chequerboard, leaves its mean level as it was."""
    board = np.where(np.indices(DISPARITY.shape).sum(0) % 2, 1.7, 0.3)
    before, after = [pair_of(n, 1.0, 0.02) for n in range(2)], [pair_of(2, board, 0.02)] * 2
    found = maps_of.maps(before, after, [GROUND] * 2, ROOMS[:2])
    level = next(one.mean for one in found if one.quantity == "infrared")
    assert abs(np.nanmedian(level)) < 0.02
    [*_, of_all] = maps_of.bodies([("a", SCENE)], before[:1], after[:1], [GROUND])
    assert abs(of_all.infrared) < 0.02


def test_maps_do_without_infrared():
    bare = [dataclasses.replace(pair_of(n, 1.0, 0.02), left=None, right=None) for n in range(2)]
    found = maps_of.maps(bare, bare, [GROUND] * 2, ROOMS[:2])
    assert {one.quantity for one in found} == {"error", "holes"}
    assert np.isnan(maps_of.bodies([("a", SCENE)], bare[:1], bare[:1], [GROUND])[0].infrared)


def test_a_rule_says_where_holes_are():
    near = GROUND.covariates["x"].where("left")
    first = [holes(scene) for scene in range(SCENES)]
    second = [holes(50 + scene, near) for scene in range(SCENES)]
    rule = rules.rules(first, second, [GROUND] * SCENES, ROOMS)[0]
    assert "x < 0.33" in rule.text and "widths" in rule.text
    assert rule.gap == pytest.approx(0.1, abs=0.02)
    assert rule.share == pytest.approx(1, abs=0.15)
    assert rule.area == pytest.approx(near.sum() / GROUND.counted.sum(), abs=0.03)


def test_a_rule_of_two_conditions_says_both():
    where = GROUND.covariates["x"].where("left") & GROUND.covariates["y"].where("top")
    first = [holes(scene) for scene in range(SCENES)]
    second = [holes(50 + scene, where) for scene in range(SCENES)]
    text = rules.rules(first, second, [GROUND] * SCENES, ROOMS)[0].text
    assert "and" in text


def test_no_rule_is_made_of_noise_that_other_scenes_do_not_confirm():
    first = [holes(scene) for scene in range(SCENES)]
    second = [holes(50 + scene) for scene in range(SCENES)]
    assert all(
        abs(rule.gap) < 0.02 for rule in rules.rules(first, second, [GROUND] * SCENES, ROOMS)
    )


def test_no_rule_is_confirmed_by_rooms_that_say_the_opposite_on_average():
    """Three of four rooms have hardly fewer holes there, and one has many more."""
    near = GROUND.covariates["x"].where("left")
    rng = np.random.default_rng(0)

    def with_gap(gap: float) -> np.ndarray:
        found = rng.random(DISPARITY.shape) < 0.4
        drawn = near & (rng.random(DISPARITY.shape) < abs(gap) / (0.4 if gap < 0 else 0.6))
        return found & ~drawn if gap < 0 else found | drawn

    def of(judging: list[float]) -> list[rules.Rule]:
        gaps = [one for judged in judging for one in (-0.2, judged)]
        first, second = ([with_gap(each) for each in many] for many in ([0] * len(gaps), gaps))
        rooms = [f"room {number}" for number in range(len(gaps))]
        return rules.rules(first, second, [GROUND] * len(gaps), rooms)

    assert any("x < 0.33" in rule.text for rule in of([-0.2, -0.2, -0.2, 0.05]))
    assert not any("x < 0.33" in rule.text for rule in of([-0.02, -0.02, -0.02, 0.6]))


def test_rules_of_few_rooms_are_confirmed_by_none():
    near = GROUND.covariates["x"].where("left")
    first = [holes(scene) for scene in range(SCENES)]
    second = [holes(50 + scene, near) for scene in range(SCENES)]
    rooms = ["hall", "hall", "attic", "attic", "porch", "porch"]
    assert rules.rules(first, second, [GROUND] * SCENES, rooms) == []


def test_scenes_of_one_room_are_one_piece_of_evidence():
    """Two rooms have no interval, however many scenes were captured in them."""
    rooms = ["hall"] * (SCENES - 1) + ["attic"]
    found = swap.swap(readings(0, 0.02, None), readings(100, 0.05, 0.11), [GROUND] * SCENES, rooms)[
        "ndp_rate"
    ]
    assert found.image is not None and found.image[1:] == (None, None)
    first, second = ([holes(seed + scene) for scene in range(SCENES)] for seed in (0, 50))
    row = covariates.table(first, second, [GROUND] * SCENES, rooms)[0]
    assert np.isnan(row.low) and np.isnan(row.high)


def test_what_is_seen_in_two_rooms_of_many_has_no_interval():
    first, second = ([holes(seed + scene) for scene in range(SCENES)] for seed in (0, 50))
    everywhere = np.ones(DISPARITY.shape, bool)
    for many in (2, 3):
        seen = [{"felt": everywhere} if scene < many else {} for scene in range(SCENES)]
        rows = covariates.table(first, second, [GROUND] * SCENES, ROOMS, seen)
        (felt,) = (row for row in rows if row.bin == "felt")
        assert np.isnan(felt.low) == np.isnan(felt.high) == (many < 3)


@pytest.mark.parametrize("count", [3, 6])
def test_a_map_of_few_scenes_is_rarely_clear(count):
    """Of cells of noise one in 370 is beyond three deviations, however few scenes there are."""
    first = [pair_of(scene, 1.0, 0.02) for scene in range(count)]
    second = [pair_of(50 + scene, 1.0, 0.02) for scene in range(count)]
    found = maps_of.maps(first, second, [GROUND] * count, ROOMS[:count])
    far = np.concatenate([one.deviations[np.isfinite(one.deviations)] for one in found])
    assert far.size > 1000 and np.mean(np.abs(far) > 3) < 0.01
    of_two = maps_of.maps(first[:2], second[:2], [GROUND] * 2, ROOMS[:2])
    assert all(np.isnan(one.deviations).all() for one in of_two)


def test_a_map_holds_the_scenes_that_have_infrared():
    pairs = [pair_of(scene, 1.0, 0.02) for scene in range(3)]
    bare = dataclasses.replace(pairs[2], left=None, right=None)
    found = maps_of.maps([*pairs[:2], bare], [*pairs[:2], bare], [GROUND] * 3, ROOMS[:3])
    assert {one.quantity for one in found} == {"infrared", "error", "holes"}


def test_maps_have_the_gap_s_sign_and_the_projector_s_axes():
    """Farther to the right and down in its field a point lies farther right and down in its map."""
    more = dataclasses.replace(
        GROUND, projector=np.stack(np.meshgrid(*AXES), axis=-1).astype(np.float32)
    )
    assert (np.abs(more.projector) < 1).all()
    step = (0.2 * (more.projector[..., 0] > 0.25)).astype(np.float32)

    def off(one: Reading, by: np.ndarray | float) -> Reading:
        assert one.ours_px is not None
        return dataclasses.replace(one, ours_px=one.ours_px + np.float32(by))

    plain = [pair_of(scene, 1.0, 0.0) for scene in range(SCENES)]
    for by, sign in ((0.2, 1), (-0.2, -1)):
        real = [off(pair_of(50 + scene, 1.0, 0.0), by) for scene in range(SCENES)]
        found = maps_of.maps(plain, real, [GROUND] * SCENES, ROOMS)
        (error,) = (one for one in found if (one.quantity, one.frame) == ("error", "camera"))
        assert np.nanmean(error.mean) == pytest.approx(by, abs=0.01)
        known = error.deviations[np.isfinite(error.deviations)]
        assert (sign * known > 3).all()
    real = [off(pair_of(50 + scene, 1.0, 0.0), step) for scene in range(SCENES)]
    found = maps_of.maps(plain, real, [more] * SCENES, ROOMS)
    (error,) = (one for one in found if (one.quantity, one.frame) == ("error", "projector"))
    column = int((0.25 + 1) / 2 * maps_of.COLUMNS)
    assert np.nanmax(np.abs(error.mean[:, : column - 1])) < 0.06
    assert np.nanmin(error.mean[:, column + 1 :]) > 0.14
    first, last = np.flatnonzero(np.isfinite(error.mean).any(axis=1))[[0, -1]]
    rows = [(end + 1) / 2 * maps_of.ROWS for end in (AXES[1][0], AXES[1][-1])]
    assert (first, last) == (int(rows[0]), int(rows[1]))


def test_scenes_of_one_room_are_no_evidence_of_their_own():
    """Of two rooms signs agree by chance every other time."""
    left = GROUND.covariates["x"].where("left")
    first = [holes(scene) for scene in range(SCENES)]
    second = [holes(50 + scene, left) for scene in range(SCENES)]
    rows = covariates.table(first, second, [GROUND] * SCENES, ["hall"] * 3 + ["attic"] * 3)
    row = next(row for row in rows if (row.covariate, row.bin) == ("x", "left"))
    assert row.gap > 0.09 and row.p > 0.4


def test_areas_and_shares_are_of_all_counted_pixels():
    left, right = (GROUND.covariates["x"].where(word) for word in ("left", "right"))
    chance = np.random.default_rng(0).random(DISPARITY.shape)
    first, second = right & (chance < 0.06), left & (chance < 0.1)
    rows = covariates.table([first] * SCENES, [second] * SCENES, [GROUND] * SCENES, ROOMS)
    found = {row.bin: row for row in rows if row.covariate == "x"}
    total = second.sum() - first.sum()
    for word, net in (("left", second.sum()), ("right", -first.sum()), ("centre", 0)):
        area = GROUND.covariates["x"].where(word).sum() / GROUND.counted.sum()
        assert found[word].area == pytest.approx(area)
        assert found[word].share == pytest.approx(net / total)


def test_depth_that_is_off_is_told_apart_from_holes():
    left = GROUND.covariates["x"].where("left")
    true = DISPARITY[None]
    off = true + np.float32(1.5) * left

    def subject(number: int) -> Any:
        plain, real = (
            Reading(left=None, right=None, ours_px=one, device_px=None) for one in (true, off)
        )
        return SimpleNamespace(
            name=f"scene {number}",
            room=f"room {number}",
            real=real,
            against=plain,
            ground=GROUND,
            scene=SimpleNamespace(bodies=()),
            estimates=number > 0,
        )

    found = where([subject(number) for number in range(4)])
    row = next(row for row in found.off if (row.covariate, row.bin) == ("x", "left"))
    assert row.gap == pytest.approx(1.0) and row.share == pytest.approx(1.0)
    assert {body.scene for body in found.bodies} == {"scene 0"}
    assert all(row.gap == 0 for row in found.rows)


def test_a_rule_needs_half_of_what_was_learnt_and_a_least_gap():
    assert not rules._confirmed(0.1, np.full(4, 0.04)) and rules._confirmed(0.1, np.full(4, 0.06))
    assert not rules._confirmed(0.004, np.full(4, 0.004))
