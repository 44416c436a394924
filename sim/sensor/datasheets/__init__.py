"""What vendors state of their cameras: one data sheet in TOML for each camera.

    [[figures]]
    figure = "minimum_distance_m"   # key of `figures.FIGURES`
    value = 0.195                   # or [low, high]
    mode = "848x480"                # image size; without it, the preset's own
    source = "D400 Series Datasheet 337029-017, table 4-11"

`distance_m` is the target's distance, and `target` is `plain` or `textured`. `settings` are the
sensor's fields that the vendor set for this figure, by dotted path. A sheet has the name of the
camera's preset.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from starling.patterns import errors
from starling.sim import files
from starling.sim.sensor import modes, presets, structure
from starling.sim.sensor.datasheets.figures import FIGURES, FigureKind

Target = Literal["plain", "textured"]
_FOLDER = Path(__file__).parent


@dataclass(frozen=True, kw_only=True, slots=True)
class StatedFigure:
    """One figure that a vendor states."""

    figure: str  # Key of `FIGURES`.
    value: tuple[float, ...]  # One value, or the low and high end of an interval.
    source: str
    mode: str = ""  # Image size; empty is that of the preset.
    distance_m: float | None = None  # Distance of the target [m].
    target: Target = "plain"
    settings: tuple[tuple[str, float], ...] = ()  # Values of the sensor's fields, by path.

    def __post_init__(self) -> None:
        errors.one_of("figure", self.figure, FIGURES)
        if len(self.value) not in (1, 2):
            rule = "must be a number or [low, high]"
            raise errors.refuse("value", rule, list(self.value), "Example: value = [63, 67].")
        low, high = self.kind.plausible
        for value in self.value:
            errors.in_interval("value", value, low, high, f"The unit is {self.kind.unit}.")
        if self.value[0] > self.value[-1]:
            raise errors.refuse("value", "must be [low, high]", list(self.value), "Swap them.")
        if not self.source:
            raise errors.refuse("source", "must name a document", "''", "Every figure has one.")
        if self.mode and not modes.NAME.fullmatch(self.mode):
            raise errors.refuse(
                "mode", "must be WIDTHxHEIGHT", repr(self.mode), "Example: 848x480."
            )
        if self.distance_m is not None:
            errors.in_interval("distance_m", self.distance_m, 0.05, 50.0, "Give metres.")
        if self.kind.at_distance != (self.distance_m is not None):
            rule = "must be given" if self.kind.at_distance else "must be left out"
            raise errors.refuse("distance_m", rule, self.distance_m, f"It is for {self.figure}.")

    @property
    def kind(self) -> FigureKind:
        """The figure's unit, and how the simulated value is judged."""
        return FIGURES[self.figure]

    @property
    def label(self) -> str:
        """Name of the figure with its conditions and unit."""
        conditions = [self.kind.label]
        conditions += [f"at {self.distance_m:g} m"] if self.distance_m is not None else []
        conditions += ["textured target"] if self.target == "textured" else []
        conditions += [f"mode {self.mode}"] if self.mode else []
        conditions += [f"{path.rpartition('.')[2]} {value:g}" for path, value in self.settings]
        return f"{', '.join(conditions)} [{self.kind.unit}]"


@dataclass(frozen=True, kw_only=True, slots=True)
class Datasheet:
    """The figures that a vendor states of one camera."""

    camera: str  # The vendor's name of it.
    figures: tuple[StatedFigure, ...]

    def __post_init__(self) -> None:
        if not self.figures:
            raise errors.refuse("figures", "must hold a figure", "none", "Add [[figures]].")
        labels = [figure.label for figure in self.figures]
        twice = next((label for label in labels if labels.count(label) > 1), None)
        if twice is not None:
            raise errors.refuse("figures", "must be stated once", twice, "Drop one.")


def names() -> list[str]:
    """List the presets that have a data sheet; a sheet without a preset is not listed."""
    return [name for name in presets.names() if (_FOLDER / f"{name}.toml").is_file()]


def load(name: str) -> Datasheet:
    """Load the data sheet of a preset.

    Raises:
        InputError: if no such preset has a data sheet; the message lists those that do.
    """
    errors.one_of("camera", name, names())
    return read(_FOLDER / f"{name}.toml")


def read(path: Path) -> Datasheet:
    """Read a data sheet.

    Raises:
        InputError: if the file is unreadable, no TOML, or states a figure that is refused.
    """
    return files.read_toml(path, _from_table)


def _from_table(table: Mapping[str, Any]) -> Datasheet:
    for key in table:
        errors.one_of("key", key, ("camera", "figures"))
    camera = errors.instance("camera", table.get("camera"), str, "Quote the vendor's name of it.")
    entries = errors.instance("figures", table.get("figures", []), list, "Write [[figures]].")
    figures = []
    for number, entry in enumerate(entries, 1):
        with errors.naming(f"figure {number}"):
            figures.append(structure.from_table(StatedFigure, _with_lists(entry)))
    return Datasheet(camera=camera, figures=tuple(figures))


def _with_lists(entry: Any) -> Any:
    """Return an entry whose single value is a list with this value, and its settings pairs."""
    if not isinstance(entry, Mapping):
        return entry
    lists = {}
    if errors.is_number(entry.get("value")):
        lists["value"] = [entry["value"]]
    if isinstance(entry.get("settings"), Mapping):
        lists["settings"] = [list(pair) for pair in entry["settings"].items()]
    return {**entry, **lists}
