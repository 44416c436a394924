"""One set of scenes of the check: its cases' captures, and the verdicts on them."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from diagnosis.withheld import programs, verdict
from diagnosis.withheld.answered import Answered
from diagnosis.withheld.case import Case
from diagnosis.withheld.catalogue import ROWS
from diagnosis.withheld.source import Source


@dataclass(frozen=True, kw_only=True, slots=True)
class SceneSet:
    """Where a set lies. The diagnosis sees `cases`, the source's sensor and its own cache."""

    folder: Path
    number: int
    source: Source
    infrared: bool = True  # Whether captures hold infrared.

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
        missing = [one for one in wanted.values() if not (self._cases / one.name).exists()]
        if missing:
            self._shoot(missing)
        sensor, cache, against = self.source.sensor, self.source.cache, self.source.against
        if first:
            out = self.folder / "verdicts"
            programs.diagnose(self._cases, out, sensor, cache, against=against)
        if again:
            without = {one.name: _row(one) for one in left_out}
            out = self.folder / "left out"
            programs.diagnose(self._cases, out, sensor, cache, against=against, without=without)
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
        return self.folder / kind / f"{case.name}.json"

    def _shoot(self, cases: Sequence[Case]) -> None:
        """Take captures in a place aside, as nobody may see half of one."""
        aside = self.folder / ".cases"
        shutil.rmtree(aside, ignore_errors=True)
        self.source.take(cases, aside)
        if not self.infrared:
            for path in aside.rglob("ir_*.png"):
                path.unlink()
        self._cases.mkdir(exist_ok=True)
        for one in cases:
            (aside / one.name).rename(self._cases / one.name)
        aside.rmdir()


def _row(case: Case) -> str:
    return next(name for name in case.settings if name in ROWS)
