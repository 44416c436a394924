"""Plans of an imperfect base: which imperfections cases have, and strengths beyond the table."""

from __future__ import annotations

import collections
import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from starling.diagnosis.validation.camera.catalogue import ROWS, Strengths
from starling.diagnosis.validation.camera.errors import WithheldError
from starling.diagnosis.validation.camera.imperfections import IMPERFECTIONS, SPOTS
from starling.diagnosis.validation.camera.nominal import Nominal
from starling.diagnosis.validation.protocol import case, plan
from starling.diagnosis.validation.protocol.case import FARTHEST, CaseKind, draw
from starling.diagnosis.validation.protocol.tier import TIERS

COUNTS: dict[CaseKind, int] = {"null": 6, "single": 12, "pair": 6, "unknown": 6}


def _draw(name: str, count: int, entropy: int = 3) -> list[dict[str, float]]:
    return plan.draw(name, count, case.random_generator(entropy))


@given(name=st.sampled_from(plan.PLANS), entropy=st.integers(0, 2**64))
def test_strengths_are_in_their_ranges(name: str, entropy: int) -> None:
    for world in _draw(name, 7, entropy):
        for key, value in world.items():
            assert IMPERFECTIONS[key].least <= value <= IMPERFECTIONS[key].most


def test_all_at_once_have_one_spot() -> None:
    worlds = _draw(plan.ALL, 60)
    for world in worlds:
        assert IMPERFECTIONS.keys() - world.keys() < set(SPOTS)
        assert len(world) == len(IMPERFECTIONS) - 1
    counts = collections.Counter(name for world in worlds for name in world if name in SPOTS)
    assert min(counts[name] for name in SPOTS) > 15
    assert len({world["texture"] for world in worlds}) == 60


def test_one_by_one_cycles_through_all() -> None:
    names = [next(iter(world)) for world in _draw(plan.EACH, 3 * len(IMPERFECTIONS))]
    assert collections.Counter(names) == dict.fromkeys(IMPERFECTIONS, 3)
    assert {next(iter(world)) for world in _draw("texture", 4)} == {"texture"}
    firsts = {next(iter(_draw(plan.EACH, 1, entropy)[0])) for entropy in range(40)}
    assert firsts == IMPERFECTIONS.keys()


def test_an_unknown_plan_is_refused(camera: Nominal) -> None:
    with pytest.raises(WithheldError, match=r"imperfect must be one of \['all', 'each'.*got fog"):
        draw(camera, COUNTS, imperfect="fog")


def test_the_truth_holds_the_imperfections(camera: Nominal) -> None:
    drawn = draw(camera, COUNTS, imperfect=plan.EACH, entropy=7)
    assert all(len(each.imperfections) == 1 for each in drawn)
    kinds = collections.Counter((each.kind, name) for each in drawn for name in each.imperfections)
    assert kinds == {
        (kind, name): count // 6 for kind, count in COUNTS.items() for name in IMPERFECTIONS
    }
    assert case.loads(case.dumps(drawn)) == drawn


def test_a_perfect_base_leaves_draws_and_truth_as_they_were(camera: Nominal) -> None:
    """Development cases have a fixed seed, so new options must not change their draws."""
    perfect = draw(camera, COUNTS, entropy=7)
    imperfect = draw(camera, COUNTS, imperfect=plan.ALL, entropy=7)
    assert all(each.imperfections == {} for each in perfect)
    assert all(each.keys() == {"number", "kind", "settings", "seed"} for each in _json(perfect))
    assert collections.Counter(str(each.settings) for each in perfect) == collections.Counter(
        str(each.settings) for each in imperfect
    )


def _json(cases: tuple[case.Case, ...]) -> list[dict[str, object]]:
    return json.loads(case.dumps(cases))


@pytest.mark.parametrize("value", ["[]", '{"texture": "much"}'])
def test_damaged_imperfections_are_refused(value: str) -> None:
    text = (
        f'[{{"number": 1, "kind": "null", "settings": {{}}, "seed": 2, "imperfections": {value}}}]'
    )
    with pytest.raises(WithheldError, match="imperfections must be numbers by name"):
        case.loads(text)


def test_some_strengths_lie_beyond_the_table(camera: Nominal) -> None:
    drawn = draw(camera, {"single": 900}, kinds=("image", "post"), beyond=0.3, entropy=7)
    ratios = []
    for each in drawn:
        Strengths(nominal=camera, values=each.settings)
        ((name, value),) = each.settings.items()
        row = ROWS[name]
        if row.scale != "choice":
            sign = 1 if value >= row.neutral_of(camera) else -1
            ratios.append(row.departure(camera, value) / row.reach(camera, sign))
    assert 1.4 < max(ratios) <= FARTHEST * (1 + 1e-9)
    assert 0.15 < np.mean(np.array(ratios) > 1.0) < 0.35


@pytest.mark.parametrize("row", [r for r in ROWS.values() if r.scale != "choice"])
def test_beyond_the_table_physical_bounds_stay(row, camera: Nominal) -> None:
    wide = row.beyond(FARTHEST)
    for sign in row.signs:
        value = wide.value(camera, wide.reach(camera, sign), sign)
        Strengths(nominal=camera, values={row.name: value})
        assert wide.reach(camera, sign) >= row.reach(camera, sign) * (1 - 1e-9)
    assert row.beyond(1.0) == row


def test_tier_five_has_other_scenes_than_development() -> None:
    tier = TIERS[5]
    numbers = {
        int(name.split(":")[1]) for each in range(tier.sets) for name in tier.scene_names(each)
    }
    assert tier.imperfect and not numbers & set(range(7100, 7130))
    others = {
        name
        for number, rendered in TIERS.items()
        if number not in (4, 5)
        for each in range(rendered.sets)
        for name in rendered.scene_names(each)
    }
    assert not others & {name for each in range(tier.sets) for name in tier.scene_names(each)}
