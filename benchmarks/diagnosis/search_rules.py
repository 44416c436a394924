r"""Measure the search for effects on development cases, and print a line for each case.

Rendered cases: the second camera implementation captures three development scenes. The imaging
segment is searched for effects of the images, the matching segment for depth filters. Sums: the
simulated responses of effects are added to a simulated capture, with a model error of each feature.
Sums need no further simulation. WORK caches light, captures and simulations.

Usage:
    python benchmarks/diagnosis/search_rules.py --work WORK [--rendered N] [--json FILE]
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from search_cases import CountingTable, draw_cases, make_light, screen_cases, sum_cases

from starling.diagnosis.validation.camera import nominal
from starling.diagnosis.validation.camera.catalogue import ROWS
from starling.diagnosis.validation.protocol.case import CaseKind
from starling.diagnosis.which.candidates import Segment
from starling.diagnosis.which.segment import Screening, diagnose_segment
from starling.sim.effects.effect import Value


@dataclass(frozen=True, kw_only=True, slots=True)
class Outcome:
    """Result of the search of one case."""

    kind: CaseKind
    truth: Mapping[str, Value]
    accepted: Mapping[str, Value]
    rivals: Mapping[str, Sequence[str]]
    unexplained: bool
    simulations: int
    seconds: float  # CPU time of the search; simulations count if they are not cached.

    @property
    def named(self) -> list[str]:
        """Named effects, by decreasing gain; empty if the gap stays unexplained."""
        return [] if self.unexplained else list(dict.fromkeys(map(effect_of, self.accepted)))

    @property
    def top(self) -> bool:
        """Whether the first effect is a true one; for other kinds, whether none is named."""
        if self.kind == "null":
            return not self.accepted and not self.unexplained
        if self.kind == "unknown":
            return self.unexplained
        return bool(self.named) and self.named[0] in self.truth

    @property
    def in_sets(self) -> bool:
        """Whether each true effect is in the set of another named effect."""
        if self.kind in ("null", "unknown"):
            return self.top
        sets = (
            []
            if self.unexplained
            else [
                {part for rival in (name, *self.rivals[name]) for part in (rival, effect_of(rival))}
                for name in self.accepted
            ]
        )
        return _matched(list(self.truth), sets)

    @property
    def false(self) -> list[str]:
        """Named effects that are not true."""
        return [name for name in self.named if name not in self.truth]

    @property
    def rival_count(self) -> int:
        """Number of rivals of the named effects."""
        return 0 if self.unexplained else sum(map(len, self.rivals.values()))

    def error_pct(self, camera: nominal.Nominal) -> float | None:
        """Compute the mean error of the strengths of named true effects [%]; None without one."""
        errors = []
        for name, true in self.truth.items():
            row, value = ROWS.get(name), self.accepted.get(name)
            if self.unexplained or value is None or row is None or row.scale == "choice":
                continue
            assert not isinstance(value, str) and not isinstance(true, str)
            departure = row.departure(camera, true)
            errors.append(abs(row.departure(camera, value) - departure) / departure)
        return 100 * float(np.mean(errors)) if errors else None


def effect_of(name: str) -> str:
    """Return the effect of a candidate `EFFECT` or `EFFECT.PARAMETER`."""
    return name.partition(".")[0]


def _matched(truth: Sequence[str], sets: Sequence[set[str]]) -> bool:
    """Whether different sets hold the true effects."""
    if not truth:
        return True
    return any(
        _matched(truth[1:], [*sets[:number], *sets[number + 1 :]])
        for number, names in enumerate(sets)
        if truth[0] in names
    )


def main() -> None:
    """Run all cases and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--rendered", type=int, help="number of rendered cases; default: all")
    parser.add_argument("--json", type=Path, help="file for the results of all cases")
    options = parser.parse_args()
    light = make_light(options.work)
    believed = nominal.read(light / nominal.FILE)
    rendered = list(
        itertools.islice(screen_cases(options.work, light, draw_cases(believed)), options.rendered)
    )
    sums = sum_cases(*rendered[0][2:])
    outcomes = []
    for label, cases in (("rendered", rendered), ("sums", sums)):
        group = []
        for case in cases:
            group.append(outcome(*case))
            print(line(group[-1], believed), flush=True)
        print(f"{label}:\n{summary(group, believed)}", flush=True)
        outcomes += group
    if options.json:
        options.json.write_text(json.dumps([_entry(item) for item in outcomes], indent=1) + "\n")


def outcome(
    truth: Mapping[str, Value], kind: CaseKind, table: CountingTable, screening: Screening
) -> Outcome:
    """Search the effects of one case."""
    started = time.process_time()
    result = diagnose_segment(table, screening)
    seconds = time.process_time() - started
    post = table.segment is Segment.DEPTH
    accepted = sorted(result.search.accepted, key=lambda effect: -effect.fit.total)
    return Outcome(
        kind=kind,
        truth={
            name: value
            for name, value in truth.items()
            if post or name not in ROWS or ROWS[name].kind != "post"
        },
        accepted={effect.fit.name: effect.fit.value for effect in accepted},
        rivals={effect.fit.name: [fit.name for fit in effect.rivals] for effect in accepted},
        unexplained=result.unexplained,
        simulations=len(table.simulated),
        seconds=seconds,
    )


def line(result: Outcome, believed: nominal.Nominal) -> str:
    """Write the outcome of one case as a line."""
    error = result.error_pct(believed)
    return " ".join(
        [
            f"{result.kind:8}",
            f"top {int(result.top)} set {int(result.in_sets)} false {len(result.false)}",
            f"rivals {result.rival_count:2}",
            "error     -" if error is None else f"error {error:5.1f}",
            f"simulations {result.simulations:3} {result.seconds:6.1f} s",
            f"true {_settings(result.truth)}; accepted {_settings(result.accepted)}",
            "unexplained" if result.unexplained else "",
        ]
    ).rstrip()


def _settings(settings: Mapping[str, Value]) -> str:
    return " ".join(
        f"{name}={value}" if isinstance(value, str) else f"{name}={value:.4g}"
        for name, value in settings.items()
    )


def summary(outcomes: Sequence[Outcome], believed: nominal.Nominal) -> str:
    """Write sums over the cases of each kind, and over all cases."""
    lines = []
    kinds = [*dict.fromkeys(item.kind for item in outcomes), "all"]
    for kind in kinds:
        group = [item for item in outcomes if kind in (item.kind, "all")]
        errors = [error for item in group if (error := item.error_pct(believed)) is not None]
        lines.append(
            f"{kind:8} cases {len(group):2} top {sum(item.top for item in group):2}"
            f" set {sum(item.in_sets for item in group):2}"
            f" false {sum(len(item.false) for item in group):2}"
            f" rivals {sum(item.rival_count for item in group):3}"
            f" error {np.median(errors) if errors else math.nan:5.2f}"
            f" simulations {sum(item.simulations for item in group):4}"
            f" {sum(item.seconds for item in group):6.1f} s"
        )
    return "\n".join(lines)


def _entry(result: Outcome) -> dict[str, Any]:
    return {
        "kind": result.kind,
        "truth": dict(result.truth),
        "accepted": dict(result.accepted),
        "rivals": {name: list(rivals) for name, rivals in result.rivals.items()},
        "unexplained": result.unexplained,
        "simulations": result.simulations,
        "seconds": round(result.seconds, 2),
    }


if __name__ == "__main__":
    main()
