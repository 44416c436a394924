"""The answer in three sentences, and the notes: their words and their length."""

from __future__ import annotations

import dataclasses
import json
from typing import Any, get_args

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from starling.diagnosis.diagnosis import Diagnosis
from starling.diagnosis.howfar.evidence import SurrogateReason
from starling.diagnosis.howfar.reduction import GapReduction
from starling.diagnosis.howfar.remainder import Remainder
from starling.diagnosis.report import figures, notes, sentences
from starling.diagnosis.report.page import page
from starling.diagnosis.where.remainder import RemainderPlace
from starling.diagnosis.which.candidates import Segment
from starling.diagnosis.which.segment import SegmentResult
from starling.sim import effects
from starling.sim.console import record
from tests.unit.diagnosis.made_diagnosis import (
    FULL,
    HOWFAR,
    NAMED,
    NAMES,
    NOTHING,
    diagnosis,
    evidence,
    segment_result,
    surrogate,
)
from tests.unit.diagnosis.read_page import Reader

MOST_WORDS = 25
PARAMETERS = [
    row.name if not number else f"{row.name}.{parameter.name}"
    for row in effects.table()
    for number, parameter in enumerate(row.parameters)
]
GROUPS = [
    f"{side}{kind} by expected"
    for kind in sentences.GROUPS
    for side in ("", *(["right "] if kind not in ("against", "unlike") else []))
]
(EFFECT,) = NAMED.accepted


def accepted(name: str, gain: float, rivals: list[str]) -> Any:
    """Return an accepted effect of another name, gain and rivals."""

    def renamed(name: str) -> Any:
        candidate = dataclasses.replace(EFFECT.fit.signature.candidate, name=name)
        signature = dataclasses.replace(EFFECT.fit.signature, candidate=candidate)
        return dataclasses.replace(EFFECT.fit, signature=signature, gain=np.array([gain]))

    fits = tuple(renamed(rival) for rival in rivals)
    ends = tuple((0.001234, 0.002345) for _ in rivals)
    return dataclasses.replace(
        EFFECT, fit=renamed(name), interval=(-0.001234, 0.1234), rivals=fits, rival_intervals=ends
    )


def reduction(closed_pct: float | None, *, ends: bool = True) -> GapReduction:
    interval = (-123.0, 456.0) if ends and closed_pct is not None else None
    return GapReduction(before=1.0, after=0.5, floor=0.0, closed_pct=closed_pct, interval=interval)


@st.composite
def segments(draw: st.DrawFn, segment: Segment) -> SegmentResult:
    names = draw(st.lists(st.sampled_from(PARAMETERS), max_size=4, unique=True))
    effects_of_segment = [
        accepted(name, draw(st.floats(12, 9999)), draw(st.lists(st.sampled_from(PARAMETERS))))
        for name in names
    ]
    alone = [accepted(name, draw(st.floats(0, 12)), []).fit for name in PARAMETERS[:4]]
    search = dataclasses.replace(
        NOTHING,
        accepted=tuple(effects_of_segment),
        alone=tuple(alone),
        unexplained=np.full_like(NOTHING.unexplained, draw(st.sampled_from([0.1, 3.0]))),
    )
    leads = [tuple(draw(st.lists(st.sampled_from(GROUPS), max_size=5))) for _ in range(2)]
    return segment_result(search, segment=segment, leads=(leads[0], leads[1]))


@st.composite
def diagnoses(draw: st.DrawFn) -> Diagnosis:
    whole = draw(st.booleans())
    kinds = [Segment.WHOLE] if whole else [Segment.IMAGE, Segment.DEPTH]
    results = tuple(draw(segments(kind)) for kind in kinds)
    names = [effect.fit.name for each in results for effect in each.search.accepted]
    reasons = st.lists(st.sampled_from(get_args(SurrogateReason)), unique=True)
    weighed = {name: evidence(*draw(reasons)) for name in names}
    reported = {name: 0.3 for name in names if not weighed[name].reasons}
    share = st.none() | st.floats(0, 1)
    left = {
        kind.value: Remainder(share=draw(share), interval=draw(st.none() | st.just((0.123, 1.0))))
        for kind in kinds
    }
    place = RemainderPlace(frame="both", zone="bottom centre", scale="image")
    figures = {
        name: reduction(draw(st.none() | st.floats(-50, 150)), ends=draw(st.booleans()))
        for name in [*sentences.FIGURES, "features of the image", "features of the depth"]
    }
    howfar = dataclasses.replace(
        HOWFAR, figures=figures if reported else {}, alone=dict.fromkeys(names, figures)
    )
    level = draw(st.floats(0.1, 10))
    return diagnosis(
        kind="effects" if reported else draw(st.sampled_from(["none of the known", "no gap"])),
        segments=results,
        evidence=weighed,
        settings=reported,
        remainders=left,
        places=dict.fromkeys(left, place),
        absorbed=tuple(names),
        against=draw(st.none() | st.just("other captures")),
        held_out=NAMES[: draw(st.integers(1, 6))],
        howfar=draw(st.sampled_from([howfar, None])),
        where=dataclasses.replace(FULL.where, levels={"hall": level, "attic": 1.1 * level}),
    )


def word_count(sentence: str) -> int:
    return len(sentence.split())


@settings(max_examples=60, deadline=None)
@given(each=diagnoses())
def test_sentences_have_at_most_25_words(each: Diagnosis):
    answer = sentences.answer(each)
    assert len(answer) == 3
    for sentence in (*answer, sentences.next_step(each), *notes.notes(each)):
        assert word_count(sentence) <= MOST_WORDS, sentence
        assert sentence[-1] in ".!?" and "  " not in sentence and "nan" not in sentence.split()


def test_answers_with_the_longest_units_have_at_most_25_words():
    """Three effects on the images, each with its interval, and none on the device's depth."""
    left = {name: Remainder(share=1.0, interval=None) for name in ("image", "depth")}
    for name in PARAMETERS:
        names = [name, *(each for each in ("gamma", "lens_blur", "veil") if each != name)][:3]
        search = dataclasses.replace(
            NOTHING, accepted=tuple(accepted(each, 99.0, []) for each in names)
        )
        each = diagnosis(
            segments=(segment_result(search), segment_result(NOTHING, segment=Segment.DEPTH)),
            evidence={name: evidence() for name in names},
            settings=dict.fromkeys(names, 0.3),
            remainders=left,
        )
        sentence = sentences.answer(each)[1]
        assert sentence.endswith(", 100 % unexplained; matcher and filters: no known effect.")
        assert word_count(sentence) <= MOST_WORDS, sentence


@given(count=st.integers(0, 40))
def test_long_lists_are_cut(count: int):
    names = [f"name{number}" for number in range(count)]
    text = sentences.shortened(names)
    shown = text.partition(" and ")[0].split(", ") if names else []
    assert shown == names[: min(count, 3)]
    assert text.endswith(f" and {count - 3} more") == (count > 3)


def test_long_names_are_cut_earlier():
    long = "a name that has exactly eight words here"
    assert sentences.shortened([long, long, long]) == f"{long} and 2 more"
    assert sentences.shortened([long]) == long


def test_many_rivals_are_cut_in_the_notes():
    rivals = PARAMETERS[:8]
    search = dataclasses.replace(NAMED, accepted=(accepted("lens_blur", 40.0, rivals),))
    text = notes.notes(diagnosis(segments=(segment_result(search),)))
    first = ", ".join(rivals[:3])
    assert f"These captures cannot separate lens_blur from {first} and 5 more." in text


def test_a_sentence_counts_the_effects_that_it_has_no_room_for():
    names = ("gamma", "veil", "yaw", "shot_noise", "roll", "dsnu", "prnu")
    effects = (*(accepted(name, 20.0, []) for name in names), accepted("pitch", 108.0, []))
    each = diagnosis(
        segments=(segment_result(dataclasses.replace(NAMED, accepted=effects)),),
        evidence={effect.fit.name: evidence() for effect in effects},
        settings={effect.fit.name: 1.0 for effect in effects},
    )
    which = sentences.answer(each)[1]
    assert "pitch" in which and ", gamma " in which and which.endswith(" more.")
    assert 20 < len(which.split()) <= 25


def test_the_answer_names_the_largest_effect_and_the_largest_closed_figure():
    weaker, stronger = accepted("gamma", 20.0, []), accepted("pitch", 108.0, [])
    search = dataclasses.replace(NAMED, accepted=(weaker, stronger))
    figures = {
        "ndp_brier": reduction(30.0, ends=False),
        "log_nmad": reduction(81.0, ends=False),
        "bias_px": reduction(None),
        "dot_contrast": reduction(-5.0),
    }
    each = diagnosis(
        segments=(segment_result(search),),
        evidence={"gamma": evidence(), "pitch": evidence()},
        settings={"gamma": 1.0, "pitch": 1.0},
        howfar=dataclasses.replace(HOWFAR, figures=figures),
    )
    _, which, howfar = sentences.answer(each)
    assert "consistent with pitch " in which
    assert which.endswith(f", gamma {sentences.with_unit('gamma', stronger.fit.value)}.")
    assert howfar.endswith("the reported effects close 81 % of the gap in disparity noise.")
    titles = [item[0].split()[0] for item in notes.note_lists(each)["Effects"]]
    assert titles == ["pitch", "gamma"]


@pytest.mark.parametrize(
    "figures, text",
    [
        ({"log_nmad": reduction(99.4, ends=False)}, "close 99 % of the gap in disparity noise."),
        ({"log_nmad": reduction(99.6)}, "close the whole gap in disparity noise."),
        (
            {"features of the image": reduction(74.0, ends=False), "log_nmad": reduction(100.0)},
            "close 74 % of the gap in image features and the whole gap in disparity noise.",
        ),
        ({"log_nmad": reduction(0.0)}, "close no part of any measured gap."),
        ({"log_nmad": reduction(None)}, "No gap that could be reduced was measured on"),
    ],
)
def test_how_far_in_words(figures: dict[str, GapReduction], text: str):
    each = diagnosis(howfar=dataclasses.replace(HOWFAR, figures=figures))
    assert text in sentences.answer(each)[2]


@pytest.mark.parametrize(
    "options, why",
    [
        ({"compatible": False}, "the effects exclude each other in one sensor."),
        ({"held_out": ()}, "no scene is held out."),
        ({}, "the effects cannot be simulated together."),
    ],
)
def test_a_missing_measurement_has_its_reason(options: dict[str, Any], why: str):
    each = diagnosis(howfar=None, **options)
    assert sentences.answer(each)[2] == f"How far the gap closes was not measured: {why}"


def test_surrogates_alone_claim_no_improvement():
    each = diagnosis(howfar=None, settings={}, evidence={"lens_blur": evidence("misfit")})
    assert sentences.answer(each)[2] == "No effect is reported, so no improvement is claimed."


@pytest.mark.parametrize(
    "figures, words",
    [
        (
            {"bias_px": (90.0, None), "features of the image": (60.0, None)},
            "60 % of the gap in image",
        ),
        ({"bias_px": (90.0, (1.0, 99.0)), "features of the image": (60.0, None)}, "90 % (95 %"),
        ({"bias_px": (90.0, (-1.0, 99.0)), "features of the image": (60.0, None)}, "60 % of the"),
        ({"bias_px": (90.0, None), "log_nmad": (95.0, None)}, "95 % of the gap in disparity noise"),
    ],
)
def test_significant_figures_come_first(figures: dict[str, Any], words: str):
    reductions = {
        name: GapReduction(before=2.0, after=1.0, floor=0.0, closed_pct=percent, interval=ends)
        for name, (percent, ends) in figures.items()
    }
    assert (sentences.largest_closed(reductions) or "").startswith(words)


def test_weak_candidates_are_listed_with_the_needed_gain():
    alone = (accepted("veil", 5.0, []).fit, accepted("lens_blur", 3.0, []).fit)
    rows = np.full_like(NOTHING.unexplained, 3.0)
    search = dataclasses.replace(NOTHING, alone=alone, unexplained=rows)
    each = surrogate(segments=(segment_result(search),), evidence={})
    assert sentences.answer(each)[1] == (
        "There is a gap, but each known effect is too weak to name; veil comes first, with a gain "
        "of 5 of 12."
    )
    value = sentences.number(EFFECT.fit.value)
    assert notes.note_lists(each)["Too weak to name"] == [
        [f"In the infrared images, veil {value} has a gain of 5; 12 is needed."],
        [f"In the infrared images, lens_blur {value} px has a gain of 3; 12 is needed."],
    ]
    alone = (accepted("veil", 13.0, []).fit,)
    (simulated,) = [segment_result(dataclasses.replace(search, alone=alone))]
    assert notes.note_lists(surrogate(segments=(simulated,), evidence={}))["Too weak to name"] == [
        [f"In the infrared images, veil {value} loses its gain once it is simulated."]
    ]
    nothing = surrogate(segments=(segment_result(NOTHING),), evidence={})
    assert sentences.answer(nothing)[1] == "There is a gap, but no known effect reduces it."


@pytest.mark.parametrize(
    "ratio, word", [(1.8, "brighter"), (0.5, "darker"), (1.26, "brighter"), (1.24, None)]
)
def test_a_wrong_exposure_is_reported_before_any_effect(ratio: float, word: str | None):
    where = dataclasses.replace(FULL.where, levels={"hall": ratio, "attic": ratio})
    each = diagnosis(where=where)
    items = notes.note_lists(each).get("Check first", [[""]])
    text = [item[0] for item in items]
    expected = f"Your exposure may be off by a factor of {ratio:.2g}: real captures are {word} than"
    assert text[0].startswith(expected) == (word is not None)
    both = "A reported effect may describe the same difference; correct one of them."
    assert (both in items[0]) == (word is not None)
    assert Reader(page(each)).row("hall") == ["hall", f"{ratio:.3g}"]
    bare = diagnosis(where=dataclasses.replace(FULL.where, levels={}))
    assert "Brightness by room" not in page(bare)


def test_an_effect_is_reported_with_a_remainder():
    """A gap that stays in its own segment or in another one makes no surrogate."""
    left = {
        "image": Remainder(share=0.35, interval=(0.2, 0.5)),
        "depth": Remainder(share=1.0, interval=None),
    }
    nothing = segment_result(NOTHING, segment=Segment.DEPTH)
    place = RemainderPlace(frame="camera", zone="top left", scale="dots")
    each = diagnosis(
        segments=(segment_result(NAMED, leads=(("level",), ())), nothing),
        remainders=left,
        places={"image": place},
    )
    where, which, _ = sentences.answer(each)
    name = NAMED.accepted[0].fit.name
    assert where.startswith("The gap lies in images and in matcher and filters; ")
    assert which.startswith(f"Images are consistent with {name} ")
    assert which.endswith(", 35 % unexplained; matcher and filters: no known effect.")
    assert "Partly consistent with known effects" in page(each)
    assert notes.note_lists(each)["Unexplained remainder"] == [
        [
            "Unexplained in the infrared images: 35 % (95 %: 20 to 50) of the gap.",
            "Features that show it: brightness.",
            "It is fixed in the camera image.",
            "It is strongest at the top left of the image.",
            "It varies over up to 16 px, the size of dots.",
        ],
        [
            "No effect is reported in the device's matcher and filters, so all of its gap counts "
            "as unexplained."
        ],
    ]
    result = json.loads(record.dumps(figures.figures(each)))
    assert [effect["stand_in"] for effect in result["effects"]] == [False]
    assert result["unexplained_share"]["image"] == {"share": 0.35, "interval": [0.2, 0.5]}
    assert result["which"]["image"]["remainder"] == {
        "frame": "camera",
        "zone": "top left",
        "scale": "dots",
        "maps": [],
    }
    assert result["which"]["depth"]["remainder"] is None


@pytest.mark.parametrize(("size", "warns"), [(0.0, False), (3.0, True)])
def test_a_gap_beyond_the_explained_size_may_have_an_unknown_cause(size: float, warns: bool):
    search = dataclasses.replace(NAMED, unexplained=np.full_like(NAMED.unexplained, size))
    left = {"image": Remainder(share=0.35, interval=None)}
    each = diagnosis(segments=(segment_result(search),), remainders=left)
    (item,) = notes.note_lists(each)["Unexplained remainder"]
    assert ("An unknown cause may therefore imitate the reported effects." in item) is warns


def test_each_list_of_the_page_has_its_title():
    surrogates = surrogate("rival", remainders={"image": Remainder(share=1.0, interval=None)})
    text = Reader(page(dataclasses.replace(surrogates, limits=("One frame.",)))).text
    places = [text.index(f" {title} ") for title in ("Surrogates", "Unexplained remainder")]
    assert places == sorted(places) and text.index("Limits of these captures") > places[-1]
    assert " Too weak to name " not in text and "Example scene" in text[: places[0]]
