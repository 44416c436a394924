"""One set of scenes of the check: its light, its cases' captures, and the verdicts on them."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from diagnosis.withheld import device, nominal, programs, shoot, verdict
from diagnosis.withheld.answered import Answered
from diagnosis.withheld.case import Case
from diagnosis.withheld.catalogue import ROWS
from diagnosis.withheld.nominal import Nominal
from diagnosis.withheld.tier import Tier


@dataclass(frozen=True, kw_only=True, slots=True)
class SceneSet:
    """Where everything of a set lies. The diagnosis sees `cases`, `sensor` and its own cache."""

    folder: Path
    number: int
    tier: Tier
    blender: Path  # Python with `bpy`, for light by Cycles.
    infrared: bool = True  # Whether captures hold infrared.

    @property
    def light(self) -> Path:
        """Folder of linear light."""
        return self.folder / "light"

    @property
    def sensor(self) -> Path:
        """What the camera is believed to be."""
        return self._rendered / programs.SENSOR

    @property
    def camera(self) -> Nominal:
        """The same in this package's words."""
        return nominal.read(self.light / nominal.FILE)

    @property
    def _rendered(self) -> Path:
        cycles = self.tier.source == "cycles"
        return self.folder / "light by Starling" if cycles else self.light

    def render(self) -> None:
        """Make the light, if it is not there.

        Raises:
            WithheldError: if a renderer fails.
        """
        if not self._rendered.exists():
            names = self.tier.names(self.number)
            programs.light(self._rendered, names, self.tier.width, self.tier.height)
        if self._rendered != self.light:
            programs.cycles(self._rendered, self.light, self.blender)

    def diagnose(self, cases: Sequence[Case], left_out: Sequence[Case]) -> None:
        """Take captures of cases and have them diagnosed; what has a verdict is done.

        Args:
            cases: Of this set.
            left_out: Those that are diagnosed again without their effect's family.

        Raises:
            WithheldError: if a program fails.
        """
        first = [one for one in cases if not self._verdict("verdicts", one).exists()]
        again = [one for one in left_out if not self._verdict("left out", one).exists()]
        wanted = {one.number: one for one in (*first, *again)}
        missing = [one for one in wanted.values() if not (self._cases / _name(one)).exists()]
        if missing:
            self._shoot(missing)
        cache = self.folder / "cache"
        if first:
            programs.diagnose(self._cases, self.folder / "verdicts", self.sensor, cache)
        if again:
            without = {_name(one): _row(one) for one in left_out}
            out = self.folder / "left out"
            programs.diagnose(self._cases, out, self.sensor, cache, without=without)
        shutil.rmtree(self._cases, ignore_errors=True)  # Seeds and truth make them again.

    def answered(self, cases: Sequence[Case], *, left_out: bool = False) -> list[Answered]:
        """Read the verdicts.

        Raises:
            WithheldError: if one is missing or damaged.
        """
        kind = "left out" if left_out else "verdicts"
        return [
            Answered(case=one, verdict=verdict.read(self._verdict(kind, one)), scenes=self.number)
            for one in cases
        ]

    @property
    def _cases(self) -> Path:
        return self.folder / "cases"

    def _verdict(self, kind: str, case: Case) -> Path:
        return self.folder / kind / f"{_name(case)}.json"

    def _shoot(self, cases: Sequence[Case]) -> None:
        """Take captures in a place aside, as nobody may see half of one."""
        aside = self.folder / ".cases"
        shutil.rmtree(aside, ignore_errors=True)
        camera = self.camera
        for one in cases:
            shoot.shoot(self.light, one, aside / _name(one), frames=self.tier.frames)
            if self.tier.matcher == "own":
                device.measure(aside / _name(one), one, camera)
        if self.tier.matcher == "starling":
            programs.depth(aside, self.sensor)
        for one in cases:
            shoot.post(aside / _name(one), one, camera)
            if not self.infrared:
                for path in (aside / _name(one)).rglob("ir_*.png"):
                    path.unlink()
        self._cases.mkdir(exist_ok=True)
        for one in cases:
            (aside / _name(one)).rename(self._cases / _name(one))
        aside.rmdir()


def _name(case: Case) -> str:
    return f"{case.number:03d}"


def _row(case: Case) -> str:
    return next(name for name in case.settings if name in ROWS)
