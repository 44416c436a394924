"""Cases: the table, the lot, and the seal."""

from __future__ import annotations

import collections
import dataclasses
import math
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from starling.diagnosis.validation.camera.catalogue import ROWS, Strengths
from starling.diagnosis.validation.camera.errors import WithheldError
from starling.diagnosis.validation.camera.nominal import Nominal
from starling.diagnosis.validation.protocol import case, seal
from starling.diagnosis.validation.protocol.case import Case, draw
from starling.diagnosis.validation.protocol.limits import Limits
from starling.diagnosis.which.candidates import LEFT_OUT
from starling.sim import effects

DOCS = Path(__file__).parents[4] / "docs"
PAGES = DOCS / "effects"
FAMILIES = {row.name: row.family for row in effects.table()}
COUNTS: dict[case.CaseKind, int] = {"null": 4, "single": 90, "pair": 12, "unknown": 9}


def test_rows_are_called_as_their_pages() -> None:
    pages = {path.stem for path in PAGES.glob("*.md")}
    for row in ROWS.values():
        assert (row.name in pages) == (row.kind != "outside"), row.name
    assert len([row for row in ROWS.values() if row.kind == "outside"]) >= 8


def test_what_is_not_withheld_is_told() -> None:
    """The decision's list and its counts."""
    tried = {row.name for row in effects.table()} - LEFT_OUT
    missing = tried - ROWS.keys()
    note = (DOCS / "decisions" / "0021-check-on-withheld-effects.md").read_text(encoding="utf-8")
    listed = note.split("## Not in it")[1].split("`dot_defocus`")[0]
    assert {*re.findall(r"`(\w+)`", listed)} == missing
    counts = [len(tried), len(tried - missing), len(missing)]
    told = r"Of the (\d+) rows .* tries (\d+) can be withheld; .* Of the other (\d+) "
    assert re.findall(told, listed) == [tuple(map(str, counts))]


def test_units_are_those_of_the_pages() -> None:
    for row in ROWS.values():
        if row.kind == "outside":
            continue
        page = (PAGES / f"{row.name}.md").read_text(encoding="utf-8")
        first = page.split("| --- | --- | --- | --- | --- |\n")[1].splitlines()[0]
        assert first.split("|")[5].strip() == row.unit, row.name


def test_images_are_drawn_from_the_pages_ranges(camera: Nominal) -> None:
    """Between the page's ends, or from its neutral on: beyond them nobody looks."""
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
def test_departures_go_there_and_back(name: str, share: float, camera: Nominal) -> None:
    row = ROWS[name]
    assert row.low < row.high
    for sign in row.signs:
        departure = share * row.reach(camera, sign)
        value = row.value(camera, departure, sign)
        assert row.departure(camera, value) == pytest.approx(departure, rel=1e-6, abs=1e-9)
        assert row.least - 1e-9 <= value <= row.most + 1e-9


def test_the_lot(camera: Nominal) -> None:
    drawn = draw(camera, COUNTS, families=FAMILIES, entropy=7)
    assert [each.number for each in drawn] == list(range(115))
    kinds = [each.kind for each in drawn]
    assert {kind: kinds.count(kind) for kind in COUNTS} == COUNTS
    assert kinds[:4] != ["null"] * 4
    assert len({each.seed for each in drawn}) == len(drawn)
    singles = collections.Counter(next(iter(c.settings)) for c in drawn if c.kind == "single")
    assert max(singles.values()) - min(singles.values()) <= 1
    for each in drawn:
        Strengths(nominal=camera, values=each.settings)
        rows = [ROWS[name] for name in each.settings]
        assert len(rows) == {"null": 0, "single": 1, "pair": 2, "unknown": 1}[each.kind]
        assert len({FAMILIES.get(row.name, row.name) for row in rows}) == len(rows)
        for row in rows:
            assert (row.kind == "outside") == (each.kind == "unknown")
            departure = row.departure(camera, each.settings[row.name])
            assert departure > 0
            assert row.scale == "choice" or departure >= row.low * (1 - 1e-9)


def test_strengths_are_log_uniform_from_the_limit(camera: Nominal) -> None:
    limit = Limits(
        departures={("vertical_offset", 1): 0.3, ("vertical_offset", -1): 0.3}, choices={}
    )
    others = [row.name for row in ROWS.values() if row.name != "vertical_offset"]
    drawn = draw(camera, {"single": 800}, limits=limit, leave_out=others, entropy=1)
    values = np.array([each.settings["vertical_offset"] for each in drawn])
    assert abs(np.mean(values > 0) - 0.5) < 0.06
    place = np.log(np.abs(values) / 0.3) / math.log(1.5 / 0.3)
    assert place.min() > 0 and place.max() < 1
    assert np.mean(place) == pytest.approx(0.5, abs=0.04)
    assert np.var(place) == pytest.approx(1 / 12, rel=0.12)


def test_each_side_is_drawn_from_its_own_limit(camera: Nominal) -> None:
    """What is never found to one side is not drawn there, nor limits the other."""
    others = [row.name for row in ROWS.values() if row.name != "vertical_offset"]

    def drawn(above: float, below: float) -> np.ndarray:
        found = {("vertical_offset", 1): above, ("vertical_offset", -1): below}
        limit = Limits(departures=found, choices={})
        lot = draw(camera, {"single": 300}, limits=limit, leave_out=others, entropy=1)
        return np.array([each.settings["vertical_offset"] for each in lot])

    values = drawn(1.0, 0.2)
    assert 1.0 <= values[values > 0].min() < 1.02 and -0.22 < values[values < 0].max() <= -0.2
    assert drawn(0.2, math.inf).min() > 0


def test_choices_that_are_not_found_are_not_drawn(camera: Nominal) -> None:
    found = Limits(departures={}, choices={"median": (), "hole_filling": (1, 3)})
    post = [row for row in ROWS.values() if row.name in {"median", "hole_filling"}]
    others = [row.name for row in ROWS.values() if row not in post]
    drawn = draw(camera, {"single": 40}, limits=found, kinds=("post",), leave_out=others, entropy=1)
    assert {tuple(each.settings.items()) for each in drawn} == {
        (("hole_filling", 1.0),),
        (("hole_filling", 3.0),),
    }


def test_other_kinds_of_effects_can_be_drawn(camera: Nominal) -> None:
    drawn = draw(camera, {"single": 60}, kinds=("post", "image"), entropy=1)
    assert {ROWS[name].kind for each in drawn for name in each.settings} == {"post", "image"}
    for each in drawn:
        Strengths(nominal=camera, values=each.settings)


def test_what_cannot_be_undone_is_drawn_upwards(camera: Nominal) -> None:
    others = [row.name for row in ROWS.values() if row.name != "read_noise"]
    rule = {"leave_out": others, "entropy": 3}
    free = draw(camera, {"single": 40}, **rule)
    bound = draw(camera, {"single": 40}, upwards=["read_noise"], **rule)
    assert min(each.settings["read_noise"] for each in free) < camera.read_noise_e
    assert min(each.settings["read_noise"] for each in bound) > camera.read_noise_e


def test_the_system_draws_unless_told(camera: Nominal) -> None:
    assert draw(camera, {"null": 3}) != draw(camera, {"null": 3})
    assert draw(camera, COUNTS, entropy=3) == draw(camera, COUNTS, entropy=3)


def test_what_the_camera_cannot_show_is_not_drawn(camera: Nominal) -> None:
    dark = dataclasses.replace(camera, ambient_w_m2=0.0)
    drawn = draw(dark, {"single": 200}, entropy=2)
    assert not any("ambient_gradient" in each.settings for each in drawn)
    assert all(each.settings.get("ambient", 1.0) > 0 for each in drawn)


def test_json_there_and_back(camera: Nominal) -> None:
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
def test_refused_strengths(values: dict[str, float], words: str, camera: Nominal) -> None:
    with pytest.raises(WithheldError, match=words):
        Strengths(nominal=camera, values=values)


def test_refused_cases(camera: Nominal) -> None:
    with pytest.raises(WithheldError, match="kind must be one of"):
        Case(number=0, kind="triple", seed=1)  # type: ignore[arg-type]
    with pytest.raises(WithheldError, match="number and seed must be >= 0"):
        Case(number=-1, kind="null", seed=1)
    with pytest.raises(WithheldError, match="count of pair must be >= 0"):
        draw(camera, {"pair": -1})
    with pytest.raises(WithheldError, match="must have effects to draw from"):
        draw(camera, {"single": 1}, kinds=())
    for text in ("{", '[{"number": 1}]', "[3]"):
        with pytest.raises(WithheldError, match="cases must be a JSON list"):
            case.loads(text)
    with pytest.raises(WithheldError, match="effect must be one of the table"):
        case.loads('[{"number": 1, "kind": "null", "settings": {"x": 1}, "seed": 2}]')


TOLD = {"families.json": b"{}", "asked.json": b"[1]"}


def test_a_seal_holds(tmp_path: Path, camera: Nominal) -> None:
    hidden, public = tmp_path / "hidden", tmp_path / "public"
    drawn = draw(camera, COUNTS, families=FAMILIES, entropy=7)
    digest = seal.seal(drawn, TOLD, hidden, public)
    first, *others = (public / "truth.sha256").read_text().splitlines()
    assert first == f"{digest}  truth.json"
    assert [line.split("  ")[1] for line in others] == [*TOLD, "code"]
    assert {path.name for path in public.iterdir()} == {"truth.sha256", *TOLD}
    assert seal.verify(TOLD, hidden, public) == drawn
    assert seal.is_of_this_code(public)


def test_what_was_begun_and_not_sealed_is_drawn_anew(tmp_path: Path, camera: Nominal) -> None:
    hidden, public = tmp_path / "hidden", tmp_path / "public"
    seal.seal(draw(camera, {"null": 2}), TOLD, hidden, public)
    (public / "truth.sha256").unlink()
    cases = draw(camera, {"null": 3})
    seal.seal(cases, TOLD, hidden, public)
    assert seal.verify(TOLD, hidden, public) == cases


def test_another_code_is_another(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, content in (("sim/a.py", "1"), ("sim/b.toml", "2"), ("diagnosis/a.json", "3")):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(content)
    monkeypatch.setattr(seal, "_ROOT", tmp_path)
    seal.seal((), TOLD, tmp_path / "hidden", tmp_path / "public")
    (tmp_path / "sim" / "weights.bin").touch()
    assert seal.is_of_this_code(tmp_path / "public")
    seal.worked(tmp_path / "public")
    assert seal.is_of_this_code(tmp_path / "public")
    (tmp_path / "sim" / "b.toml").write_text("3")
    assert not seal.is_of_this_code(tmp_path / "public")
    seal.worked(tmp_path / "public")  # Verdicts of it may lie there, whatever comes back.
    (tmp_path / "sim" / "b.toml").write_text("2")
    assert not seal.is_of_this_code(tmp_path / "public")


def test_what_was_made_of_something_else_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seal.made(tmp_path / "set-0", {"scenes": ["b"]}, there=False)
    seal.made(tmp_path / "set-0", {"scenes": ["a"]}, there=False)  # The first came to nothing.
    seal.made(tmp_path / "set-0", {"scenes": ["a"]}, there=True)
    with pytest.raises(WithheldError, match=r'folder must be made of what .*made\.json.*"b"'):
        seal.made(tmp_path / "set-0", {"scenes": ["b"]}, there=True)
    monkeypatch.setattr(seal, "code", lambda: "another")
    with pytest.raises(WithheldError, match="folder must be made of what"):
        seal.made(tmp_path / "set-0", {"scenes": ["a"]}, there=True)
    with pytest.raises(WithheldError, match="folder must be made of what"):
        seal.made(tmp_path / "set-1", {"scenes": ["a"]}, there=True)


def test_broken_seals(tmp_path: Path, camera: Nominal) -> None:
    hidden, public = tmp_path / "hidden", tmp_path / "public"
    with pytest.raises(WithheldError, match="seal must have fingerprints"):
        seal.verify(TOLD, hidden, public)
    with pytest.raises(WithheldError, match="must be two folders"):
        seal.seal((), TOLD, hidden, hidden)
    seal.seal(draw(camera, {"null": 2}), TOLD, hidden, public)
    with pytest.raises(WithheldError, match="seal must not be broken"):
        seal.seal((), TOLD, tmp_path / "other", public)
    for name, rule in (("families.json", "families"), ("asked.json", "asked")):
        with pytest.raises(WithheldError, match=rf"{rule}.json must be what .* has; got \[2\]"):
            seal.verify({**TOLD, name: b"[2]"}, hidden, public)
    with pytest.raises(WithheldError, match=r"got 1{300} \.\.\."):
        seal.verify({"asked.json": b"1" * 301}, hidden, public)
    truth = hidden / "truth.json"
    truth.write_text(truth.read_text().replace("null", "pair", 1))
    with pytest.raises(WithheldError, match="truth must be the one sealed"):
        seal.verify(TOLD, hidden, public)
    truth.unlink()
    with pytest.raises(WithheldError, match="seal must have a truth"):
        seal.verify(TOLD, hidden, public)
    (public / "truth.sha256").write_text("none")
    with pytest.raises(WithheldError, match="seal must have fingerprints"):
        seal.verify(TOLD, hidden, public)


def test_families_are_read_from_what_was_sealed() -> None:
    told = b'{"a": {"family": "x", "twins": []}, "b": {"family": "y", "twins": ["a"]}}'
    assert seal.families(told) == {"a": "x", "b": "y"}
    for damaged in (b"", b"[1]", b'{"a": 1}', b'{"a": {}}'):
        with pytest.raises(WithheldError, match="families must be a table of effects"):
            seal.families(damaged)
