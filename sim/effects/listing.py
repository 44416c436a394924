"""The effect table as plain values and as text."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

from starling.sim import effects
from starling.sim.console import shell
from starling.sim.effects import Effect, Parameter, setting, written
from starling.sim.sensor.sensor import Sensor

_PROSE = ("imitates", "law", "shows", "confused_with", "source", "rerender")
_WIDTH = 100


def rows(sensor: Sensor, name: str = "") -> list[dict[str, Any]]:
    """Return the whole table, or one row of it, as plain values.

    Args:
        sensor: supplies the current value of each parameter. It is also the neutral value of
            parameters without an ideal value.
        name: name of the row; empty returns all rows.

    Returns:
        `[{"name", "family", "stage", "rerender", "parameters": [{"name", "neutral", "value",
        "low", "high", "unit", "choices", "paths"}], "imitates", "law", "shows", "confused_with",
        "source"}]`.

    Raises:
        InputError: if the effect is unknown.
    """
    chosen = (effects.named(name),) if name else effects.table()
    return [_row(effect, sensor) for effect in chosen]


def text(table: Sequence[Mapping[str, Any]]) -> str:
    """Format the table as aligned columns, one line per parameter."""
    lines = {}
    for row in table:
        for number, parameter in enumerate(row["parameters"]):
            name = row["name"] if number == 0 else f"{row['name']}.{parameter['name']}"
            lines[name] = {
                "family": row["family"],
                "stage": row["stage"],
                "neutral": parameter["neutral"],
                "sensor": parameter["value"],
                "range": _range(parameter),
                "unit": parameter["unit"],
                "new render": "yes" if row["rerender"] else "",
            }
    return shell.render(lines)


def page(table: Sequence[Mapping[str, Any]]) -> str:
    """Format rows with all their entries."""
    return "\n\n".join(_page(row) for row in table)


def _row(effect: Effect, sensor: Sensor) -> dict[str, Any]:
    return {
        "name": effect.name,
        "family": effect.family,
        "stage": effect.stage.value,
        "rerender": effect.rerender,
        "parameters": [_parameter(parameter, sensor) for parameter in effect.parameters],
        **{name: getattr(effect, name) for name in _PROSE if name != "rerender"},
    }


def _parameter(parameter: Parameter, sensor: Sensor) -> dict[str, Any]:
    return {
        "name": parameter.name,
        "neutral": setting.neutral(parameter, sensor),
        "value": setting.value(parameter, sensor),  # None: not of this sensor.
        "low": parameter.low,
        "high": parameter.high,
        "unit": parameter.unit,
        "choices": list(parameter.choices),
        "paths": list(parameter.paths),
    }


def _range(parameter: Mapping[str, Any]) -> str:
    if parameter["choices"]:
        return ", ".join(map(written, parameter["choices"]))
    return f"{parameter['low']:g} to {parameter['high']:g}"


def _page(row: Mapping[str, Any]) -> str:
    lines = [f"{row['name']}  ({row['stage']}, family {row['family']})"]
    for parameter in row["parameters"]:
        base, value = (
            "-" if parameter[key] is None else written(parameter[key])
            for key in ("neutral", "value")
        )
        lines.append(
            f"  {parameter['name']}: {_range(parameter)} {parameter['unit']}, "
            f"neutral {base}, in the sensor {value}, sets {', '.join(parameter['paths'])}"
        )
    for name in _PROSE:
        entry = row[name] if isinstance(row[name], str) else ", ".join(row[name])
        if entry:
            lines += textwrap.wrap(
                f"{name.replace('_', ' ')}: {entry}", _WIDTH, subsequent_indent="  "
            )
    return "\n".join(lines)
