"""One scene set of the check: the captures of its cases and their verdicts."""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from starling.diagnosis.validation.protocol import files, programs, verdict
from starling.diagnosis.validation.protocol.case import Case
from starling.diagnosis.validation.protocol.real_pairs import RealPairs
from starling.diagnosis.validation.protocol.rendered import Rendered
from starling.diagnosis.validation.protocol.verdict import CaseResult

# Effects that the diagnosis may name: all, or without the family of the true effect, or also
# without the families of its confusable effects ("twins").
EffectTable = Literal["whole", "without family", "without twins"]


@dataclass(frozen=True, kw_only=True, slots=True)
class SceneSet:
    """Files of one scene set. The diagnosis reads `cases`, the sensor file and its own cache."""

    folder: Path
    number: int
    source: Rendered | RealPairs
    infrared: bool = True  # Whether captures hold infrared.
    estimated: bool = False  # Whether captures lack the files that describe the scenes.

    def prepare(self) -> None:
        """Make the inputs of all cases if they do not exist.

        Raises:
            WithheldError: if a program fails, or another run uses the folder.
        """
        with files.exclusive(self.source.folder):
            self.source.prepare()

    def diagnose(self, cases: Sequence[Case], left_out: Sequence[Case]) -> None:
        """Write the captures of the cases without a verdict and diagnose them.

        Args:
            cases: Cases of this set.
            left_out: Cases to diagnose twice more: without the family of the true effect, and also
                without the families of its confusable effects.

        Raises:
            WithheldError: if a program fails, or another run uses the folder.
        """
        with files.exclusive(self.folder):
            self._diagnose(*self._pending(cases, left_out))

    def pending(self, cases: Sequence[Case], left_out: Sequence[Case]) -> bool:
        """Return whether a verdict is missing. The arguments are those of `diagnose`."""
        return any(self._pending(cases, left_out))

    def _pending(
        self, cases: Sequence[Case], left_out: Sequence[Case]
    ) -> tuple[list[Case], list[Case]]:
        todo = [case for case in cases if not self._has(case, "whole")]
        again = [
            case for case in left_out if not self._has(case, "without family", "without twins")
        ]
        return todo, again

    def _diagnose(self, todo: Sequence[Case], again: Sequence[Case]) -> None:
        needed = {case.number: case for case in (*todo, *again)}
        missing = [case for case in needed.values() if not (self._cases / case.name).exists()]
        if missing:
            self._shoot(missing)
        if todo:
            self._run(self.folder / "whole", None)
        if again:  # A separate run, because its input reveals the true effects.
            self._run(self.folder, {case.name: _row(case) for case in again})
        shutil.rmtree(self._cases, ignore_errors=True)  # The truth and its seeds reproduce them.

    def results(self, cases: Sequence[Case], *, table: EffectTable = "whole") -> list[CaseResult]:
        """Read the verdicts.

        Args:
            cases: Cases of this set.
            table: Effects that the diagnosis could name.

        Raises:
            WithheldError: if a verdict is missing or damaged.
        """
        verdicts = [verdict.read(self._verdict(table, case)) for case in cases]
        return [
            CaseResult(case=case, verdict=answer, set_number=self.number)
            for case, answer in zip(cases, verdicts, strict=True)
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

    def _has(self, case: Case, *tables: EffectTable) -> bool:
        return all(self._verdict(table, case).exists() for table in tables)

    @property
    def _cases(self) -> Path:
        return self.folder / "cases"

    def _verdict(self, table: EffectTable, case: Case) -> Path:
        return self.folder / table / f"{case.name}.json"

    def _shoot(self, cases: Sequence[Case]) -> None:
        """Write captures to a temporary folder first, so that no capture set is incomplete."""
        temporary = self.folder / ".cases"
        shutil.rmtree(temporary, ignore_errors=True)
        self.source.write_captures(cases, temporary)
        withheld = [*([] if self.infrared else ["ir_*.png"]), *(["scene.toml"] * self.estimated)]
        for path in [path for pattern in withheld for path in temporary.rglob(pattern)]:
            path.unlink()
        self._cases.mkdir(exist_ok=True)
        for case in cases:
            (temporary / case.name).rename(self._cases / case.name)
        temporary.rmdir()


def _row(case: Case) -> str:
    (name,) = case.settings
    return name
