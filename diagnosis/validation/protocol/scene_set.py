"""One set of scenes of the check: its cases' captures, and the verdicts on them."""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from starling.diagnosis.validation.protocol import lock, programs, verdict
from starling.diagnosis.validation.protocol.answered import Answered
from starling.diagnosis.validation.protocol.case import Case
from starling.diagnosis.validation.protocol.source import Source

# Of the diagnosis' table; twins are the effects that it says one is confused with.
Table = Literal["whole", "without family", "without twins"]


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
            left_out: Those that are diagnosed twice more: without their effect's family, and
                without the families of its twins too.

        Raises:
            WithheldError: if a program fails, or another run works on the set.
        """
        with lock.alone(self.folder):
            self._diagnose(*self._pending(cases, left_out))

    def pending(self, cases: Sequence[Case], left_out: Sequence[Case]) -> bool:
        """Whether anything is left to do (arguments as `diagnose`)."""
        return any(self._pending(cases, left_out))

    def _pending(
        self, cases: Sequence[Case], left_out: Sequence[Case]
    ) -> tuple[list[Case], list[Case]]:
        todo = [one for one in cases if not self._has(one, "whole")]
        again = [one for one in left_out if not self._has(one, "without family", "without twins")]
        return todo, again

    def _diagnose(self, todo: Sequence[Case], again: Sequence[Case]) -> None:
        wanted = {one.number: one for one in (*todo, *again)}
        missing = [one for one in wanted.values() if not (self._cases / one.name).exists()]
        if missing:
            self._shoot(missing)
        if todo:
            self._run(self.folder / "whole", None)
        if again:  # A run of its own, as it is told what acts.
            self._run(self.folder, {one.name: _row(one) for one in again})
        shutil.rmtree(self._cases, ignore_errors=True)  # Seeds and truth make them again.

    def answered(self, cases: Sequence[Case], *, table: Table = "whole") -> list[Answered]:
        """Read the verdicts.

        Args:
            cases: Of this set.
            table: What of the diagnosis' table was tried.

        Raises:
            WithheldError: if one is missing or damaged.
        """
        return [
            Answered(case=one, verdict=verdict.read(self._verdict(table, one)), scenes=self.number)
            for one in cases
        ]

    def _run(self, out: Path, without: Mapping[str, str] | None) -> None:
        programs.diagnose(
            self._cases,
            out,
            self.source.sensor,
            self.source.cache,
            against=self.source.against,
            without=without,
        )

    def _has(self, case: Case, *tables: Table) -> bool:
        return all(self._verdict(table, case).exists() for table in tables)

    @property
    def _cases(self) -> Path:
        return self.folder / "cases"

    def _verdict(self, table: Table, case: Case) -> Path:
        return self.folder / table / f"{case.name}.json"

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
    (name,) = case.settings
    return name
