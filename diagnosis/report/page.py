"""The report of a diagnosis as one self-contained HTML page, `report.html`."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from starling.diagnosis.diagnosis import Diagnosis
from starling.diagnosis.report import (
    howfar_section,
    notes,
    scene_section,
    sentences,
    where_section,
    which_section,
)
from starling.diagnosis.report.notes import Item
from starling.diagnosis.report.words import side_names
from starling.diagnosis.scenes.selection import ROOMS_PER_TEST_ROOM
from starling.diagnosis.which import null
from starling.diagnosis.which.candidates import Segment
from starling.diagnosis.which.likelihood import TAU
from starling.diagnosis.which.segment import NOISE_ALLOWANCE, NOISE_LIMIT, SHARE_OF_INITIAL
from starling.sim.report import elements
from starling.sim.report.elements import listed, number, prose, table

_VERDICTS = {
    "effects": "Consistent with known effects",
    "no gap": "No gap found",
    "none of the known": "No known effect explains the gap",
    "cannot tell": "These captures cannot identify the effect",
}
_TITLES = {
    "Effects": "Settings of the sensor file, or of the scene, that make the simulation look like "
    "these captures.",
    "Surrogates": "These settings reduce the gap by imitating its cause, which is something else. "
    "Do not use their values.",
    "Too weak to name": "The best candidates. The gain measures the evidence on rooms that did not "
    "fit them.",
    "Unexplained remainder": "What stays of the gap once the effects are simulated. Maps of it "
    "stand in the section on where the gap lies.",
}
_QUESTIONS = ("Where", "Which", "How far")


def page(diagnosis: Diagnosis) -> str:
    """Write a diagnosis as an HTML page: inline style, embedded pictures, no scripts."""
    verdict = _VERDICTS[diagnosis.kind]
    if diagnosis.kind == "effects" and sentences.without_effect(diagnosis):
        verdict = "Partly consistent with known effects"
    return elements.page(
        f"Diagnosis: {verdict}",
        f'<p class="verdict">Diagnosis</p><h1>{escape(verdict)}</h1>{_answer(diagnosis)}',
        {
            "pictures": (f"Example scene: {diagnosis.example.scene}", _pictures(diagnosis)),
            "findings": ("Findings", _findings(diagnosis)),
            "where": ("Where the gap lies", where_section.section(diagnosis)),
            "which": ("Which effects it is consistent with", which_section.section(diagnosis)),
            "howfar": ("How far the gap closes", howfar_section.section(diagnosis)),
            "made": ("How this report was made", _method(diagnosis)),
        },
    )


def _answer(diagnosis: Diagnosis) -> str:
    items = "".join(
        f"<li><b>{question}</b>{escape(sentence).replace(' %', '&nbsp;%')}</li>"
        for question, sentence in zip(
            (*_QUESTIONS, "Next"),
            (*sentences.answer(diagnosis), sentences.next_step(diagnosis)),
            strict=True,
        )
    )
    return f'<ul class="answer">{items}</ul>{_compared(diagnosis)}'


def _pictures(diagnosis: Diagnosis) -> str:
    return scene_section.section(
        diagnosis.example,
        side_names(diagnosis.against),
        applied=sentences.applied(diagnosis),
        held_out=diagnosis.example.scene in diagnosis.held_out,
        tried=bool(diagnosis.segments),
        estimated="pattern_scale" in diagnosis.fitted.get(diagnosis.example.scene, {}),
    )


def _findings(diagnosis: Diagnosis) -> str:
    """List effects, surrogates, the remainder and limits, each below its own title."""
    lists = notes.note_lists(diagnosis)
    if diagnosis.limits:
        lists["Limits of these captures"] = [[limit] for limit in diagnosis.limits]
    training = [name for name in diagnosis.scenes if name not in diagnosis.held_out]
    held_out = (
        f"Effects are evaluated on {listed(diagnosis.held_out)}."
        if diagnosis.held_out
        else "No scene is held out for evaluation."
    )
    return (
        "".join(f"<h3>{title}</h3>{_list(title, items)}" for title, items in lists.items())
        + f"<p>Effects are selected on {listed(training)}. {held_out}</p>"
    )


def _list(title: str, items: Sequence[Item]) -> str:
    """Write items with their first sentence on top and the others in a list below it."""
    explained = prose(_TITLES[title], quiet=True) if title in _TITLES else ""
    return f"{explained}<ul>{''.join(map(_item, items))}</ul>"


def _item(item: Item) -> str:
    first, *rest = map(escape, item)
    below = "".join(f"<li>{sentence}</li>" for sentence in rest)
    return f"<li>{first}{f'<ul>{below}</ul>' if below else ''}</li>"


def _compared(diagnosis: Diagnosis) -> str:
    if diagnosis.against is None:
        return ""
    return prose(side_names(diagnosis.against).gap, f"The other captures: {diagnosis.against}.")


def _method(diagnosis: Diagnosis) -> str:
    rows = [
        [
            escape(sentences.SEGMENTS[segment.table.segment.value].capitalize()),
            str(len(segment.table.names)),
            number(float(segment.screening.weight.sum()), ".1f"),
            number(segment.search.threshold, ".1f"),
            *(number(size, ".3g") for size in segment.sizes),
            number(segment.unexplained_size, ".3g"),
            number(segment.explained_below, ".3g"),
        ]
        for segment in diagnosis.segments
    ]
    head = ["Segment", "Features", "Sum of weights", "Threshold", "Gap before", "Gap after"]
    head += ["Unexplained", "Explained below"]
    return (
        prose(
            "Every scene is simulated with the given sensor and summarised by features: numbers "
            "for levels, texture, shifts, holes and disparity errors in parts of the image. "
            "Features that effects change in the same way share one weight. An effect is fitted to "
            "the gap of some rooms and scored by its gain in log-likelihood on the other rooms."
        )
        + prose(
            "An effect is accepted if its held-out gain reaches the threshold. The threshold is "
            "the largest gain that any effect reaches by chance in "
            f"{null.SEEDS} simulated captures of the base sensor, and at least "
            f"{number(null.LEAST_GAIN, '.0f')}. Only this minimum applies if the simulation has "
            "no random part, as for stored pairs that are matched again. If no effect reaches the "
            "threshold, half of it suffices for one effect that explains the gap alone. "
            "Another effect is not separable from an accepted one in two cases. Its gain is lower "
            "by no more than the threshold or a tenth, or the difference of the gains is not "
            "significant when rooms are resampled."
        )
        + prose(
            "The unexplained part of a gap is what remains after allowing for an error of "
            f"{number(100 * TAU, '.0f')} % in the predicted effects. A gap counts as explained if "
            "this part is below a limit. The limit is the size that noise alone makes plus "
            f"{number(NOISE_ALLOWANCE, '.2f')}, at most {number(NOISE_LIMIT, '.2f')}, plus "
            f"{number(100 * SHARE_OF_INITIAL[Segment.IMAGE], '.0f')} % of the gap before "
            f"({number(100 * SHARE_OF_INITIAL[Segment.DEPTH], '.0f')} % for matcher and filters)."
        )
        + prose(
            f"One room in {ROOMS_PER_TEST_ROOM} is held out at random; of eight or more rooms, at "
            "least three. Held-out rooms are not used to fit or accept effects. They only measure "
            "how far the gap closes. Parameters that differ between scenes (pose of the reference, "
            "light, reflectance, pattern scale) are fitted to each scene separately. The section "
            "on where the gap lies uses all scenes."
        )
        + (table(head, rows) if rows else "")
        + prose(
            "That a gap is consistent with an effect does not prove that the effect is present: "
            "only effects of the table are tried. All numbers on this page are in report.json or "
            "follow from it, except those under the pictures of a single scene."
        )
    )
