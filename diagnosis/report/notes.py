"""Lists below the answer: levels, effects, surrogates, weak candidates and the remainder.

Each item holds one or more sentences of at most 25 words.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from starling.diagnosis.diagnosis import Diagnosis
from starling.diagnosis.howfar.residual import LearnedResidual
from starling.diagnosis.report import first_answer, sentences
from starling.diagnosis.report.words import side_names
from starling.diagnosis.where.remainder import RemainderPlace
from starling.diagnosis.which.search import AcceptedEffect
from starling.diagnosis.which.segment import SegmentResult
from starling.sim.effects import setting

Item = list[str]  # Sentences.


def notes(diagnosis: Diagnosis) -> list[str]:
    """Return all sentences of all lists."""
    return [
        sentence for items in note_lists(diagnosis).values() for item in items for sentence in item
    ]


def note_lists(diagnosis: Diagnosis) -> dict[str, list[Item]]:
    """Return what the answer leaves out: items by title, without empty lists."""
    effects = [effect for _, effect in sentences.ranked_effects(diagnosis)]
    reported = [effect for effect in effects if not diagnosis.evidence[effect.fit.name].reasons]
    surrogates = [effect for effect in effects if diagnosis.evidence[effect.fit.name].reasons]
    lists = {
        "Check first": list(_levels(diagnosis)),
        "Images and disparity": _sentences(
            first_answer.coherence_sentences(diagnosis.where.coherence, diagnosis.against)
        ),
        "Pixels without depth": _sentences(first_answer.stage_sentences(diagnosis.where)),
        "Effects": [_effect(diagnosis, effect) for effect in reported],
        "Surrogates": [_surrogate(diagnosis, effect) for effect in surrogates],
        "Too weak to name": [item for each in diagnosis.segments for item in _weak(each)],
        "Unexplained remainder": list(_remainders(diagnosis)),
        "Learned residual": _residual(diagnosis.residual),
    }
    return {title: items for title, items in lists.items() if items}


def _sentences(texts: Item) -> list[Item]:
    """Make one item of sentences; none without any."""
    return [texts] if texts else []


def _levels(diagnosis: Diagnosis) -> Iterator[Item]:
    """Report that captures are brighter or darker than the base, which is no effect yet."""
    middle = sentences.exposure_ratio(diagnosis)
    if middle is None:
        return
    ratios = diagnosis.where.levels.values()
    first, second = side_names(diagnosis.against).have
    word = "brighter" if middle > 1 else "darker"
    ends = dict.fromkeys(f"{end:.2g}" for end in (min(ratios), max(ratios)))
    item = [
        f"Your exposure may be off by a factor of {middle:.2g}: {first} are {word} than {second} "
        f"({' to '.join(ends)} by room)."
    ]
    if diagnosis.settings:
        item.append("A reported effect may describe the same difference; correct one of them.")
    yield item


def _effect(diagnosis: Diagnosis, effect: AcceptedEffect) -> Item:
    """Describe an accepted effect."""
    name = effect.fit.name
    low, high = (sentences.number(end) for end in effect.interval)
    value = sentences.with_unit(name, effect.fit.value)
    base = sentences.with_unit(name, effect.fit.signature.candidate.base)
    item = [f"{name} is {value} instead of {base} (90 %: {low} to {high})."]
    row, _ = setting.parameter_of(name)
    item.append(f"It describes: {row.imitates}")
    if effect.rivals:
        rivals = sentences.shortened([rival.name for rival in effect.rivals])
        item.append(f"These captures cannot separate {name} from {rivals}.")
    if name in diagnosis.absorbed:
        item.append(f"{name} is not separable from {sentences.ESTIMATED}.")
    alone = {} if diagnosis.howfar is None else diagnosis.howfar.alone.get(name, {})
    closed = sentences.largest_closed(alone)
    if closed is not None:
        item.append(f"By itself, {name} closes {closed}.")
    return item


def _surrogate(diagnosis: Diagnosis, effect: AcceptedEffect) -> Item:
    """Describe an accepted effect that is a surrogate, with the reasons."""
    name = effect.fit.name
    reasons = diagnosis.evidence[name].reasons
    return [
        *_effect(diagnosis, effect),
        *(f"{name} is called a surrogate: {sentences.REASONS[reason]}." for reason in reasons),
    ]


def _weak(segment: SegmentResult) -> Iterator[Item]:
    """Name the best candidates where no effect gains enough."""
    where = sentences.SEGMENTS[segment.table.segment.value]
    for fit in segment.weak:
        gain, needed = f"{fit.total:.0f}", f"{segment.search.threshold:.0f}"
        value = sentences.with_unit(fit.name, fit.value)
        if fit.total < segment.search.threshold:
            yield [f"In {where}, {fit.name} {value} has a gain of {gain}; {needed} is needed."]
        else:
            yield [f"In {where}, {fit.name} {value} loses its gain once it is simulated."]


def _remainders(diagnosis: Diagnosis) -> Iterator[Item]:
    """Describe how much of each segment's gap stays unexplained, and where."""
    for segment in diagnosis.segments:
        name = segment.table.segment.value
        left = diagnosis.remainders[name]
        if not left.share:
            continue
        ends = ""
        if left.interval is not None:
            ends = f" (95 %: {100 * left.interval[0]:.0f} to {100 * left.interval[1]:.0f})"
        where = sentences.SEGMENTS[name]
        place = diagnosis.places.get(name)
        size = [f"Unexplained in {where}: {100 * left.share:.0f} %{ends} of the gap."]
        if not diagnosis.settings.keys() & segment.settings.keys():
            size = [f"No effect is reported in {where}, so all of its gap counts as unexplained."]
        elif segment.unexplained:
            size.append("An unknown cause may therefore imitate the reported effects.")
        if not left.notable:
            yield size
            continue
        yield [
            *size,
            *_shows_in("", segment.lead),
            *_shows_in(" differently in each scene", segment.varying),
            *(_place(place) if place is not None else ()),
        ]


def _shows_in(clause: str, groups: Sequence[str]) -> Iterator[str]:
    if groups:
        names = sentences.shortened([sentences.describe_group(group) for group in groups])
        yield f"Features that show it{clause}: {names}."


def _place(place: RemainderPlace) -> Iterator[str]:
    if place.frame is not None:
        yield f"It {sentences.FRAMES[place.frame]}."
    if place.zone is not None:
        yield f"It is strongest at the {place.zone} of the image."
    if place.scale is not None:
        yield f"It varies {sentences.SCALES[place.scale]}."


def _residual(residual: LearnedResidual | None) -> list[Item]:
    """Report what a network that corrects the base reaches, and how much of it effects absorb."""
    if residual is None:
        return []
    before, bound = (f"{each['ndp_brier']:.3g}" for each in (residual.alone, residual.bound))
    item = [f"A learned residual changes the Brier score of holes from {before} to {bound}."]
    absorption = residual.absorption
    if not absorption.closable:
        return [[*item, "This gain does not significantly exceed the gain without a gap."]]
    gain = absorption.gain_before - absorption.gain_floor
    item.append(f"This gain exceeds the gain without a gap by {gain:.2g}.")
    if absorption.share is not None:
        ends = ""
        if absorption.interval is not None:
            ends = f" [{100 * absorption.interval[0]:.0f}, {100 * absorption.interval[1]:.0f}]"
        item.append(f"The effects absorb {100 * absorption.share:.0f} %{ends} of that.")
    return [item]
