"""The published depth presets of the D400 family, by name."""

from __future__ import annotations

import tomllib
from functools import cache
from pathlib import Path

from starling.patterns import errors
from starling.sim.sensor.realsense import controls
from starling.sim.sensor.realsense.controls import Control

DEFAULT = "default"  # Preset that an unchanged sensor represents.


def names() -> list[str]:
    """List the presets, the device's default first."""
    return list(_tables())


def named(name: str) -> dict[str, Control]:
    """Return a preset's values by control.

    Raises:
        InputError: for an unknown preset; the message lists the known ones, nearest first.
    """
    errors.one_of("device preset", name, _tables())
    return dict(_tables()[name])


@cache
def _tables() -> dict[str, dict[str, Control]]:
    text = Path(__file__).with_name("presets.toml").read_text(encoding="utf-8")
    return {name: controls.canonical(t.items()) for name, t in tomllib.loads(text).items()}
