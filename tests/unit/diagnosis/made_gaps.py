"""Constructed effects on constructed features, and gaps that they make."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace
from typing import Any

import numpy as np

from starling.diagnosis.which import null, search
from starling.diagnosis.which.candidates import Candidate, Segment
from starling.diagnosis.which.fit import fit, room_folds
from starling.diagnosis.which.likelihood import Likelihood
from starling.diagnosis.which.model import SearchContext
from starling.diagnosis.which.null import BaseSamples
from starling.diagnosis.which.response import Signature
from starling.diagnosis.which.segment import Screening
from starling.sim import effects

SCENES, FEATURES, SEEDS = 8, 40, 6
ROOMS = [str(scene) for scene in range(SCENES)]
FOLDS = room_folds(ROOMS)
NAMES = ("lens_blur", "veil", "crosstalk", "read_noise")


ONES = np.ones(FEATURES)
VALUES = (0.0, 0.2, 0.5, 1.0)


def candidate(name: str) -> Candidate:
    return Candidate(
        name=name, effect=effects.named(name), segment=Segment.IMAGE, base=0.0, nodes=VALUES[1:]
    )


def signature(name: str, seed: int) -> Signature:
    """Return an effect that grows with the root of its strength and varies between scenes."""
    rng = np.random.default_rng(seed)
    direction = rng.standard_normal(FEATURES) * (rng.random(FEATURES) < 0.5)
    scenes = direction * (1 + 0.2 * rng.standard_normal((SCENES, 1)))
    change = np.stack([np.sqrt(value) * scenes for value in VALUES])
    return Signature(candidate(name), VALUES, change)


EFFECTS = {name: signature(name, number) for number, name in enumerate(NAMES)}
SIGNATURES = list(EFFECTS.values())


def noise(seed: int) -> np.ndarray:
    return 0.05 * np.random.default_rng(seed).standard_normal((SCENES, FEATURES))


BASE = BaseSamples(
    np.stack([noise(100 + seed) for seed in range(SEEDS)]), np.full((SCENES, FEATURES), null.FLOOR)
)


class FakeTable:
    """A feature table that adds signatures; `together` is the interaction of several effects."""

    scene_models: Any = tuple(SimpleNamespace(name=room, room=room, estimates=()) for room in ROOMS)
    compared = False

    def __init__(self, signatures: dict[str, Signature] = EFFECTS, together: float = 0.0) -> None:
        self.signatures = signatures
        self.together = together

    def prefetch(self, settings: dict[str, Any]) -> None:
        """Do nothing: no simulation takes long."""

    def change(self, settings: dict[str, Any]) -> np.ndarray | None:
        if settings.get("veil", 0) > 0.8 and "crosstalk" in settings:
            return None
        rows = np.zeros((SCENES, FEATURES))
        for name, value in settings.items():
            effect = self.signatures[name]
            rows += effect.change_at(float(np.interp(value, VALUES, range(len(VALUES))))).change
        return rows + self.together * (len(settings) > 1)

    def scatter(self, settings: dict[str, Any]) -> None:
        return None


def context(table: Any, likelihood: Likelihood, *, explained_below: float = 0.0) -> SearchContext:
    return SearchContext(
        table=table,
        likelihood=likelihood,
        folds=FOLDS,
        threshold=null.LEAST_GAIN,
        explained_below=explained_below,
    )


def screening(
    *signatures: Signature, weight: np.ndarray = ONES, threshold: float = 12.0, noise: float = 1.0
) -> Screening:
    return Screening(
        base=BASE,
        signatures=signatures,
        weight=weight,
        folds=tuple(FOLDS),
        threshold=threshold,
        noise=noise,
    )


def capture(settings: dict[str, float], seed: int, table: FakeTable | None = None) -> np.ndarray:
    change = (table or FakeTable()).change(settings)
    assert change is not None
    return change + noise(seed)


def likelihood_of(settings: dict[str, float], seed: int, **options: Any) -> Likelihood:
    return BASE.likelihood(capture(settings, seed, **options), ONES)


class WithPartner(FakeTable):
    """An effect with a second parameter that changes its direction, and does nothing alone."""

    def change(self, settings: dict[str, Any]) -> np.ndarray | None:
        rest = {name: value for name, value in settings.items() if name != "second_projector.x"}
        rows = super().change(rest)
        assert rows is not None
        if "second_projector" in settings and "second_projector.x" in settings:
            shift = EFFECTS["crosstalk"].change[-1]
            rows = rows + settings["second_projector.x"] * shift * settings["second_projector"]
        return rows


PARTNERED = effects.named("second_projector")  # Acts as `veil`; its position adds `crosstalk`.
POWER = dataclasses.replace(
    EFFECTS["veil"],
    candidate=dataclasses.replace(candidate("veil"), name=PARTNERED.name, effect=PARTNERED),
)
POSITION = Signature(
    Candidate(
        name="second_projector.x",
        effect=PARTNERED,
        segment=Segment.IMAGE,
        base=0.0,
        nodes=(-0.5, 0.25, 0.5),
    ),
    (-0.5, 0.0, 0.25, 0.5),
    np.zeros((4, SCENES, FEATURES)),
)
SECOND_PROJECTOR = WithPartner({**EFFECTS, PARTNERED.name: POWER})


def run_search(
    settings: dict[str, float], *, table: FakeTable | None = None, names: tuple[str, ...] = NAMES
) -> search.SearchResult:
    table = table or FakeTable()
    likelihood = likelihood_of(settings, 9, table=table)
    fits = [fit(table.signatures[name], likelihood, FOLDS) for name in names]
    return search.search_effects(context(table, likelihood), fits, [])
