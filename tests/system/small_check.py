"""A small validation: few scenes and effects, tiny images, and strong effects."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from pathlib import Path

import pytest

from starling.diagnosis.validation.adapters import __main__ as adapters
from starling.diagnosis.validation.adapters import cameras
from starling.diagnosis.validation.camera import catalogue
from starling.diagnosis.validation.protocol import case, limits, programs, tier
from starling.diagnosis.validation.protocol.case import Case
from starling.diagnosis.validation.protocol.check import Check
from starling.diagnosis.validation.protocol.real_pairs import RealPairs
from starling.diagnosis.validation.protocol.rendered import Rendered
from starling.diagnosis.which import attribution
from starling.diagnosis.which.candidates import candidates as all_candidates

RUN = programs._run
SHOWN: list[tuple[Path, bytes]] = []  # All files except pictures that a diagnosis could read.

TRIED = ("gamma", "vignetting", "read_noise", "black_level", "median", "pixel_locking")
STRONG = {
    "gamma": 0.2,
    "vignetting": 1.5,
    "read_noise": 20.0,
    "black_level": 4.0,
    "pixel_locking": 0.08,
}
SMALL = tier.Tier(
    number=1,
    source="starling",
    matcher="starling",
    first_scene=60,
    sets=2,
    scenes=4,
    width=160,
    height=90,
    counts={"single": 10, "null": 6, "pair": 2, "unknown": 4},
    left_out=2,
)
TINY = dataclasses.replace(
    SMALL, counts={"single": 2, "null": 2, "pair": 1, "unknown": 1}, left_out=1
)
NEUTRAL = {
    "gamma": 1.0,
    "vignetting": 0.0,
    "read_noise": 5.0,
    "black_level": 4.0,
    "pixel_locking": 0.0,
}


def diagnosed(size: tier.Tier, folder: Path, patch: pytest.MonkeyPatch) -> tuple[Check, list[Case]]:
    """Prepare and diagnose the cases of a tier."""
    _limit_effects(patch)
    path = folder / "limits.json"
    departures = {
        name: {"base": NEUTRAL[name], "below": None, "above": value}
        for name, value in _values().items()
    }
    path.write_text(json.dumps({**departures, "median": {"found": [3, 5]}}))
    patch.setattr(limits, "FILE", path)
    check = Check(out=folder / "run", tier=size, blender=Path("none"), jobs=1)
    cases = check.prepare()
    check.diagnose(cases)
    return check, list(cases)


def _values() -> dict[str, float]:
    """Return the values of effects that are strong enough to be detected."""
    return {name: NEUTRAL[name] + STRONG[name] for name in STRONG}


def _limit_effects(patch: pytest.MonkeyPatch) -> None:
    """Limit both effect tables to few effects, and run the programs in this process.

    Random numbers are fixed, because a false positive would fail a run by chance. The lens has no
    blur: its shape differs in the second implementation. With so few pixels and effects, that
    would be a gap.
    """
    random_generator = case.random_generator
    patch.setattr(
        case,
        "random_generator",
        lambda entropy: random_generator(6 if entropy is None else entropy),
    )
    spotless = [entry for entry in cameras._HAS if entry[0] != "imager.lens.blur_px"]
    patch.setattr(cameras, "_HAS", spotless)
    patch.setattr(
        attribution,
        "candidates",
        lambda *arguments: [entry for entry in all_candidates(*arguments) if entry.name in TRIED],
    )
    shown = {*TRIED, *(n for n, row in catalogue.ROWS.items() if row.kind == "outside")}
    patch.setattr(Rendered, "effects", frozenset(shown))
    real_effects = RealPairs.effects.fget
    assert real_effects is not None
    patch.setattr(RealPairs, "effects", property(lambda self: real_effects(self) & shown))

    def run(program: str, arguments: Sequence[str]) -> None:
        if program == "batch" and "--without" not in arguments:
            for folder in map(Path, arguments[:2]):
                SHOWN.extend(_files(folder))
        assert adapters.main([program, *arguments]) == 0

    patch.setattr(programs, "_run", run)


def _files(folder: Path) -> list[tuple[Path, bytes]]:
    """Read the files of all cases, by their path inside a case folder."""
    paths = [path for path in folder.rglob("*") if path.is_file() and path.suffix != ".png"]
    return [(Path(*path.relative_to(folder).parts[1:]), path.read_bytes()) for path in paths]
