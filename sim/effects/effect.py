"""What a row of the effect table is."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

Value = float | str  # Of a parameter: a number, or one of its words.


def written(value: Value) -> str:
    """Write a value without digits that say nothing: `8`, `0.25`, `left`."""
    return value if isinstance(value, str) else f"{value:g}"


class Stage(Enum):
    """Where an effect acts, in the order of the chain."""

    SCENE = "scene"
    LIGHT = "light"
    OPTICS = "optics"
    IMAGER = "imager"
    MATCHER = "matcher"
    POST = "post"


@dataclass(frozen=True, kw_only=True, slots=True)
class Parameter:
    """One number (or word) that an effect moves."""

    name: str
    # Fields it sets, dotted: of the sensor (`imager.` is both imagers; `.x`, `.y`, `.z` a
    # component), or of the scene (`scene.` first).
    paths: tuple[str, ...]
    unit: str  # "1" for a plain number.
    neutral: Value | None  # None: there is no ideal, the value of the sensor at hand is neutral.
    low: float | None = None  # Least and greatest value worth trying; None where words are.
    high: float | None = None
    choices: tuple[Value, ...] = ()  # All it may be, where that is not any number in between.


@dataclass(frozen=True, kw_only=True, slots=True)
class Effect:
    """A named departure from an ideal camera: which fields it moves, and what gives it away."""

    name: str
    family: str  # Rows that are one thing under several names share it.
    stage: Stage
    parameters: tuple[Parameter, ...]
    imitates: str  # What happens in a real device.
    law: str  # Formula.
    shows: str  # What gives it away: infrared, disparity error, holes, time.
    confused_with: tuple[str, ...]  # Names of rows that look alike.
    source: str
    rerender: str = ""  # Why a new render is needed; empty: the layers stay.
    drawn: bool = False  # Whether devices, or exposures, have each their own by lot.
