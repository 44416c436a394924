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
import dataclasses
import hashlib
import itertools
import json
import math
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from starling.diagnosis.scenes.request import CAPTURED, Request
from starling.diagnosis.scenes.scene_model import SceneModel, load_scene_model, with_capture
from starling.diagnosis.validation.adapters import light_sets, own_depth
from starling.diagnosis.validation.adapters.cameras import builtin_camera
from starling.diagnosis.validation.camera import nominal
from starling.diagnosis.validation.camera.catalogue import ROWS
from starling.diagnosis.validation.protocol import limits, shoot
from starling.diagnosis.validation.protocol.case import Case, CaseKind, draw
from starling.diagnosis.which.attribution import screen_segment
from starling.diagnosis.which.candidates import Segment
from starling.diagnosis.which.null import leave_one_out
from starling.diagnosis.which.response import PredictedChange, Signature
from starling.diagnosis.which.segment import Screening, diagnose_segment, restrict_to_families
from starling.diagnosis.which.table import FeatureTable, Row, Rows
from starling.sim import effects
from starling.sim.captures import capture
from starling.sim.effects.effect import Value

SCENES = ("clutter:7100", "clutter:7101", "clutter:7102")
DEVICE = 200  # Number of the device that simulated captures are of.
SIZE = (320, 180)  # Width and height [px].
FRAMES = 1  # Frames per scene.
ENTROPY = 5  # Seed of the drawn cases.
COUNTS: dict[CaseKind, int] = {"null": 2, "single": 11, "pair": 6, "unknown": 3}
# Families that need no new matching search, so that a case takes seconds.
DEPTH_FAMILIES = (
    "quantisation",
    "uniqueness",
    "left_right",
    "overlap_border",
    "texture",
    "edge_jump",
    "speckle_filter",
    "winner_median",
    "disparity_smoothing",
    "disparity_quantisation",
    "pixel_locking",
    "range",
    "spatial_filter",
    "hole_filling",
    "depth_unit",
)
INTERACTING = (
    {"second_projector": 0.5, "lens_blur": 1.0},
    {"range": 0.5, "hole_filling": 1.0},
    {"speckle_filter": 300.0, "hole_filling": 2.0},
    {"exposure": 0.02, "saturation": 4000.0},
    {"ambient": 2.0, "vignetting": 2.0},
)
# The second implementation lacks parameters that do nothing alone; the simulator captures these.
SIMULATED = (
    {"second_projector": 0.5, "second_projector.x": -0.3},
    {"near_defocus": 0.5, "near_defocus.focus_m": 5.0},
)

SUMS: tuple[tuple[CaseKind, int, int], ...] = (  # Kind, number of effects, number of cases.
    ("pair", 2, 14),
    ("pair", 3, 6),
    ("single", 1, 6),
    ("unknown", 1, 4),
    ("null", 0, 2),
)
MODEL_ERROR = 0.1  # Model error of a feature in a sum, as a share of its change.
LEAST_DEPARTURE = 0.3  # Least departure from the base in a sum, in positions of the signature.


@dataclass(frozen=True, eq=False)
class CountingTable(FeatureTable):
    """Feature table that records which settings the search simulates."""

    simulated: set[str] = field(default_factory=set)
    captured: Rows | None = None  # Features in place of those of the captures.

    def rows(self, request: Request) -> Rows:
        """Compute the features of all scenes, or return those in place of the captures'."""
        if request == CAPTURED and self.captured is not None:
            return self.captured
        return super().rows(request)

    def change(self, settings: Mapping[str, Value]) -> Rows | None:
        """Compute the change by effects, and record the settings."""
        self.simulated.add(repr(sorted(settings.items())))
        return super().change(settings)


@dataclass(frozen=True, eq=False)
class SumTable(CountingTable):
    """Feature table in which effects act by their signatures and do not interact."""

    signatures: Mapping[str, Signature] = field(default_factory=dict)

    def change(self, settings: Mapping[str, Value]) -> Rows | None:
        """Add the changes by single effects, and record the settings."""
        self.simulated.add(repr(sorted(settings.items())))
        assert self.captured is not None
        changes = [self._change(name, value).change for name, value in settings.items()]
        return np.sum([np.zeros_like(self.captured), *changes], axis=0)

    def scatter(self, settings: Mapping[str, Value]) -> Row | None:
        """Interpolate the standard deviation of one device's change."""
        ((name, value),) = settings.items()
        if self.signatures[name].scatter is None:
            return None
        return np.sqrt(np.asarray(self._change(name, value).scatter))

    def _change(self, name: str, value: Value) -> PredictedChange:
        signature = self.signatures[name]
        if not signature.candidate.numeric:
            return signature.change_at(signature.values.index(value))
        values = np.array(signature.values, float)
        return signature.change_at(float(np.interp(float(value), values, range(len(values)))))


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


def make_light(work: Path) -> Path:
    """Render the scenes once."""
    light = work / "light"
    if not light.exists():
        light_sets.write(light, SCENES, builtin_camera(*SIZE))
    return light


def draw_cases(believed: nominal.Nominal) -> list[Case]:
    """Draw the cases, and add interacting effects."""
    families = {effect.name: effect.family for effect in effects.table()}
    drawn = draw(
        believed,
        COUNTS,
        families=families,
        limits=limits.read(),
        kinds=("image", "post"),
        entropy=ENTROPY,
    )
    count = len(drawn)
    kinds: list[CaseKind] = ["single" if len(item) == 1 else "pair" for item in INTERACTING]
    return [
        *(
            Case(number=count + number, kind=kind, settings=settings, seed=count + number)
            for number, (kind, settings) in enumerate(zip(kinds, INTERACTING, strict=True))
        ),
        *drawn,
    ]


def screen_cases(
    work: Path, light: Path, cases: Sequence[Case]
) -> Iterator[tuple[Mapping[str, Value], CaseKind, CountingTable, Screening]]:
    """Capture each case, and screen the segment that its effects act on."""
    models: list[SceneModel] = []
    screened: tuple[FeatureTable, Screening] | None = None
    for case in cases:
        captures = make_captures(work, light, case)
        scenes = capture.open_set(captures).scenes
        if models:
            models = [
                with_capture(model, scene, against=None)
                for model, scene in zip(models, scenes, strict=True)
            ]
        else:
            sensor = builtin_camera(*SIZE)
            models = [load_scene_model(scene, sensor) for scene in scenes]
        if case.settings and all(ROWS[name].kind == "post" for name in case.settings):
            table, screening = screen_segment(
                Segment.DEPTH, models, families=DEPTH_FAMILIES, cache=work / "cache"
            )
            yield case.settings, case.kind, counting(table), screening
            continue
        if screened is None:
            screened = screen_segment(Segment.IMAGE, models, cache=work / "cache")
            table, screening = screened
            for truth in SIMULATED:
                captured = table.rows(table.request(truth, seed=DEVICE, device=DEVICE))
                yield truth, "pair", counting(table, captured), screening
        table, screening = screened
        yield case.settings, case.kind, counting(table.with_captures(models)), screening


def counting(table: FeatureTable, captured: Rows | None = None) -> CountingTable:
    """Return a table of the same scenes that counts simulations."""
    return CountingTable(table.scene_models, table.columns, table.cache, captured=captured)


def sum_cases(
    table: FeatureTable, screening: Screening
) -> list[tuple[Mapping[str, Value], CaseKind, CountingTable, Screening]]:
    """Draw effects of different families at random strengths, and add their changes.

    An unknown effect is one whose family is not searched.
    """
    rng = np.random.default_rng(0)
    signatures = {signature.name: signature for signature in screening.signatures}
    families = {name: item.candidate.effect.family for name, item in signatures.items()}
    names = [name for name in signatures if name in ROWS]
    samples = leave_one_out(screening.base)
    cases = []
    for kind, effect_count, case_count in SUMS:
        for _ in range(case_count):
            chosen: list[str] = []
            while len({families[name] for name in chosen}) < effect_count or not chosen:
                chosen = list(map(str, rng.choice(names, effect_count, replace=False)))
                if not effect_count:
                    break
            base, captured = samples[int(rng.integers(len(samples)))]
            truth: dict[str, Value] = {}
            for name in chosen:
                place = draw_place(signatures[name], rng)
                truth[name] = signatures[name].value(place)
                change = signatures[name].change_at(place).change
                error = MODEL_ERROR * rng.standard_normal(change.shape[-1])
                captured = captured + change * (1 + error)
            tried = dataclasses.replace(screening, base=base)
            if kind == "unknown":
                tried = restrict_to_families(tried, set(families.values()) - {families[chosen[0]]})
            added = SumTable(
                table.scene_models, table.columns, captured=captured, signatures=signatures
            )
            cases.append((truth, kind, added, tried))
    return cases


def draw_place(signature: Signature, rng: np.random.Generator) -> float:
    """Draw a position of a signature away from the base."""
    last, base = len(signature.values) - 1, signature.values.index(signature.candidate.base)
    while True:
        numeric = signature.candidate.numeric
        place = float(rng.uniform(0, last) if numeric else rng.integers(0, last + 1))
        if abs(place - base) > LEAST_DEPARTURE:
            return place


def make_captures(work: Path, light: Path, case: Case) -> Path:
    """Capture a case with the second camera implementation, matched by our matcher."""
    name = hashlib.sha256(repr((case.settings, case.seed)).encode()).hexdigest()[:16]
    captures = work / "cases" / name / "set"
    if not captures.exists():
        temporary = captures.with_name("part")
        shoot.shoot(light, case, temporary, frames=FRAMES)
        own_depth.write(temporary.parent, builtin_camera(*SIZE))
        shoot.postprocess(temporary, case, nominal.read(light / nominal.FILE))
        temporary.rename(captures)
    return captures


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
