"""Cases: the effect table, the random draw, and the tiers."""

from __future__ import annotations

import collections
import dataclasses
import math
import re
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from starling.diagnosis.validation.camera import nominal
from starling.diagnosis.validation.camera.catalogue import ROWS, Strengths
from starling.diagnosis.validation.camera.errors import WithheldError
from starling.diagnosis.validation.camera.nominal import Nominal
from starling.diagnosis.validation.protocol import case
from starling.diagnosis.validation.protocol.case import draw
from starling.diagnosis.validation.protocol.limits import DetectionLimits
from starling.diagnosis.validation.protocol.tier import TIERS
from starling.diagnosis.which.candidates import LEFT_OUT
from starling.sim import effects

DOCS = Path(__file__).parents[4] / "docs"
PAGES = DOCS / "effects"
FAMILIES = {row.name: row.family for row in effects.table()}
COUNTS: dict[case.CaseKind, int] = {"null": 4, "single": 90, "pair": 12, "unknown": 9}


def test_effects_have_the_names_of_their_pages() -> None:
    pages = {path.stem for path in PAGES.glob("*.md")}
    for row in ROWS.values():
        assert (row.name in pages) == (row.kind != "outside"), row.name
    assert len([row for row in ROWS.values() if row.kind == "outside"]) >= 8


def test_excluded_effects_are_documented() -> None:
    """The list and the counts of decision 0021 agree with the table."""
    tried = {row.name for row in effects.table()} - LEFT_OUT
    missing = tried - ROWS.keys()
    note = (DOCS / "decisions" / "0021-check-on-withheld-effects.md").read_text(encoding="utf-8")
    listed = note.split("### Effects that are never withheld")[1].split("`dot_defocus`")[0]
    assert {*re.findall(r"`(\w+)`", listed)} == missing
    counts = [len(tried), len(tried - missing), len(missing)]
    pattern = r"Of the (\d+) rows .* tries (\d+) can be withheld; .* Of the other (\d+) "
    assert re.findall(pattern, listed) == [tuple(map(str, counts))]


def test_units_are_those_of_the_pages() -> None:
    for row in ROWS.values():
        if row.kind == "outside":
            continue
        page = (PAGES / f"{row.name}.md").read_text(encoding="utf-8")
        first = page.split("| --- | --- | --- | --- | --- |\n")[1].splitlines()[0]
        assert first.split("|")[5].strip() == row.unit, row.name


def test_image_effects_stay_in_the_ranges_of_their_pages(camera: Nominal) -> None:
    """The diagnosis searches only between the ends of the page's range, or from its neutral."""
    for row in (row for row in ROWS.values() if row.kind == "image" and row.scale != "choice"):
        first = effects.named(row.name).parameters[0]
        assert first.low is not None and first.high is not None
        low = first.low if first.neutral is None else min(first.low, float(first.neutral))
        for sign in row.signs:
            end = row.value(camera, row.reach(camera, sign), sign)
            assert low - 1e-9 <= end <= first.high * (1 + 1e-9), row.name


@pytest.mark.parametrize("name", [r.name for r in ROWS.values() if r.scale != "choice"])
@given(share=st.floats(0.0, 1.0))
@settings(max_examples=10)
def test_departure_inverts_value(name: str, share: float, camera: Nominal) -> None:
    row = ROWS[name]
    assert row.low < row.high
    for sign in row.signs:
        departure = share * row.reach(camera, sign)
        value = row.value(camera, departure, sign)
        assert row.departure(camera, value) == pytest.approx(departure, rel=1e-6, abs=1e-9)
        assert row.least - 1e-9 <= value <= row.most + 1e-9


def test_cases_are_drawn_by_kind(camera: Nominal) -> None:
    drawn = draw(camera, COUNTS, families=FAMILIES, entropy=7)
    assert [drawn_case.number for drawn_case in drawn] == list(range(115))
    kinds = [drawn_case.kind for drawn_case in drawn]
    assert {kind: kinds.count(kind) for kind in COUNTS} == COUNTS
    assert kinds[:4] != ["null"] * 4
    assert len({drawn_case.seed for drawn_case in drawn}) == len(drawn)
    singles = collections.Counter(next(iter(c.settings)) for c in drawn if c.kind == "single")
    assert max(singles.values()) - min(singles.values()) <= 1
    for drawn_case in drawn:
        Strengths(nominal=camera, values=drawn_case.settings)
        rows = [ROWS[name] for name in drawn_case.settings]
        assert len(rows) == {"null": 0, "single": 1, "pair": 2, "unknown": 1}[drawn_case.kind]
        assert len({FAMILIES.get(row.name, row.name) for row in rows}) == len(rows)
        for row in rows:
            assert (row.kind == "outside") == (drawn_case.kind == "unknown")
            departure = row.departure(camera, drawn_case.settings[row.name])
            assert departure > 0
            assert row.scale == "choice" or departure >= row.low * (1 - 1e-9)


def test_strengths_are_log_uniform_from_the_limit(camera: Nominal) -> None:
    limit = DetectionLimits(
        departures={("vertical_offset", 1): 0.3, ("vertical_offset", -1): 0.3}, choices={}
    )
    others = [row.name for row in ROWS.values() if row.name != "vertical_offset"]
    drawn = draw(camera, {"single": 800}, limits=limit, leave_out=others, entropy=1)
    values = np.array([drawn_case.settings["vertical_offset"] for drawn_case in drawn])
    assert abs(np.mean(values > 0) - 0.5) < 0.06
    place = np.log(np.abs(values) / 0.3) / math.log(1.5 / 0.3)
    assert place.min() > 0 and place.max() < 1
    assert np.mean(place) == pytest.approx(0.5, abs=0.04)
    assert np.var(place) == pytest.approx(1 / 12, rel=0.12)


def test_each_side_has_its_own_limit(camera: Nominal) -> None:
    """A side without detectable departures is not drawn and does not limit the other side."""
    others = [row.name for row in ROWS.values() if row.name != "vertical_offset"]

    def drawn(above: float, below: float) -> np.ndarray:
        departures = {("vertical_offset", 1): above, ("vertical_offset", -1): below}
        limit = DetectionLimits(departures=departures, choices={})
        cases = draw(camera, {"single": 300}, limits=limit, leave_out=others, entropy=1)
        return np.array([drawn_case.settings["vertical_offset"] for drawn_case in cases])

    values = drawn(1.0, 0.2)
    assert 1.0 <= values[values > 0].min() < 1.02 and -0.22 < values[values < 0].max() <= -0.2
    assert drawn(0.2, math.inf).min() > 0


def test_undetectable_choices_are_not_drawn(camera: Nominal) -> None:
    limits = DetectionLimits(departures={}, choices={"median": (), "hole_filling": (1, 3)})
    post = [row for row in ROWS.values() if row.name in {"median", "hole_filling"}]
    others = [row.name for row in ROWS.values() if row not in post]
    drawn = draw(
        camera, {"single": 40}, limits=limits, kinds=("post",), leave_out=others, entropy=1
    )
    assert {tuple(drawn_case.settings.items()) for drawn_case in drawn} == {
        (("hole_filling", 1.0),),
        (("hole_filling", 3.0),),
    }


def test_other_kinds_of_effects_can_be_drawn(camera: Nominal) -> None:
    drawn = draw(camera, {"single": 60}, kinds=("post", "image"), entropy=1)
    assert {ROWS[name].kind for drawn_case in drawn for name in drawn_case.settings} == {
        "post",
        "image",
    }
    for drawn_case in drawn:
        Strengths(nominal=camera, values=drawn_case.settings)


def test_effects_that_cannot_be_removed_are_drawn_upwards(camera: Nominal) -> None:
    others = [row.name for row in ROWS.values() if row.name != "read_noise"]
    rule = {"leave_out": others, "entropy": 3}
    free = draw(camera, {"single": 40}, **rule)
    bound = draw(camera, {"single": 40}, upwards=["read_noise"], **rule)
    assert min(drawn_case.settings["read_noise"] for drawn_case in free) < camera.read_noise_e
    assert min(drawn_case.settings["read_noise"] for drawn_case in bound) > camera.read_noise_e


def test_draws_are_random_without_a_seed(camera: Nominal) -> None:
    assert draw(camera, {"null": 3}) != draw(camera, {"null": 3})
    assert draw(camera, COUNTS, entropy=3) == draw(camera, COUNTS, entropy=3)


def test_effects_that_the_camera_cannot_show_are_not_drawn(camera: Nominal) -> None:
    dark = dataclasses.replace(camera, ambient_w_m2=0.0)
    drawn = draw(dark, {"single": 200}, entropy=2)
    assert not any("ambient_gradient" in drawn_case.settings for drawn_case in drawn)
    assert all(drawn_case.settings.get("ambient", 1.0) > 0 for drawn_case in drawn)


def test_json_round_trip(camera: Nominal) -> None:
    drawn = draw(camera, COUNTS, families=FAMILIES, entropy=7)
    assert case.loads(case.dumps(drawn)) == drawn


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"lens_blurr": 1.0}, "effect must be one of the table; got lens_blurr"),
        ({"lens_blur": math.nan}, "lens_blur must be finite; got nan"),
        ({"lens_blur": -1.0}, "lens_blur must not be below its range; got -1.0"),
        ({"exposure": 0.0}, "exposure must not be below its range; got 0.0"),
        ({"veil": 1.5}, "veil must be at most 1; got 1.5"),
        ({"median": 4}, "median must be one of"),
        ({"range": math.inf}, "range must be finite; got inf"),
    ],
)
def test_invalid_strengths_are_refused(
    values: dict[str, float], words: str, camera: Nominal
) -> None:
    with pytest.raises(WithheldError, match=words):
        Strengths(nominal=camera, values=values)


CASE = '[{"number": %s, "kind": %s, "settings": %s, "seed": 2}]'


def test_invalid_cases_are_refused(camera: Nominal) -> None:
    with pytest.raises(WithheldError, match="must have effects to draw from"):
        draw(camera, {"single": 1}, kinds=())
    with pytest.raises(WithheldError, match="effect must be one of the table"):
        case.loads('[{"number": 1, "kind": "null", "settings": {"x": 1}, "seed": 2}]')


@pytest.mark.parametrize("number", TIERS)
def test_counts_scale_in_proportion_and_round_up(number: int):
    tier = TIERS[number]
    default = tier.counts.get("single") or tier.counts["unknown"]
    for singles in range(1, 400):
        counts, left_out = tier.scaled_counts(singles)
        for count, default_count in (
            (left_out, tier.left_out),
            *zip(counts.values(), tier.counts.values(), strict=True),
        ):
            assert 0 <= count - Fraction(singles * default_count, default) < 1


def test_a_count_of_zero_is_refused():
    with pytest.raises(WithheldError, match="must be >= 1"):
        TIERS[1].scaled_counts(0)


def test_sets_share_no_scene():
    for tier in TIERS.values():
        names = [name for number in range(tier.sets) for name in tier.scene_names(number)]
        assert len(set(names)) == tier.sets * tier.scenes
    kinds = ("clutter", "clutter", "clutter", "tabletop")
    first = TIERS[2].first_scene + TIERS[2].scenes
    expected = [f"{kind}:{first + number}" for number, kind in enumerate(kinds)]
    assert TIERS[2].scene_names(1)[:4] == expected


def test_own_depth_cases_are_counted():
    counts = [sum(TIERS[tier].has_own_depth(case) for case in range(99)) for tier in TIERS]
    assert counts == [0, 12, 0, 0, 0]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[", "cases must be a readable JSON file"),
        ("[" * 9999, "cases must be a readable JSON file"),
        ("{}", "cases must be a list; got dict"),
        ("[3]", "case must have the keys"),
        ('[{"number": 1}]', "case must have the keys"),
        (CASE % ("1.5", '"null"', "{}"), "must have a whole number"),
        (CASE % ("1", "[]", "{}"), "kind must be one of"),
        (CASE % ("1", '"null"', "[]"), "settings must be numbers"),
        (CASE % ("1", '"null"', '{"flicker": "x"}'), "settings must be numbers"),
        (CASE % ("1" * 30, '"null"', "{}"), "a whole number of 30 digits"),
    ],
)
def test_damaged_cases_are_refused(text: str, message: str) -> None:
    with pytest.raises(WithheldError, match=message):
        case.loads(text)


def test_effects_of_a_camera_are_texts(tmp_path: Path) -> None:
    (tmp_path / "nominal.json").write_text('{"has": [3]}')
    with pytest.raises(WithheldError, match=r"has must be a list of texts; got \[3\]"):
        nominal.read_existing_effects(tmp_path / "nominal.json")


def test_cases_without_pairs_name_the_effects_that_are_not_left_out(camera: Nominal) -> None:
    """As `withheld --effects` draws them."""
    counts: dict[case.CaseKind, int] = {"single": 6, "null": 2}
    drawn = draw(camera, counts, leave_out=ROWS.keys() - {"dsnu", "gain"}, entropy=3)
    names = {name for each in drawn for name in each.settings}
    assert names == {"dsnu", "gain"}
    assert collections.Counter(each.kind for each in drawn) == counts
