"""A diagnosis as one page that needs nothing beside it: `report.html`."""

from __future__ import annotations

from html import escape

from starling.diagnosis.diagnosis import Diagnosis
from starling.diagnosis.report import howfar_section, where_section, which_section
from starling.diagnosis.report import sentences as said
from starling.diagnosis.report.elements import prose
from starling.diagnosis.report.style import STYLE
from starling.diagnosis.report.words import words
from starling.diagnosis.which import null
from starling.diagnosis.which.attribution import LOCKED
from starling.diagnosis.which.candidates import Arm
from starling.diagnosis.which.likelihood import TAU
from starling.diagnosis.which.segment import BEYOND_NOISE, OF_BEFORE, UNEXPLAINED
from starling.sim.report.elements import counted, listed, number, sentences, table
from starling.sim.report.style import STYLE as COMMON

_VERDICTS = {
    "effects": "Consistent with known effects",
    "no gap": "No gap found",
    "none of the known": "Not explained by the known effects",
    "cannot tell": "These captures cannot tell",
}
_QUESTIONS = ("Where", "Which", "How far")


def page(of: Diagnosis) -> str:
    """Write a diagnosis as an HTML page: inline style, pictures inside, no scripts."""
    bodies = {
        "where": ("Where the gap lies", where_section.section(of)),
        "which": ("Which effects it is consistent with", which_section.section(of)),
        "howfar": ("How far it closes", howfar_section.section(of)),
        "made": ("How this was made", _made(of)),
    }
    links = "".join(f'<a href="#{key}">{title}</a>' for key, (title, _) in bodies.items())
    sections = "".join(
        f'<section id="{key}"><h2>{title}</h2>{body}</section>'
        for key, (title, body) in bodies.items()
    )
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>Diagnosis: {escape(_VERDICTS[of.kind])}</title><style>{COMMON}{STYLE}</style>"
        f'</head><body><main><header><p class="verdict">Diagnosis</p><h1>'
        f"{escape(_VERDICTS[of.kind])}</h1>{_answer(of)}<nav>{links}</nav></header>{sections}"
        "</main></body></html>\n"
    )


def _answer(of: Diagnosis) -> str:
    items = "".join(
        f"<li><b>{question}</b>{escape(sentence)}</li>"
        for question, sentence in zip(_QUESTIONS, said.answer(of), strict=True)
    )
    locked = (
        f"Locked away, to judge by alone: {listed(of.locked)}."
        if of.locked
        else "None is locked away, to judge by."
    )
    limits = f"<h3>What these captures cannot tell</h3>{sentences(of.limits, '')}"
    scenes = counted(len(of.scenes), "scene")
    return (
        f'<ul class="answer">{items}</ul>{_compared(of)}'
        f"<p>Diagnosed: {scenes}, {listed(of.scenes)}. {locked}</p>{limits if of.limits else ''}"
    )


def _compared(of: Diagnosis) -> str:
    if of.against is None:
        return ""
    return prose(words(of.against).gap, f"The others: {of.against}.")


def _made(of: Diagnosis) -> str:
    rows = [
        [
            escape(said.STAGES[arm.bench.arm.value].capitalize()),
            str(len(arm.bench.names)),
            number(float(arm.screen.weight.sum()), ".1f"),
            number(arm.search.threshold, ".1f"),
            *(number(size, ".3g") for size in arm.sizes),
            number(arm.beyond, ".3g"),
            number(arm.explained_below, ".3g"),
        ]
        for arm in of.arms
    ]
    head = ["Half", "Features", "Votes", "Threshold", "Gap before", "Gap after"]
    head += ["Unexplained", "Explained below"]
    return (
        prose(
            "Every scene is simulated with the sensor at hand and told by features: numbers of "
            "levels, texture, shifts, holes and disparity errors in parts of the image. Features "
            "that effects move alike share one vote. An effect is fitted to the gap of some rooms "
            "and judged by its gain in log likelihood on the others."
        )
        + prose(
            f"An effect is accepted if it gains at least the threshold: the most that the best of "
            f"all effects gains by chance in {null.SEEDS} simulated readings of the base, and no "
            f"less than {number(null.LEAST_GAIN, '.0f')}, which stands alone where nothing is "
            "drawn: for pairs matched again by a matcher that reads the bits that are put out. "
            "Where nothing reaches the threshold, half of it is enough of one effect that explains "
            "the gap alone. Another effect is not separable from it if it gains less by no more "
            "than the threshold or a tenth, or not surely less when rooms are drawn anew. A gap "
            "counts as explained if what is left, less what may be wrong by "
            f"{number(100 * TAU, '.0f')} % of what effects make, is below that of noise alone and "
            f"{number(BEYOND_NOISE, '.2f')}, at most {number(UNEXPLAINED, '.2f')}, plus "
            f"{number(100 * OF_BEFORE[Arm.IMAGE], '.0f')} % of its size before "
            f"({number(100 * OF_BEFORE[Arm.DEPTH], '.0f')} % in the half of "
            f"matcher and filters). One room in {LOCKED}, of eight and more at least three, is "
            "locked away by lot: no effect is fitted to it or named by it, and it judges how far. "
            "What differs from scene to scene (pose of the reference, light, reflectance, scale of "
            "the pattern) is fitted to each by itself, and where is told of all."
        )
        + (table(head, rows) if rows else "")
        + prose(
            "That a gap is consistent with an effect does not prove that the effect made it: what "
            "no effect of the table describes is not tried. Every number of this page but those "
            "under the pictures of one scene is in report.json beside it, or follows from what is."
        )
    )
