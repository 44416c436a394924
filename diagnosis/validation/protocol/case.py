"""One case of the check: the effects of a camera, and the random draw of cases."""

from __future__ import annotations

import dataclasses
import json
import math
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np

from starling.diagnosis.validation.camera import imperfections, json_file
from starling.diagnosis.validation.camera.catalogue import ROWS, EffectRow, Kind, check_names
from starling.diagnosis.validation.camera.errors import refusal
from starling.diagnosis.validation.camera.nominal import Nominal
from starling.diagnosis.validation.protocol import plan
from starling.diagnosis.validation.protocol.limits import DetectionLimits

CaseKind = Literal["null", "single", "pair", "unknown"]
FARTHEST = 1.5  # Largest departure of a case over that of the table.
_SEED_BITS = 62
_OPTIONAL = "imperfections"  # Key that a case with a perfect base lacks.
_ADVICE = "Put the sealed file back."


@dataclass(frozen=True, kw_only=True, slots=True)
class Case:
    """A camera with effects. Settings are strengths as `catalogue.EffectRow` defines them."""

    number: int
    kind: CaseKind
    settings: Mapping[str, float] = field(default_factory=dict)
    seed: int
    imperfections: Mapping[str, float] = field(default_factory=dict)  # Strength by name.

    def __post_init__(self) -> None:
        check_names(self.settings)
        imperfections.check(self.imperfections)

    @property
    def name(self) -> str:
        """Name of the files and folders of the case."""
        return f"{self.number:03d}"


def draw(
    nominal: Nominal,
    counts: Mapping[CaseKind, int],
    *,
    families: Mapping[str, str] | None = None,
    limits: DetectionLimits | None = None,
    kinds: Sequence[Kind] = ("image",),
    leave_out: Iterable[str] = (),
    upwards: Iterable[str] = (),
    beyond: float = 0.0,
    imperfect: str | None = None,
    entropy: int | None = None,
) -> tuple[Case, ...]:
    """Draw cases at random.

    Singles cycle through all effects in random order. Pairs have effects of two families. The
    departures are log-uniform from the detection limit, or the low end of the table, to the high
    end. Case numbers are random, so that they do not depend on the kind.

    Args:
        nominal: The nominal camera.
        counts: Number of cases by kind.
        families: Family by effect. An effect without an entry is a family of its own.
        limits: Detection limits, if measured.
        kinds: Kinds of effects that singles and pairs are drawn from.
        leave_out: Names of effects that are not drawn.
        upwards: Names of effects that are drawn only above their neutral.
        beyond: Share of strengths beyond the high end of the table, by up to `FARTHEST`.
        imperfect: One of `plan.PLANS`: imperfections of the base. None is a perfect base.
        entropy: Seed of the draw; by default from the operating system.

    Raises:
        WithheldError: if no effect can be drawn, or there is no such plan.
    """
    rng = random_generator(entropy)
    drawer = _Drawer(
        rng=rng,
        nominal=nominal,
        families=families or {},
        limits=limits or DetectionLimits(),
        upwards=frozenset(upwards),
        beyond=beyond,
    )
    rows = [row for row in ROWS.values() if row.name not in {*leave_out}]
    known = drawer.drawable(row for row in rows if row.kind in kinds)
    unknown = drawer.drawable(row for row in rows if row.kind == "outside")
    draw_effects: dict[CaseKind, Callable[[int], list[tuple[EffectRow, ...]]]] = {
        "null": lambda count: [()] * count,
        "single": lambda count: [(row,) for row in drawer.cycle(known, count)],
        "pair": lambda count: [drawer.pair(known) for _ in range(count)],
        "unknown": lambda count: [(row,) for row in drawer.cycle(unknown, count)],
    }
    drawn = [
        (kind, {row.name: drawer.strength(row) for row in effects})
        for kind, draw_rows in draw_effects.items()
        for effects in draw_rows(counts.get(kind, 0))
    ]
    worlds = [{}] * len(drawn) if imperfect is None else plan.draw(imperfect, len(drawn), rng)
    order = rng.permutation(len(drawn))
    return tuple(
        Case(
            number=number,
            kind=drawn[i][0],
            settings=drawn[i][1],
            seed=seed(rng),
            imperfections=worlds[i],
        )
        for number, i in enumerate(order)
    )


def random_generator(entropy: int | None) -> np.random.Generator:
    """Return a generator seeded with `entropy`, by default from the operating system."""
    if entropy is None:
        entropy = int.from_bytes(os.urandom(16), "big")
    return np.random.Generator(np.random.SFC64(entropy))


def seed(rng: np.random.Generator) -> int:
    """Draw the seed of a case."""
    return int(rng.integers(0, 2**_SEED_BITS))


@dataclass(frozen=True, kw_only=True, slots=True)
class _Drawer:
    rng: np.random.Generator
    nominal: Nominal
    families: Mapping[str, str]
    limits: DetectionLimits
    upwards: frozenset[str]
    beyond: float

    def family(self, row: EffectRow) -> str:
        return self.families.get(row.name, row.name)

    def sides(self, row: EffectRow) -> list[int]:
        """Signs on which an effect is drawn."""
        signs = self.limits.sides(row, self.nominal)
        return [sign for sign in signs if sign > 0 or row.name not in self.upwards]

    def drawable(self, rows: Iterable[EffectRow]) -> list[EffectRow]:
        """Effects that this camera can show and the diagnosis can detect."""
        shown = [row for row in rows if row.applies_to(self.nominal)]
        return [row for row in shown if self.choices(row) or self.sides(row)]

    def choices(self, row: EffectRow) -> list[float]:
        """Detectable values of an effect of scale `choice`; empty for other scales."""
        neutral = row.neutral_of(self.nominal)
        detectable = self.limits.choices.get(row.name, row.choices)
        return [choice for choice in detectable if choice != neutral]

    def cycle(self, rows: list[EffectRow], count: int) -> list[EffectRow]:
        if count and not rows:
            raise refusal("cases", "must have effects to draw from", "none", "Leave out fewer.")
        out: list[EffectRow] = []
        while len(out) < count:
            out += [rows[i] for i in self.rng.permutation(len(rows))]
        return out[:count]

    def pair(self, rows: list[EffectRow]) -> tuple[EffectRow, EffectRow]:
        first = self.cycle(rows, 1)[0]
        others = [row for row in rows if self.family(row) != self.family(first)]
        return first, self.cycle(others, 1)[0]

    def strength(self, row: EffectRow) -> float:
        if row.scale == "choice":
            return float(self.rng.choice(self.choices(row)))
        sign = int(self.rng.choice(self.sides(row)))
        low, high = max(self.limits.least(row, sign), 1e-12), row.reach(self.nominal, sign)
        if self.beyond > 0.0 and self.rng.random() < self.beyond:
            farther = min(FARTHEST * high, row.beyond(FARTHEST).reach(self.nominal, sign))
            low, high = (high, farther) if farther > high else (low, high)
        departure = math.exp(self.rng.uniform(math.log(low), math.log(high)))
        departure = min(departure, high)  # Rounding must not cross a physical bound.
        return row.value(self.nominal, departure, sign)


def dumps(cases: Sequence[Case]) -> str:
    """Write cases as JSON text. `loads` reads equal cases from it."""
    tables = [dataclasses.asdict(case) for case in cases]
    for table in tables:
        if not table[_OPTIONAL]:
            del table[_OPTIONAL]
    return json.dumps(tables, indent=1) + "\n"


def loads(text: str) -> tuple[Case, ...]:
    """Read cases from JSON text.

    Raises:
        WithheldError: if the text is no JSON, lacks a key, or has an unknown effect.
    """
    cases = json_file.parse(text.encode(errors="replace"), "cases", "the text")
    if not isinstance(cases, list):
        raise refusal("cases", "must be a list", type(cases).__name__, _ADVICE)
    return tuple(map(_case, cases))


def _case(table: object) -> Case:
    names = {field.name for field in dataclasses.fields(Case)} - {_OPTIONAL}
    if not isinstance(table, dict) or table.keys() - {_OPTIONAL} != names:
        raise refusal("case", f"must have the keys {sorted(names)}", table, _ADVICE)
    for key in ("settings", _OPTIONAL):
        values = table.get(key, {})
        numbers = values.values() if isinstance(values, dict) else [None]
        if not all(isinstance(number, int | float) for number in numbers):
            raise refusal(key, "must be numbers by name", values, _ADVICE)
    if not (type(table["number"]) is int and type(table["seed"]) is int):
        raise refusal("case", "must have a whole number and seed", table, _ADVICE)
    if table["kind"] not in get_args(CaseKind):
        raise refusal("kind", f"must be one of {get_args(CaseKind)}", table["kind"], _ADVICE)
    return Case(**table)
