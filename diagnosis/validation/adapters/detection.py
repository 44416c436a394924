"""Detection limits: how strong each effect must be for the diagnosis to detect it."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable, Collection, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from tyro.conf import Positional

from starling.diagnosis.scenes.scene_model import load_scene_model, with_capture
from starling.diagnosis.scenes.selection import pair_scenes, split_test_rooms
from starling.diagnosis.which import attribution, null, sensitivity
from starling.diagnosis.which.candidates import Segment
from starling.diagnosis.which.likelihood import Likelihood
from starling.diagnosis.which.response import Signature, add_node, simulate_signature
from starling.diagnosis.which.segment import Screening, diagnose_segment
from starling.diagnosis.which.table import FeatureTable
from starling.diagnosis.workers import WorkerPool
from starling.patterns.errors import InputError, refuse
from starling.sim import effects
from starling.sim.captures import capture
from starling.sim.console import output, progress
from starling.sim.console.threads import single_threaded
from starling.sim.effects.effect import Value
from starling.sim.sensor import resolve
from starling.sim.sensor.sensor import Sensor

_STEPS = 16  # Number of strengths tried between two nodes.
_CLOSER = 4  # Largest number of simulations at the current limit.
_DEVICES = (101, 102, 103, 104)  # Numbers of the simulated devices that confirm a limit.
_STRONGER = 1.5  # Factor of the departure from the base if too few devices detect the effect.
_BACK = 2  # Number of bisections on the way back; they leave a limit at most 11 % too strong.

# A base and the limits below and above it, or all detected values of a choice.
Limits = dict[str, Any]


def detection(
    captures: Positional[tuple[Path, ...]],
    *,
    sensor: str,
    cache: Path | None = None,
    effects: tuple[str, ...] = (),
    against_itself: bool = False,
    despite_gaps: bool = False,
    out: Path | None = None,
) -> None:
    """Measure how strong each effect must be to be detected.

    Prints or writes JSON. A numeric effect has its base, and a detection limit below and above it.
    From the limit on, the gain of the effect alone reaches the threshold in half of the simulated
    captures. The limit is null if no value in the range does. A choice has the list of all detected
    values.

    Limits of matcher and filters depend on the infrared images of the capture set, which should
    have no gap. With several capture sets, a limit has to hold in each. Real captures always have a
    gap, so --against-itself compares them with themselves. The limits then hold for other captures
    of these scenes. With --despite-gaps the sets show the same scenes, each with another gap.
    Effects on the images are added to what accepted effects leave of each gap.

    Args:
        captures: capture sets.
        sensor: preset or sensor file, the base.
        cache: folder that caches simulations.
        effects: effects to test; default: all.
        against_itself: compare each set with its own captures.
        despite_gaps: detect the effects in half of the sets, despite their gaps.
        out: JSON file to write; default: print it.
    """
    if not captures:
        raise refuse("captures", "must be at least one capture set", "none", "Give one.")
    if despite_gaps and against_itself:
        rule, advice = "must be omitted with --despite-gaps", "A set has no gap against itself."
        raise refuse("against-itself", rule, "both", advice)
    single_threaded()
    base = resolve.load(sensor, captures=str(captures[0]))
    with progress.on_stderr() as track:
        options = {"wanted": effects or None, "cache": cache, "track": track}
        if despite_gaps:
            measured = limits_despite_gaps(captures, base, **options)
        else:
            by_set = [
                limits(path, base, against_itself=against_itself, **options) for path in captures
            ]
            measured = common_limits(by_set)
        text = json.dumps(measured, indent=1)
        if out is None:
            print(text)
        else:
            output.write_file(out, text.encode())


def limits(
    captures: Path,
    sensor: Sensor,
    *,
    against_itself: bool = False,
    wanted: Collection[str] | None = None,
    cache: Path | None = None,
    track: progress.Progress = progress.silent,
) -> dict[str, Limits]:
    """Find the detection limits below and above the base, by effect; choices give a list.

    Starts worker processes: in a script, call it below `if __name__ == "__main__"`.

    Args:
        captures: capture set; its images count only for effects of matcher and filters.
        sensor: the base.
        against_itself: whether to compare the captures with themselves.
        wanted: effects to test, with all their parameters; None tests all.
        cache: folder that caches simulations.
        track: wraps long loops to report progress.

    Raises:
        InputError: as for `starling.diagnosis.diagnosis.diagnose`, or if an effect is unknown.
    """
    names = {effects.named(name).name for name in wanted or ()}
    known = capture.open_set(captures)
    pairs = pair_scenes(known, known if against_itself else None).pairs
    scene_models = [
        load_scene_model(scene, sensor, against=reference) for scene, reference in pairs
    ]
    training, _ = split_test_rooms(scene_models)
    by_effect: dict[str, Limits] = {}
    with WorkerPool(
        captures, sensor, training, against=captures if against_itself else None
    ) as pool:
        for segment in attribution.available_segments(scene_models, training):
            # Matching captured pairs depends on the captures, so no other run could use the cache.
            segment_cache = None if segment is Segment.DEPTH else cache
            table, screening = attribution.screen_segment(
                segment, training, always=True, cache=segment_cache, pool=pool, track=track
            )
            tested = track(_tested(screening, names), f"limits in the {segment.value}")
            for signature in tested:
                by_effect[signature.name] = _limits(signature, table, screening)
    return by_effect


def limits_despite_gaps(
    captures: Sequence[Path],
    sensor: Sensor,
    *,
    wanted: Collection[str] | None = None,
    cache: Path | None = None,
    track: progress.Progress = progress.silent,
) -> dict[str, Limits]:
    """Find the limits of effects on the images in captures that have a gap.

    The effect is added to what the accepted effects leave of each gap. From its limit on, it gains
    enough in half of the sets.

    Args:
        captures: capture sets of the same scenes, at least one.
        sensor: as `limits`.
        wanted: as `limits`.
        cache: as `limits`.
        track: as `limits`.

    Raises:
        InputError: as `limits`, or if a set lacks infrared images.
    """
    names = {effects.named(name).name for name in wanted or ()}
    first = [load_scene_model(scene, sensor) for scene in capture.open_set(captures[0]).scenes]
    training, _ = split_test_rooms(first)
    if Segment.IMAGE not in attribution.available_segments(first, training):
        rule = "must have infrared images of two rooms or more"
        raise refuse("captures", rule, captures[0], "Give other captures.")
    with WorkerPool(captures[0], sensor, training, against=None) as pool:
        table, screening = attribution.screen_segment(
            Segment.IMAGE, training, cache=cache, pool=pool, track=track
        )
        alone = dataclasses.replace(table, pool=None)  # Workers hold the captures of the first set.
        remaining = []
        for path in track(captures, "gaps"):
            scenes = zip(first, capture.open_set(path).scenes, strict=True)
            models = [with_capture(model, scene, against=None) for model, scene in scenes]
            captured = alone.with_captures(split_test_rooms(models)[0])
            remaining.append(sensitivity.remaining_gap(diagnose_segment(captured, screening)))
        return {
            signature.name: _limits(signature, table, screening, remaining)
            for signature in track(_tested(screening, names), "limits despite the gaps")
        }


def _tested(screening: Screening, names: Collection[str]) -> list[Signature]:
    return [
        signature
        for signature in screening.signatures
        if not names or signature.candidate.effect.name in names
    ]


def common_limits(sets: Sequence[dict[str, Limits]]) -> dict[str, Limits]:
    """Return the limits that hold in every capture set.

    Args:
        sets: limits by effect for each capture set, at least one; all with the same base.
    """
    known = [name for name in sets[0] if all(name in limits for limits in sets)]
    return {name: _common([limits[name] for limits in sets]) for name in known}


def _common(sets: Sequence[Limits]) -> Limits:
    first = sets[0]
    if "found" in first:
        return {
            "found": [
                value
                for value in first["found"]
                if all(value in limits["found"] for limits in sets)
            ]
        }
    return {
        "base": first["base"],
        "below": _farthest([limits["below"] for limits in sets], min),
        "above": _farthest([limits["above"] for limits in sets], max),
    }


def _farthest(values: Sequence[Value | None], choose: Callable[..., Value]) -> Value | None:
    known = [value for value in values if value is not None]
    return choose(known) if len(known) == len(values) else None


def _limits(
    signature: Signature,
    table: FeatureTable,
    screening: Screening,
    remaining: Sequence[Likelihood] = (),
) -> Limits:
    candidate = signature.candidate
    if candidate.numeric:
        return {
            "base": candidate.base,
            "below": _side(signature, table, screening, remaining, upwards=False),
            "above": _side(signature, table, screening, remaining, upwards=True),
        }
    # The screening simulated only some of the values.
    whole = simulate_signature(candidate, table, candidate.nodes) or signature
    detected = [
        whole.value(place)
        for place in range(len(whole.values))
        if sensitivity.is_detected(whole, place, screening, remaining)
    ]
    return {"found": [value for value in detected if value != candidate.base]}


def _side(
    signature: Signature,
    table: FeatureTable,
    screening: Screening,
    remaining: Sequence[Likelihood] = (),
    *,
    upwards: bool,
) -> Value | None:
    """Find the limit on one side by simulation there, because few effects are linear."""
    base = float(signature.candidate.base)
    side = [float(node) for node in signature.candidate.nodes if (float(node) > base) == upwards]
    if not side:
        return None
    find = partial(
        sensitivity.detection_limit,
        screening=screening,
        remaining=remaining,
        upwards=upwards,
        steps=_STEPS,
    )
    least = find(signature)
    if least is None:  # The screening did not simulate the strongest value.
        signature = simulate_signature(signature.candidate, table, side) or signature
        least = find(signature)
    for _ in range(_CLOSER):
        if least is None or least in signature.values:
            break
        signature = add_node(signature, least, table)
        least = find(signature)
    if least is None or remaining:  # Devices of captures with gaps differ from the base's.
        return least
    farthest = max(abs(node - base) for node in side)
    return _on_devices(signature, float(least), farthest, table, screening)


def _on_devices(
    signature: Signature, least: float, farthest: float, table: FeatureTable, screening: Screening
) -> float | None:
    """Confirm a limit on several devices and strengthen it if needed; None beyond `farthest`."""
    weak = base = float(signature.candidate.base)
    while not _detected_on_devices(signature, least, table, screening):
        weak = least
        departure = _STRONGER * (least - base)
        if signature.candidate.whole:  # Round up, so that the value changes.
            departure = math.copysign(math.ceil(abs(departure)), departure)
        least = base + departure
        if abs(least - base) > farthest:
            return None
    for _ in range(_BACK):  # Bisect between the last value that failed and the first that passed.
        departure = math.copysign(math.sqrt((weak - base) * (least - base)), least - base)
        between = base + (round(departure) if signature.candidate.whole else departure)
        if between in (weak, least):
            break
        if _detected_on_devices(signature, between, table, screening):
            least = between
        else:
            weak = between
    return least


def _detected_on_devices(
    signature: Signature, value: Value, table: FeatureTable, screening: Screening
) -> bool:
    """Whether the effect gains enough on half of the devices, each with its own random pattern.

    Matcher and filters have no random part.
    """
    if table.segment is Segment.DEPTH:
        return True
    try:
        captures = [
            null.simulate_capture(table, screening.base, {signature.name: value}, number=device)
            for device in _DEVICES
        ]
    except InputError:  # The effect must be possible on every device.
        return False
    likelihoods = [base.likelihood(observed, screening.weight) for base, observed in captures]
    return sensitivity.gains_enough(signature, likelihoods, screening)
