"""How strong an effect has to be to be found: what the diagnosis says of its own signatures.

    python -m starling.diagnosis.validation.adapters.detection CAPTURES... --sensor FILE [--cache FOLDER] [--effects NAME...]
                                                      [--against-itself] [--out FILE]

Prints or writes JSON: by effect its base, and the values below and above from which on its own gain
passes the threshold in half of the simulated readings; null where no value of its range does. Of
effects that are a choice, all values that are found.

Matcher and filters are asked about on the infrared images that the capture set holds; it should be
one that nothing is wrong with. Of several capture sets those limits are told that hold in each.
Real captures, of which something always is, are compared with themselves: then it is told what
would be found in others of the same scenes.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import Any

from starling.diagnosis.scenes.pairs import scene_pairs
from starling.diagnosis.scenes.scene_model import subject
from starling.diagnosis.validation.adapters import program
from starling.diagnosis.which import attribution, null, sensitivity
from starling.diagnosis.which.candidates import Arm
from starling.diagnosis.which.response import Signature, signature, with_node
from starling.diagnosis.which.segment import Screen
from starling.diagnosis.which.table import Bench
from starling.diagnosis.workers import Crew
from starling.sim import effects
from starling.sim.captures import capture
from starling.sim.console import output, progress
from starling.sim.console.threads import single_threaded
from starling.sim.effects.effect import Value
from starling.sim.sensor import resolve
from starling.sim.sensor.sensor import Sensor

_STEPS = 16  # Strengths tried between two nodes.
_CLOSER = 4  # Times that an effect is simulated where it was just found.
_DEVICES = (101, 102, 103, 104)  # Whose readings with an effect are looked at in the end.
_STRONGER = 1.5  # Departure over the last one, where too few of them are found.
_BACK = 2  # Times that it is halved on the way back, which leaves a limit 11 % too strong at most.

Limits = dict[str, Any]  # A base and the values below and above; of a choice all that are found.


def limits(
    captures: Path,
    sensor: Sensor,
    *,
    against_itself: bool = False,
    wanted: Collection[str] | None = None,
    cache: Path | None = None,
    track: progress.Progress = progress.silent,
) -> dict[str, Limits]:
    """Find the least values that are found, below and above the base, by effect; choices as a list.

    Simulates in processes of its own: call it below `if __name__ == "__main__"` in a script.

    Args:
        captures: capture set; what it holds counts for effects of matcher and filters alone.
        sensor: the base.
        against_itself: whether captures would be compared with others of the same scenes.
        wanted: effects that are asked about, with all their numbers; None asks about all.
        cache: folder that keeps what is simulated.
        track: wraps loops that take long.

    Raises:
        InputError: as `starling.diagnosis.diagnosis.diagnose`, or of an effect that no table has.
    """
    names = {effects.named(name).name for name in wanted or ()}
    known = capture.open_set(captures)
    pairs = scene_pairs(known, known if against_itself else None).pairs
    subjects = [subject(scene, sensor, against=other) for scene, other in pairs]
    asked, _ = attribution.parted(subjects)
    found: dict[str, Limits] = {}
    with Crew(captures, sensor, asked, against=captures if against_itself else None) as crew:
        for arm in attribution.open_arms(subjects, asked):
            # What captured pairs are matched to depends on captures: no other run asks for it.
            place = None if arm is Arm.DEPTH else cache
            table, screen = attribution.screened(
                arm, asked, always=True, cache=place, crew=crew, track=track
            )
            asked_about = [
                one for one in screen.rough if not names or one.candidate.effect.name in names
            ]
            for one in track(asked_about, f"limits in the {arm.value}"):
                found[one.name] = _limits(one, table, screen)
    return found


def in_each(many: Sequence[dict[str, Limits]]) -> dict[str, Limits]:
    """Values that are found in every one of some capture sets.

    Args:
        many: limits by effect, at least one; all of one base.
    """
    known = [name for name in many[0] if all(name in one for one in many)]
    return {name: _in_each([one[name] for one in many]) for name in known}


def _in_each(many: Sequence[Limits]) -> Limits:
    first = many[0]
    if "found" in first:
        return {
            "found": [
                value for value in first["found"] if all(value in one["found"] for one in many)
            ]
        }
    return {
        "base": first["base"],
        "below": _farthest([one["below"] for one in many], min),
        "above": _farthest([one["above"] for one in many], max),
    }


def _farthest(values: Sequence[Value | None], choose: Callable[..., Value]) -> Value | None:
    known = [value for value in values if value is not None]
    return choose(known) if len(known) == len(values) else None


def _limits(of: Signature, table: Bench, screen: Screen) -> Limits:
    candidate = of.candidate
    if candidate.numeric:
        return {
            "base": candidate.base,
            "below": _side(of, table, screen, upwards=False),
            "above": _side(of, table, screen, upwards=True),
        }
    # What is tried first is not all there is.
    whole = signature(candidate, table, candidate.nodes) or of
    tried = range(len(whole.values))
    found = [whole.value(place) for place in tried if sensitivity.at(whole, place, screen)]
    return {"found": [value for value in found if value != candidate.base]}


def _side(of: Signature, table: Bench, screen: Screen, *, upwards: bool) -> Value | None:
    """The least value found to one side, simulated there: few effects grow in proportion."""
    base = float(of.candidate.base)
    side = [float(node) for node in of.candidate.nodes if (float(node) > base) == upwards]
    if not side:
        return None
    least = sensitivity.least(of, screen, upwards=upwards, steps=_STEPS)
    if least is None:  # What is tried first is not the strongest either.
        of = signature(of.candidate, table, side) or of
        least = sensitivity.least(of, screen, upwards=upwards, steps=_STEPS)
    for _ in range(_CLOSER):
        if least is None or least in of.values:
            break
        of = with_node(of, least, table)
        least = sensitivity.least(of, screen, upwards=upwards, steps=_STEPS)
    if least is None:
        return None
    farthest = max(abs(node - base) for node in side)
    return _on_devices(of, float(least), farthest, table, screen)


def _on_devices(
    of: Signature, least: float, farthest: float, table: Bench, screen: Screen
) -> float | None:
    """The least value from one on that some devices show; None where it is beyond a departure."""
    weak = base = float(of.candidate.base)
    while not _found_on_devices(of, least, table, screen):
        weak = least
        departure = _STRONGER * (least - base)
        if of.candidate.whole:  # A step further at least, which rounding could take back.
            departure = math.copysign(math.ceil(abs(departure)), departure)
        least = base + departure
        if abs(least - base) > farthest:
            return None
    for _ in range(_BACK):  # Of what was found at once there is nothing between.
        departure = math.copysign(math.sqrt((weak - base) * (least - base)), least - base)
        between = base + (round(departure) if of.candidate.whole else departure)
        if between in (weak, least):
            break
        if _found_on_devices(of, between, table, screen):
            least = between
        else:
            weak = between
    return least


def _found_on_devices(of: Signature, value: Value, table: Bench, screen: Screen) -> bool:
    """Whether half of some devices give it enough gain: each has noise, dots and pixels of its own.

    Of matcher and filters nothing is drawn.
    """
    if table.arm is Arm.DEPTH:
        return True
    made = [null.another(table, screen.base, {of.name: value}, number=one) for one in _DEVICES]
    likelihoods = [base.likelihood(reading, screen.weight) for base, reading in filter(None, made)]
    return len(likelihoods) == len(made) and sensitivity.enough(of, likelihoods, screen)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; 1 where something is refused."""
    parser = argparse.ArgumentParser(
        prog="python -m starling.diagnosis.validation.adapters.detection",
        description="Say how strong an effect has to be.",
    )
    parser.add_argument(
        "captures", type=Path, nargs="+", help="capture sets, of whose scenes is asked"
    )
    parser.add_argument("--sensor", required=True, help="preset or sensor file, the base")
    parser.add_argument("--cache", type=Path, help="folder that keeps what is simulated")
    parser.add_argument("--effects", nargs="+", help="that are asked about; all if none is named")
    parser.add_argument(
        "--against-itself", action="store_true", help="compare each set with its own captures"
    )
    parser.add_argument("--out", type=Path, help="file for the JSON; none prints it")
    asked = parser.parse_args(arguments)
    single_threaded()

    def work(track: progress.Progress) -> None:
        sensor = resolve.load(asked.sensor, captures=str(asked.captures[0]))
        found = [
            limits(
                one,
                sensor,
                against_itself=asked.against_itself,
                wanted=asked.effects,
                cache=asked.cache,
                track=track,
            )
            for one in asked.captures
        ]
        told = json.dumps(in_each(found), indent=1)
        if asked.out is None:
            print(told)
        else:
            output.write_file(asked.out, told.encode())

    return program.run(work)


if __name__ == "__main__":
    sys.exit(main())
