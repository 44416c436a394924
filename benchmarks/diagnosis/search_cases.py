"""Development cases of the search for effects: rendered captures, and sums of changes."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

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
from starling.diagnosis.which.segment import Screening, restrict_to_families
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
