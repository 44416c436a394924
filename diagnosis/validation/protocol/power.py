"""Power curves: how often an effect is found, by how strong it is."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from starling.diagnosis.validation.camera.catalogue import ROWS
from starling.diagnosis.validation.camera.errors import refusal
from starling.diagnosis.validation.camera.nominal import Nominal
from starling.diagnosis.validation.protocol.answered import Answered
from starling.diagnosis.validation.protocol.case import Case, lot, seed
from starling.diagnosis.validation.protocol.figure import figure
from starling.diagnosis.validation.protocol.limits import Limits

EFFECTS = (
    "ambient",
    "dropped_dots",
    "lens_blur",
    "vertical_offset",
    "read_noise",
    "pixel_locking",
)  # One of scene, projector, optics, geometry, imager and filters.
LEVELS = 6
_WEAKEST, _STRONGEST = 0.25, 8.0  # Times the detection limit.


def levels(camera: Nominal, limits: Limits) -> dict[str, list[float]]:
    """Departures that effects are asked at: as many below their detection limit as above, or more.

    Args:
        camera: Gives the neutrals and the room there is.
        limits: Of what is found; of two sides the one where it is found later counts.

    Returns:
        By effect, departures in geometric steps; none of an effect that this camera cannot show.
    """
    found = {}
    for name in EFFECTS:
        row = ROWS[name]
        sides = limits.sides(row, camera)
        if row.acts(camera) and sides:
            limit = max(limits.least(row, sign) for sign in sides)
            most = min(_STRONGEST * limit, max(row.reach(camera, sign) for sign in sides))
            found[name] = [float(at) for at in np.geomspace(_WEAKEST * limit, most, LEVELS)]
    return found


def draw(
    camera: Nominal,
    limits: Limits,
    sets: int,
    *,
    each: int | None = None,
    entropy: int | None = None,
) -> tuple[Case, ...]:
    """Draw cases by lot: of every effect and level as many, dealt to the sets in turn.

    Args:
        camera: The camera.
        limits: As for `levels`.
        sets: How many sets of scenes there are; a case's number tells its set.
        each: Cases of a level; one in each set by default.
        entropy: Where the lot starts; by default the system's own randomness.

    Raises:
        WithheldError: if `each` is below 1, or no effect can be found.
    """
    count = sets if each is None else each
    asked = levels(camera, limits)
    if count < 1:
        raise refusal("cases", "must be >= 1", count, "Give how many of each level.")
    if not asked:
        raise refusal("power", "must have effects that can be found", "none", "Check the limits.")
    rng = lot(entropy)
    dealt: list[list[dict[str, float]]] = [[] for _ in range(sets)]
    for name, departures in asked.items():
        row = ROWS[name]
        able = limits.sides(row, camera)
        for level, departure in enumerate(departures):
            sides = [sign for sign in able if row.reach(camera, sign) >= departure]
            for number in range(count):
                sign = int(rng.choice(sides))
                settings = {name: row.value(camera, departure, sign)}
                dealt[(number + level) % sets].append(settings)
    drawn = []
    for number, settings in enumerate(dealt):
        for place, i in enumerate(rng.permutation(len(settings))):
            at = number + sets * place
            drawn.append(Case(number=at, kind="single", settings=settings[i], seed=seed(rng)))
    return tuple(sorted(drawn, key=lambda one: one.number))


def curves(answered: Sequence[Answered], camera: Nominal) -> dict[str, list[dict[str, Any]]]:
    """Count what was found at each departure from the neutral.

    Args:
        answered: Cases of `draw` with the verdicts on them.
        camera: The camera of the cases.

    Returns:
        By effect and rising departure, the cases, the share of alarms (`alarm`), that whose first
        named effect is right (`named`) and that with the truth in its set (`found`).

    Raises:
        WithheldError: if a case is no single.
    """
    cases: dict[str, dict[float, list[Answered]]] = {}
    for one in answered:
        if one.case.kind != "single":
            name = f"case {one.case.number}"
            raise refusal(name, "must be a single for a power curve", one.case.kind, "Drop it.")
        name = one.rows[0]
        departure = ROWS[name].departure(camera, one.case.settings[name])
        cases.setdefault(name, {}).setdefault(float(f"{departure:.6g}"), []).append(one)
    return {
        name: [
            {
                "departure": departure,
                "cases": len(those),
                "alarm": figure(those, lambda one: one.alarm).value,
                "named": figure(those, lambda one: one.first_right).value,
                "found": figure(those, lambda one: one.in_set).value,
            }
            for departure, those in sorted(at.items())
        ]
        for name, at in sorted(cases.items())
    }
