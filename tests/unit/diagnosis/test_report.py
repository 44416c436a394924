"""The page of a diagnosis, of small ones made up here: what it says, its numbers, its pictures.

What the figures themselves are worth is in their own tests.
"""

from __future__ import annotations

import base64
import dataclasses
import json
import re
from typing import Any

import cv2
import numpy as np
import pytest

from starling.diagnosis import command
from starling.diagnosis.report import figures, sentences
from starling.diagnosis.report.page import page
from starling.diagnosis.report.scene_images import shown
from starling.diagnosis.scenes.observation import Reading
from starling.diagnosis.where import maps, rules, swap
from starling.diagnosis.which.candidates import Arm
from starling.diagnosis.which.discrimination import Told
from starling.diagnosis.which.sensitivity import Noticed
from starling.sim.console import record
from tests.unit.diagnosis.made_diagnosis import (
    FULL,
    HOWFAR,
    MINUS,
    NAMED,
    NAMES,
    NAN,
    NOTHING,
    diagnosis,
    found,
    real,
)
from tests.unit.diagnosis.read_page import Reader
from tests.unit.diagnosis.test_features import GROUND
from tests.unit.diagnosis.test_where import pair_of


def test_the_page_stands_alone():
    text = page(FULL)
    read = Reader(text)
    assert not read.tags & {"script", "link", "iframe", "object"}
    assert not re.search(r"(?:src|href)=\"(?!data:image/png;base64,|#)", text)
    assert "http" not in text and len(text) < 4_000_000
    for one in read.pictures:
        data = base64.b64decode(one["src"].partition(",")[2], validate=True)
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
        assert image is not None and image.size
    told = [one["alt"] for one in read.pictures if one["alt"]]
    # Of three quantities two frames; of one scene three images, their middles, three errors.
    assert len(told) == len(set(told)) == 6 + 9


def test_the_answer_stands_on_top():
    text = Reader(page(FULL)).text
    head = text[: text.index("Which half of the chain")]
    for sentence in sentences.answer(FULL):
        assert re.sub(r"\s+", " ", sentence) in head
    assert "Consistent with known effects" in head
    assert "6 scenes, attic, <b>cellar</b> & yard, hall" in head


def test_what_captures_are_called_is_never_read_as_html():
    text = page(dataclasses.replace(FULL, limits=("One <i>frame</i> a scene & no more.",)))
    assert "<b>cellar</b>" not in text and "&lt;b&gt;cellar&lt;/b&gt; &amp; yard" in text
    assert "<i>frame" not in text and "One &lt;i&gt;frame" in text


def test_numbers_of_the_stage_swap_are_the_figures():
    read = Reader(page(FULL))
    rate = FULL.where.parts["ndp_rate"]
    assert rate.device is not None and rate.base is not None and rate.image is not None
    assert f"A simulated {100 * rate.base:.2f} %" in read.text
    assert f"C device {100 * rate.device:.2f} %" in read.text
    mean, low, high = (f"{100 * end:+.2f}" for end in rate.image)
    assert f"B less A: images {mean} [{low}, {high}] points" in read.text


def test_the_bins_of_the_smallest_chance_are_listed():
    read = Reader(page(FULL))
    rows = FULL.where.rows
    assert len(rows) > 15
    for number, row in enumerate(rows):
        listed = [one for one in read.rows if one[:2] == [row.covariate, row.bin]]
        assert len(listed) == (number < 15)
        if listed:
            assert listed[0][2] == f"{100 * row.gap:+.2f} points".replace("-", MINUS)
            assert listed[0][6] == f"{row.p:.3g}"


def test_where_depth_is_off_has_a_table_of_its_own():
    rows = FULL.where.rows
    one = dataclasses.replace(FULL, where=dataclasses.replace(FULL.where, rows=(), off=rows))
    head = ["By", "Bin", "Gap in errors"]
    read = Reader(page(one)).rows
    first = next(number for number, row in enumerate(read) if row[:3] == head) + 1
    own = [row[:2] for row in read[first : first + 9]]
    assert own[:8] == [[row.covariate, row.bin] for row in rows[:8]]
    assert own[8:] != [[rows[8].covariate, rows[8].bin]]
    assert len(figures.figures(one)["where"]["off"]) == len(rows)


def test_rules_are_sentences():
    rule = rules.Rule(text="level < 12 DN", gap=-0.051, area=0.034, net=-0.0017, share=0.41)
    unknown = dataclasses.replace(rule, text="x > 3 px", gap=0.02, share=NAN)
    text = Reader(
        page(
            dataclasses.replace(FULL, where=dataclasses.replace(FULL.where, rules=(rule, unknown)))
        )
    ).text
    assert (
        "Where level < 12 DN, real captures have 5.1 points fewer pixels without depth than "
        "simulated; this is 3.4 % of the pixels and 41 % of the whole gap." in text
    )
    assert "2.0 points more pixels without depth than simulated; this is 3.4 % of the pix" in text
    none = dataclasses.replace(FULL.where, rules=())
    assert "No rule" in page(dataclasses.replace(FULL, where=none))


def test_accepted_effects_stand_with_value_interval_and_set():
    (one,) = NAMED.accepted
    assert one.rivals
    read = Reader(page(FULL))
    row = read.row(one.fit.name)
    assert row[1] == sentences.number(one.fit.value)
    assert row[2] == "[{}, {}]".format(*map(sentences.number, one.interval))
    assert row[5] == f"{one.fit.total:.1f}"
    rival = one.rivals[0]
    ends = ", ".join(map(sentences.number, one.rival_intervals[0]))
    said = f"{one.fit.name} is not separable from {rival.name} {sentences.number(rival.value)} "
    assert f"{said}[{ends}]" in re.sub(" +", " ", read.text)
    alone = {"lens_blur", "dot_blur"}
    for each in NAMED.alone:
        shown = f"{each.name} {each.total:.1f} at {sentences.number(each.value)}" in read.text
        assert shown == (each.total > 0) and (shown or each.name not in alone)


def test_what_estimates_take_up_is_not_separable_from_them():
    (one,) = NAMED.accepted
    rivals = [rival.name for rival in one.rivals]
    taken = dataclasses.replace(FULL, taken_up=(one.fit.name,))
    said = f"{', '.join([*rivals, 'reflectance and light, which were estimated'])})"
    assert said in sentences.answer(taken)[1]
    alone = dataclasses.replace(one, rivals=(), rival_intervals=())
    bare = dataclasses.replace(NAMED, accepted=(alone,))
    text = Reader(page(dataclasses.replace(taken, arms=(found(bare),)))).text
    assert f"{one.fit.name} is not separable from reflectance and light" in text
    assert "is separable from the other effects" not in text
    assert [each["taken_up"] for each in figures.figures(taken)["effects"]] == [True]
    assert [each["taken_up"] for each in figures.figures(FULL)["effects"]] == [False]


def test_no_cause_is_claimed():
    unknown = diagnosis(kind="none of the known", arms=(found(NAMED, leads=(("level",), ())),))
    for one in (FULL, unknown):
        assert not re.search(r"caused? by|because of", Reader(page(one)).text)


def test_the_capture_that_would_tell_is_told():
    near = Told(capture="a lens cap on", rivals=("a", "b"), deviations=1.25)
    far = Told(capture="8 repeats", rivals=("x, c", "x, d"), deviations=12.0)
    of_both = diagnosis(tell_apart=(near, far))
    text = Reader(page(of_both)).text
    assert "c against d (beside x): take 8 repeats; they would stand 12.0 deviations apart" in text
    assert "a against b: no capture that was tried tells them apart for sure; the best, a lens" in (
        text
    )
    assert "The capture that would tell" not in page(FULL)
    assert [one["enough"] for one in figures.figures(of_both)["tell_apart"]] == [False, True]


def test_how_far_has_its_numbers():
    text = Reader(page(FULL)).text
    assert "before 0.25 after 0.125 floor 0.0625" in text
    assert "Closed by 67 %, 95 % interval [41, 83] %." in text
    assert f"Closed by {MINUS}200 %; fewer than three rooms give no interval." in text
    assert f"before {MINUS}2.5 after {MINUS}3.5 floor {MINUS}3" in text
    assert "Not identifiable" in text and "before \N{EN DASH} after" in text
    assert "lens_blur 81 %" in text
    assert "on 1 scene that had no say: holes (Brier score) 67 % (95 %: 41 to 83)." in text
    assert "on 2 scenes that" in page(diagnosis(locked=NAMES[:2]))


def test_what_is_closed_stands_side_by_side_with_intervals():
    """On an axis from -50, for -200, to 100, where the line is."""
    read = page(FULL).split("All figures")[1].split("</ul>")[0]
    assert "Holes: Brier score" in read and f"{MINUS}200 %" in read and "Bias" not in read
    assert read.count('"whisker"') == 1
    left, width = re.findall(r'"whisker" style="left:([\d.]+)%;width:([\d.]+)%"', read)[0]
    assert float(left) == pytest.approx(100 * 91 / 150, abs=0.01)
    assert float(width) == pytest.approx(100 * 42 / 150, abs=0.01)
    none = {name: HOWFAR.figures[name] for name in ("bias_px", "log_nmad")}
    told = dataclasses.replace(HOWFAR, figures=none)
    assert "All figures" not in page(dataclasses.replace(FULL, howfar=told))


def test_no_gap_is_a_verdict():
    one = diagnosis(kind="no gap", arms=(found(NOTHING),), howfar=None)
    text = Reader(page(one)).text
    assert "No gap found" in text and "No effect is accepted here." in text
    assert "None gains anything." in text
    assert "It had no say in what is named." in text
    assert "was not judged: no effect was accepted" in text
    assert "is not separable" not in text.split("How this was made")[0]
    assert "what is left here" not in text
    assert "would have been noticed" not in text


def test_without_a_gap_it_is_told_what_would_have_been_one():
    seen = (
        Noticed(name="vignetting", base=0.0, below=None, above=0.75),
        Noticed(name="gamma", base=1.0, below=0.9, above=1.25),
    )
    one = diagnosis(kind="no gap", arms=(found(NOTHING),), howfar=None, noticed=seen)
    read = Reader(page(one))
    assert "What would have been noticed" in read.text
    assert read.row("vignetting") == ["vignetting", "", "0", "0.75", ""]
    assert read.row("gamma")[1:4] == ["0.9", "1", "1.25"]
    told = json.loads(record.dumps(figures.figures(one)))["noticed"]
    assert told[0] == {"name": "vignetting", "base": 0.0, "below": None, "above": 0.75}


def test_none_of_the_known_is_a_verdict_and_leads():
    left = dataclasses.replace(NAMED, beyond=np.full_like(NAMED.beyond, 3.0))
    leading = found(left, arm=Arm.DEPTH, leads=(("pair by x", "level"), ()))
    text = Reader(page(diagnosis(kind="none of the known", arms=(leading,)))).text
    assert "Not explained by the known effects" in text
    assert "In the device's matcher and filters" in text
    assert (
        "None of the known effects explains what is left here. It shows in the right image against "
        "the left, by x, brightness." in text
    )
    assert "Stand-in" in text and "Consistent with" not in text.split("Which")[-1]
    assert "imitate something unknown" in text and "with stand-ins: holes" in text
    assert "what is left here" not in Reader(page(FULL)).text


def test_a_lead_tells_in_whose_frame_the_gap_stays():
    left = dataclasses.replace(NAMED, beyond=np.full_like(NAMED.beyond, 3.0))
    leading = found(left, arm=Arm.DEPTH, leads=(("level",), ()))
    agree = {maps.CAMERA: np.array([0.1, 0.1, 0.1]), maps.PROJECTOR: np.array([0.9, 0.9, 1.0])}
    drawn = tuple(
        dataclasses.replace(one, agreement=agree[one.frame] * (one.quantity == "error"))
        for one in FULL.where.maps
    )
    somewhere = dataclasses.replace(FULL.where, maps=drawn)
    one = diagnosis(kind="none of the known", arms=(leading,), where=somewhere)
    said = "brightness (before any effect its place stays in the projector's field)."
    assert said in sentences.answer(one)[1] and said in Reader(page(one)).text
    assert "Rooms do not agree about its place." in Reader(page(one)).text
    told = json.loads(record.dumps(figures.figures(one)))
    assert told["which"]["depth"]["frame"] == told["where"]["frames"]["error"] == "projector"
    assert told["where"]["frames"]["holes"] is None


def test_a_half_that_is_explained_has_no_stand_ins():
    left = dataclasses.replace(NAMED, beyond=np.full_like(NAMED.beyond, 3.0))
    leading = found(left, arm=Arm.DEPTH, leads=(("level",), ()))
    one = diagnosis(kind="none of the known", arms=(found(NAMED), leading))
    which = sentences.answer(one)[1]
    name = NAMED.accepted[0].fit.name
    assert f". The gap in the infrared images is consistent with {name} " in which
    assert f" Stand-ins in the device's matcher and filters: {name} " in which
    told = figures.figures(one)["effects"]
    assert [each["stand_in"] for each in told] == [False, True]
    (unnamed,) = sentences.answer(
        dataclasses.replace(one, arms=(found(NAMED), found(NOTHING, arm=Arm.DEPTH)))
    )[2:]
    assert "stand-ins" not in unnamed


def test_captures_that_cannot_tell_are_a_verdict():
    one = diagnosis(
        real()[:1],
        kind="cannot tell",
        arms=(),
        locked=(),
        howfar=None,
        limits=("One room alone: nothing can be held out, so no effect is named.",),
    )
    text = Reader(page(one)).text
    assert "These captures cannot tell" in text and "One room alone: nothing can" in text
    assert "say in what is named" not in text
    assert "No effect was tried" in text and "One room alone: a map" in text
    assert "was not judged: no scene is locked" in text
    assert "1 scene, attic." in text and "None is locked away" in text


def test_without_infrared_depth_alone_is_shown():
    read = Reader(page(diagnosis(real(infrared=False), arms=(found(NAMED, arm=Arm.WHOLE),))))
    assert "In depth" in read.text and "It had no say in what is named." in read.text
    assert "No infrared was captured of it." in read.text
    assert "B real images, our matcher not captured" in read.text
    assert "Infrared level" not in read.text and "B less A" not in read.text.split("Which pl")[1]
    assert not any(one["alt"].startswith("Real: ") for one in read.pictures)
    assert any(one["alt"].startswith("Real, own depth: ") for one in read.pictures)


def test_without_device_depth_our_matcher_stands_for_it():
    read = Reader(page(diagnosis(real(device=False))))
    assert "C device not captured" in read.text and "C less B: matcher" not in read.text
    assert any(one["alt"].startswith("Real, our matcher: ") for one in read.pictures)


def test_without_a_simulation_after_there_is_no_picture_of_it():
    bare = dataclasses.replace(FULL.shown, after=None)
    read = Reader(page(diagnosis(shown=bare)))
    assert "There is no picture after" in read.text
    assert not any("accepted effects" in one["alt"] for one in read.pictures)


def test_what_is_not_known_is_a_dash():
    unknown = np.full((maps.ROWS, maps.COLUMNS), NAN)
    blank = tuple(
        dataclasses.replace(one, mean=unknown, deviations=unknown) for one in FULL.where.maps
    )
    parts = {
        "bias_px": swap.Part(
            base=NAN, base_device=None, rematched=None, device=None, image=None, matcher=None
        ),
        "ndp_rate": FULL.where.parts["ndp_rate"],
    }
    row = dataclasses.replace(FULL.where.rows[0], share=NAN, low=NAN)
    one = dataclasses.replace(FULL.where, parts=parts, maps=blank, rows=(row,))
    read = Reader(page(dataclasses.replace(FULL, where=one)))
    assert "A simulated \N{EN DASH} px" in read.text
    assert (
        "Projector frame: too few pixels in every cell." in read.text
        and "nan" not in read.text.lower()
    )
    assert read.row(row.covariate, row.bin)[3:6:2] == ["\N{EN DASH}", "\N{EN DASH}"]


def test_report_json_holds_what_the_page_shows():
    told = json.loads(record.dumps(figures.figures(FULL)))
    assert told["verdict"] == "effects" and told["says"] == sentences.answer(FULL)
    assert told["howfar"]["log_nmad"]["before"] is None
    image = told["which"]["image"]
    assert image["by_group"]["level by x"]["after"] == pytest.approx(image["after"])
    (rival,) = NAMED.accepted[0].rivals
    assert told["effects"][0]["rival_gains"] == {rival.name: pytest.approx(rival.total)}
    low, high = told["effects"][0]["rival_intervals"][rival.name]
    assert low <= told["effects"][0]["rivals"][rival.name] <= high


def test_the_printed_text_ends_with_the_report_s_place():
    told = {"says": ["a.", "b."], "report": "out/report.html", "fixed": None, "not_in_sensor": []}
    said = ["a.", "b.", "Report: out/report.html"]
    assert command.as_text(told).splitlines() == said
    veil = {"name": "veil", "stand_in": False}
    told |= {"fixed": "out/sensor.toml", "effects": [veil]}
    written = "Sensor: out/sensor.toml"
    assert command.as_text(told).splitlines() == [*said, written]
    told["effects"] = [veil, {**veil, "stand_in": True}]
    assert command.as_text(told).endswith(f"{written}, with stand-ins in it")
    told["not_in_sensor"] = ["ambient", "motion"]
    assert "Of the scene, not of a sensor: ambient, motion" in command.as_text(told)


class FakeSubject:
    """Simulates brighter with effects."""

    name, real, ground, against = "attic", real()[0], GROUND, None

    def like_captured(self, settings: dict[str, float], *, seed: int) -> Reading:
        return pair_of(seed, 1.0 + len(settings), 0.02)


def test_the_scene_shown_is_simulated_before_and_after_with_common_noise():
    of: Any = FakeSubject()
    one = shown(of, {"a": 1.0})
    assert one.scene == "attic" and one.after is not None
    assert one.before.left is not None and one.after.left is not None
    assert one.after.left.mean() > 1.5 * one.before.left.mean()
    np.testing.assert_array_equal(one.before.ours_px, one.after.ours_px)
    assert shown(of, {}).after is None
