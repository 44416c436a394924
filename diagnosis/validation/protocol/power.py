"""Power curves: the detection rate of an effect as a function of its strength."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from starling.diagnosis.validation.camera.catalogue import ROWS
from starling.diagnosis.validation.camera.errors import refusal
from starling.diagnosis.validation.camera.nominal import Nominal
from starling.diagnosis.validation.protocol.case import Case, random_generator, seed
from starling.diagnosis.validation.protocol.limits import DetectionLimits
from starling.diagnosis.validation.protocol.score_statistic import statistic
from starling.diagnosis.validation.protocol.verdict import CaseResult

EFFECTS = (
    "ambient",
    "dropped_dots",
    "lens_blur",
    "vertical_offset",
    "read_noise",
    "pixel_locking",
)  # One effect each of scene, projector, optics, geometry, imager and filters.
LEVELS = 6  # Number of strengths per effect.
_WEAKEST, _STRONGEST = 0.25, 8.0  # Range of strengths in units of the detection limit.


def levels(camera: Nominal, limits: DetectionLimits) -> dict[str, list[float]]:
    """Return the departures of each effect, from below to above its detection limit.

    Args:
        camera: Nominal camera, which gives the neutrals and the allowed ranges.
        limits: Detection limits. The larger limit of both sides counts.

    Returns:
        By effect, departures in geometric steps. Effects that this camera cannot show are absent.
    """
    departures = {}
    for name in EFFECTS:
        row = ROWS[name]
        sides = limits.sides(row, camera)
        if row.applies_to(camera) and sides:
            limit = max(limits.least(row, sign) for sign in sides)
            most = min(_STRONGEST * limit, max(row.reach(camera, sign) for sign in sides))
            steps = np.geomspace(_WEAKEST * limit, most, LEVELS)
            departures[name] = [float(departure) for departure in steps]
    return departures


def draw(
    camera: Nominal,
    limits: DetectionLimits,
    sets: int,
    *,
    each: int | None = None,
    entropy: int | None = None,
) -> tuple[Case, ...]:
    """Draw cases at random, the same number for each effect and level, distributed over the sets.

    Args:
        camera: The nominal camera.
        limits: Detection limits, as for `levels`.
        sets: Number of scene sets. The set of a case is its number modulo `sets`.
        each: Cases per level; by default one in each set.
        entropy: Seed of the draw; by default from the operating system.

    Raises:
        WithheldError: if no effect can be detected.
    """
    count = sets if each is None else each
    departures_by_effect = levels(camera, limits)
    if not departures_by_effect:
        rule = "must have effects that can be detected"
        raise refusal("power", rule, "none", "Check the limits.")
    rng = random_generator(entropy)
    by_set: list[list[dict[str, float]]] = [[] for _ in range(sets)]
    for name, departures in departures_by_effect.items():
        row = ROWS[name]
        signs = limits.sides(row, camera)
        for level, departure in enumerate(departures):
            sides = [sign for sign in signs if row.reach(camera, sign) >= departure]
            for number in range(count):
                sign = int(rng.choice(sides))
                settings = {name: row.value(camera, departure, sign)}
                by_set[(number + level) % sets].append(settings)
    cases = []
    for set_number, settings in enumerate(by_set):
        for turn, i in enumerate(rng.permutation(len(settings))):
            number = set_number + sets * turn
            cases.append(Case(number=number, kind="single", settings=settings[i], seed=seed(rng)))
    return tuple(sorted(cases, key=lambda case: case.number))


def curves(results: Sequence[CaseResult], camera: Nominal) -> dict[str, list[dict[str, Any]]]:
    """Compute the detection rates at each departure from the neutral.

    Args:
        results: Cases of `draw` with their verdicts.
        camera: The nominal camera of the cases.

    Returns:
        A list by effect, in order of departure. Each entry has the number of cases and three
        shares: a reported gap (`alarm`), a correct top-1 effect (`named`), and the true effect in
        the credible set (`found`).
    """
    cases: dict[str, dict[float, list[CaseResult]]] = {}
    for result in results:
        name = result.rows[0]
        departure = ROWS[name].departure(camera, result.case.settings[name])
        cases.setdefault(name, {}).setdefault(float(f"{departure:.6g}"), []).append(result)
    return {
        name: [
            {
                "departure": departure,
                "cases": len(level),
                "alarm": statistic(level, lambda result: result.gap_reported).value,
                "named": statistic(level, lambda result: result.top1_correct).value,
                "found": statistic(level, lambda result: result.in_set).value,
            }
            for departure, level in sorted(by_departure.items())
        ]
        for name, by_departure in sorted(cases.items())
    }
