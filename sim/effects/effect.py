"""Types of the effect table."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

Value = float | str  # Value of a parameter: a number, or one of its choices.


def written(value: Value) -> str:
    """Format a value without redundant digits: `8`, `0.25`, `left`."""
    return value if isinstance(value, str) else f"{value:g}"


class Stage(Enum):
    """Pipeline stage at which an effect acts, in the order of the pipeline."""

    SCENE = "scene"
    LIGHT = "light"
    OPTICS = "optics"
    IMAGER = "imager"
    MATCHER = "matcher"
    POST = "post"


@dataclass(frozen=True, kw_only=True, slots=True)
class Parameter:
    """One number (or choice) of an effect."""

    name: str
    # Dotted paths of the fields that it sets. `imager.` means both imagers, `scene.` the scene;
    # `.x`, `.y`, `.z` are components of a vector.
    paths: tuple[str, ...]
    unit: str  # "1" for a dimensionless number.
    neutral: Value | None  # Ideal value; None if there is none and the sensor's value is neutral.
    low: float | None = None  # Least useful value; None for choices.
    high: float | None = None  # Greatest useful value; None for choices.
    choices: tuple[Value, ...] = ()  # All possible values; empty for a continuous parameter.


@dataclass(frozen=True, kw_only=True, slots=True)
class Effect:
    """A named departure from an ideal camera: the fields that it sets, and its symptoms."""

    name: str
    family: str  # Shared by rows that describe one physical cause.
    stage: Stage
    parameters: tuple[Parameter, ...]
    imitates: str  # Cause in a real device.
    law: str  # Formula of the model.
    shows: str  # Symptoms in infrared, disparity error, holes and time.
    confused_with: tuple[str, ...]  # Names of confusable effects.
    source: str
    rerender: str = ""  # Reason for a new render; empty if the rendered layers are reused.
    drawn: bool = False  # Whether the effect is a random draw per device or per exposure.
