"""Effects on made-up features, gaps that are made of them, and what they are tried on."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace
from typing import Any

import numpy as np

from starling.diagnosis.which import null, search
from starling.diagnosis.which.candidates import Arm, Candidate
from starling.diagnosis.which.fit import fit, folds
from starling.diagnosis.which.likelihood import Likelihood
from starling.diagnosis.which.null import Base
from starling.diagnosis.which.response import Signature
from starling.diagnosis.which.segment import Screen
from starling.diagnosis.which.trial import Trial
from starling.sim import effects

SCENES, FEATURES, SEEDS = 8, 40, 6
ROOMS = [str(scene) for scene in range(SCENES)]
HELD = folds(ROOMS)
NAMES = ("lens_blur", "veil", "crosstalk", "read_noise")


ONES = np.ones(FEATURES)
VALUES = (0.0, 0.2, 0.5, 1.0)


def candidate(name: str) -> Candidate:
    return Candidate(
        name=name, effect=effects.named(name), arm=Arm.IMAGE, base=0.0, nodes=VALUES[1:]
    )


def signature(name: str, seed: int) -> Signature:
    """An effect that grows with its strength, bent, and differs a little from scene to scene."""
    rng = np.random.default_rng(seed)
    direction = rng.standard_normal(FEATURES) * (rng.random(FEATURES) < 0.5)
    scenes = direction * (1 + 0.2 * rng.standard_normal((SCENES, 1)))
    change = np.stack([np.sqrt(value) * scenes for value in VALUES])
    return Signature(candidate(name), VALUES, change)


MADE = {name: signature(name, number) for number, name in enumerate(NAMES)}
SIGNATURES = list(MADE.values())


def noise(seed: int) -> np.ndarray:
    return 0.05 * np.random.default_rng(seed).standard_normal((SCENES, FEATURES))


BASE = Base(
    np.stack([noise(100 + seed) for seed in range(SEEDS)]), np.full((SCENES, FEATURES), null.FLOOR)
)


class FakeBench:
    """Simulates by adding signatures, and what two effects make only together."""

    subjects: Any = tuple(SimpleNamespace(name=room, room=room) for room in ROOMS)

    def __init__(self, made: dict[str, Signature] = MADE, together: float = 0.0) -> None:
        self.made = made
        self.together = together

    def begin(self, settings: dict[str, Any]) -> None:
        """It is asked for nothing that takes long."""

    def change(self, settings: dict[str, Any]) -> np.ndarray | None:
        if settings.get("veil", 0) > 0.8 and "crosstalk" in settings:
            return None
        table = np.zeros((SCENES, FEATURES))
        for name, value in settings.items():
            one = self.made[name]
            table += one.at(float(np.interp(value, VALUES, range(len(VALUES))))).change
        return table + self.together * (len(settings) > 1)

    def scatter(self, settings: dict[str, Any]) -> None:
        return None


def trial(bench: Any, likelihood: Likelihood, *, explained_below: float = 0.0) -> Trial:
    return Trial(
        bench=bench,
        likelihood=likelihood,
        folds=HELD,
        threshold=null.LEAST_GAIN,
        explained_below=explained_below,
    )


def screen(
    *rough: Signature, weight: np.ndarray = ONES, threshold: float = 12.0, noise: float = 1.0
) -> Screen:
    return Screen(
        base=BASE,
        rough=rough,
        weight=weight,
        folds=tuple(HELD),
        threshold=threshold,
        noise=noise,
    )


def reading(settings: dict[str, float], seed: int, bench: FakeBench | None = None) -> np.ndarray:
    change = (bench or FakeBench()).change(settings)
    assert change is not None
    return change + noise(seed)


def likelihood_of(settings: dict[str, float], seed: int, **others: Any) -> Likelihood:
    return BASE.likelihood(reading(settings, seed, **others), ONES)


class WithPartner(FakeBench):
    """An effect whose second number moves what it makes, and alone nothing."""

    def change(self, settings: dict[str, Any]) -> np.ndarray | None:
        rest = {name: value for name, value in settings.items() if name != "second_projector.x"}
        table = super().change(rest)
        assert table is not None
        if "second_projector" in settings and "second_projector.x" in settings:
            moved = MADE["crosstalk"].change[-1]
            table = table + settings["second_projector.x"] * moved * settings["second_projector"]
        return table


PARTNERED = effects.named("second_projector")  # Shines like a veil; where it stands moves that.
SHINES = dataclasses.replace(
    MADE["veil"],
    candidate=dataclasses.replace(candidate("veil"), name=PARTNERED.name, effect=PARTNERED),
)
IDLE = Signature(
    Candidate(
        name="second_projector.x",
        effect=PARTNERED,
        arm=Arm.IMAGE,
        base=0.0,
        nodes=(-0.5, 0.25, 0.5),
    ),
    (-0.5, 0.0, 0.25, 0.5),
    np.zeros((4, SCENES, FEATURES)),
)
SHINING = WithPartner({**MADE, PARTNERED.name: SHINES})


def searched(
    settings: dict[str, float], *, bench: FakeBench | None = None, names: tuple[str, ...] = NAMES
) -> search.Search:
    bench = bench or FakeBench()
    likelihood = likelihood_of(settings, 9, bench=bench)
    closer = [fit(bench.made[name], likelihood, HELD) for name in names]
    return search.search(trial(bench, likelihood), closer, [])
