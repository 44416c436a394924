"""Tables of stated and simulated figures: plain values, text, Markdown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from starling.sim.console import shell
from starling.sim.sensor.datasheets.figures import stated

if TYPE_CHECKING:
    from starling.sim.commands.check_sensors.check import CheckedCamera

_HEAD = "| figure | stated | simulated | result | source |\n|---|---|---|---|---|"
_DIGITS = 3  # Of simulated values.


def listed(cameras: Sequence[CheckedCamera]) -> dict[str, Any]:
    """Return cameras as plain values, by preset."""
    return {
        camera.preset: {
            "camera": camera.camera,
            "mode": camera.mode,
            "figures": [
                {
                    "figure": item.stated.label,
                    "stated": stated(item.stated.kind, item.stated.value),
                    "simulated": _rounded(item.simulated),
                    "our_value": _rounded(item.our_value),
                    "result": item.outcome,
                    "source": item.stated.source,
                }
                for item in camera.comparisons
            ],
        }
        for camera in cameras
    }


def text(cameras: Mapping[str, Any]) -> str:
    """Format the values of `listed` as aligned columns, a table for each camera."""
    return "\n\n".join(_block(preset, camera) for preset, camera in cameras.items())


def markdown(cameras: Sequence[CheckedCamera]) -> str:
    """Format cameras as Markdown, a table for each, with sources."""
    blocks = []
    for preset, camera in listed(cameras).items():
        rows = [
            f"| {' | '.join((row['figure'], row['stated'], _shown(row), row['result']))}"
            f" | {row['source']} |"
            for row in camera["figures"]
        ]
        heading = f"## {preset}: {camera['camera']}, {camera['mode']}"
        blocks.append("\n".join([heading, "", _HEAD, *rows]))
    return "\n\n".join(blocks) + "\n"


def _block(preset: str, camera: Mapping[str, Any]) -> str:
    rows = {
        row["figure"]: {
            "stated": row["stated"],
            "simulated": _shown(row),
            "result": row["result"],
        }
        for row in camera["figures"]
    }
    return f"{preset}: {camera['camera']}, {camera['mode']}\n{shell.render(rows)}"


def _shown(row: Mapping[str, Any]) -> str:
    """Format a simulated value; the value by our definition follows in parentheses."""
    if row["simulated"] is None:
        return "-"
    ours = "" if row["our_value"] is None else f" ({row['our_value']:g})"
    return f"{row['simulated']:g}{ours}"


def _rounded(value: float | None) -> float | None:
    """Round to three digits; NaN, which is no depth, becomes None as in JSON."""
    if value is None or value != value:
        return None
    return float(f"{value:.{_DIGITS}g}")
