"""The validation of a tier: light, sealed cases, captures, verdicts and scores."""

from __future__ import annotations

import dataclasses
import json
import multiprocessing
import os
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from starling.diagnosis.validation.camera.catalogue import ROWS
from starling.diagnosis.validation.camera.errors import refusal
from starling.diagnosis.validation.camera.imperfections import IMPERFECTIONS
from starling.diagnosis.validation.protocol import case, plan, power, programs, score, seal
from starling.diagnosis.validation.protocol.case import Case
from starling.diagnosis.validation.protocol.real_pairs import RealPairs
from starling.diagnosis.validation.protocol.rendered import Rendered
from starling.diagnosis.validation.protocol.scene_set import EffectTable, SceneSet
from starling.diagnosis.validation.protocol.score_statistic import statistic
from starling.diagnosis.validation.protocol.tier import Tier
from starling.diagnosis.validation.protocol.verdict import CaseResult

POWER_TIER = 1  # Tier of the power curves: images and depth, without the second matcher.


@dataclass(frozen=True, kw_only=True, slots=True)
class Check:
    """Folder and options of one run of a tier."""

    out: Path
    tier: Tier
    blender: Path  # Python interpreter with `bpy`.
    captures: Path | None = None  # Capture set of a real camera, for tier 4.
    sensor: str | None = None  # Preset or sensor file of that camera.
    mode: str = ""  # Its mode; empty is the sensor's own.
    # Number of singles in place of that of the tier; other kinds scale in proportion. For power
    # curves, the number of cases per effect and level.
    singles: int | None = None
    infrared: bool = True  # Whether captures hold infrared.
    power: bool = False  # Whether to measure power curves, with separate cases.
    jobs: int = 2  # Scene sets in parallel, each in a process; 1 stays in this process.
    set_limit: int | None = None  # Number of scene sets to diagnose and score; None for all.
    imperfect: str | None = None  # One of `plan.PLANS`, for tier 5; None is all at once.
    estimated: bool = False  # Whether scenes are estimated from captures and reference depth.
    effects: tuple[str, ...] = ()  # Effects that cases are drawn from; empty for all of the tier.

    def __post_init__(self) -> None:
        number, captures = self.tier.number, self.captures
        if self.jobs < 1:
            raise refusal("jobs", "must be >= 1", self.jobs, "Give the number of parallel sets.")
        if self.set_limit is not None and not 1 <= self.set_limit <= self.tier.sets:
            rule = f"must be 1 to {self.tier.sets}"
            raise refusal("sets", rule, self.set_limit, "Omit it for all sets.")
        real = self.tier.source == "real"
        if (captures is not None, self.sensor is not None) != (real, real):
            rule = "must be given for tier 4, and for no other"
            got = f"{captures} and {self.sensor} for tier {number}"
            raise refusal("captures and sensor", rule, got, "Give both, or take tier 4.")
        if self.mode and not real:
            rule, advice = "must be given for tier 4 only", "Leave it out."
            raise refusal("mode", rule, f"{self.mode} for tier {number}", advice)
        for option, value in (("imperfect", self.imperfect), ("estimated", self.estimated)):
            if value and not self.tier.imperfect:
                rule, got = "must be given for tier 5 only", f"{value} for tier {number}"
                raise refusal(option, rule, got, "Leave it out, or give --tier 5.")
        if self.imperfect is not None:
            plan.check(self.imperfect)
        if unknown := {*self.effects} - ROWS.keys():
            rule, advice = "must be rows of the catalogue", f"Choose from {', '.join(ROWS)}."
            raise refusal("effects", rule, ", ".join(sorted(unknown)), advice)
        if self.effects and self.power:
            raise refusal("effects", "must be used without power", "both", "Leave one out.")
        if self.effects and "single" not in self.tier.counts:
            rule = "must be used with a tier of known effects"
            raise refusal("effects", rule, f"tier {number}", "Give another tier.")
        if self.estimated and not self.infrared:
            rule = "must have infrared"
            raise refusal("estimated scenes", rule, "none", "Omit --no-infrared.")
        if not self.infrared and (real or self.tier.segment == "image"):
            raise refusal(f"tier {number}", "must have infrared", "none", "Omit --no-infrared.")
        if self.power and number != POWER_TIER:
            rule = f"must be used with tier {POWER_TIER}"
            raise refusal("power", rule, f"tier {number}", f"Give --tier {POWER_TIER}.")
        if captures is not None and not (captures / "capture.toml").is_file():
            advice = "Give a folder with a capture.toml."
            raise refusal("captures", "must be a capture set", captures, advice)

    @property
    def sets(self) -> list[SceneSet]:
        """The scene sets of this run. Cases are drawn for all sets, so that a run can add sets."""
        return [
            SceneSet(
                folder=self.folder / f"set-{number}",
                number=number,
                source=self._source(number),
                infrared=self.infrared,
                estimated=self.estimated,
            )
            for number in range(self.set_limit or self.tier.sets)
        ]

    @property
    def _plan(self) -> str | None:
        return (self.imperfect or plan.ALL) if self.tier.imperfect else None

    @property
    def _world_rows(self) -> set[str]:
        """Effects that name an imperfection, and so are not withheld in this tier."""
        rows = (row for each in IMPERFECTIONS.values() for row in each.rows)
        return set(rows) if self.tier.imperfect else set()

    def _source(self, number: int) -> Rendered | RealPairs:
        folder = self.out / f"set-{number}"
        if self.captures is None or self.sensor is None:
            return Rendered(folder=folder, number=number, tier=self.tier, blender=self.blender)
        return RealPairs(
            folder=folder,
            number=number,
            scenes=self.tier.scenes,
            captures=self.captures,
            believed=self.sensor,
            mode=self.mode,
        )

    @property
    def folder(self) -> Path:
        """Folder of the truth and the verdicts; all runs in `out` share light and caches."""
        words = [*(["power"] if self.power else []), *([] if self.infrared else ["depth alone"])]
        return self.out / " of ".join(words) if words else self.out

    @property
    def hidden(self) -> Path:
        """Folder of the truth, which no program reads."""
        return self.folder / "hidden"

    def prepare(self) -> tuple[Case, ...]:
        """Prepare the capture sources, then draw and seal the cases or verify an existing seal.

        Returns:
            The sealed cases.

        Raises:
            WithheldError: if a renderer fails, or another run uses the folder. Also if the truth,
                the effect families or the request differ from the seal, or verdicts exist without
                a seal. Also if existing inputs or detection limits are invalid.
        """
        self.tier.scaled_counts(self.singles)  # Raises an error for an invalid number.
        self._call([scene_set.prepare for scene_set in self.sets])
        families = self._families()
        public_files = {seal.FAMILIES: families, seal.REQUEST: self._request()}
        if not (self.folder / seal.SEAL).exists():
            files = [*self.folder.glob("set-*/w*/*.json"), *self.folder.glob("set-*/cases/*")]
            if files:
                advice = "Give a new folder: cases are sealed before they are diagnosed."
                rule = "must come after the seal"
                raise refusal("captures and verdicts", rule, files[0], advice)
            seal.seal(self._draw(families), public_files, self.hidden, self.folder)
        return seal.verify(public_files, self.hidden, self.folder)

    def diagnose(self, cases: Sequence[Case]) -> None:
        """Diagnose all sealed cases without a verdict.

        Raises:
            WithheldError: if a program fails, or the code differs from the sealed code.
        """
        left_out = self._left_out(cases)
        work = [
            (each, self._of_set(cases, each.number), self._of_set(left_out, each.number))
            for each in self.sets
        ]
        if not any(scene_set.pending(*arguments) for scene_set, *arguments in work):
            return
        self._require_sealed_code()
        try:
            self._call([partial(scene_set.diagnose, *arguments) for scene_set, *arguments in work])
        finally:
            seal.log_code(self.folder)  # The code may change between the programs.
        self._require_sealed_code()

    def score(self, cases: Sequence[Case]) -> dict[str, Any]:
        """Score the verdicts against the truth. Each opening of the truth is recorded.

        Returns:
            The scores as JSON values.

        Raises:
            WithheldError: if a verdict is missing or damaged.
        """
        left_out = self._left_out(cases)
        results = self._results(cases, "whole")
        family_alone = self._results(left_out, "without family")
        without_twins = self._results(left_out, "without twins")
        scores = {}
        if (segment := self.tier.segment) is not None:
            # Share of cases with depth of the second matcher in which a gap is reported.
            scores["matcher_noticed"] = statistic(
                [result for result in results if self.tier.has_own_depth(result.case.number)],
                lambda result: result.verdict.restricted_to("depth").kind != "no gap",
            ).value
            results, family_alone, without_twins = (
                [
                    dataclasses.replace(result, verdict=result.verdict.restricted_to(segment))
                    for result in group
                ]
                for group in (results, family_alone, without_twins)
            )
        path = self.folder / "opened"
        opened = len(path.read_text(encoding="utf-8").splitlines()) + 1 if path.exists() else 1
        with path.open("a", encoding="utf-8") as file:
            file.write(f"{opened}: {len(results)} and twice {len(without_twins)} verdicts\n")
        camera = self.sets[0].source.camera
        if self.power:
            scores |= {"tier": self.tier.number, "power": power.curves(results, camera)}
        else:
            scores |= score.score(
                results,
                camera,
                tier=self.tier.number,
                families=seal.parse_families((self.folder / seal.FAMILIES).read_bytes()),
                infrared=self.infrared,
                left_out=without_twins,
                family_alone=family_alone,
            )
        return {
            **scores,
            "infrared": self.infrared,
            "sets": {"asked": len(self.sets), "all": self.tier.sets},
            "opened": opened,
            "code_as_sealed": seal.code_is_sealed(self.folder),
            "versions": seal.versions(),
        }

    def _require_sealed_code(self) -> None:
        if not seal.code_is_sealed(self.folder):
            rule, advice = "must be the sealed code", "Run that code, or give a new folder."
            raise refusal("code", rule, "other code", advice)

    def _request(self) -> bytes:
        """Options of this run, the content of `seal.REQUEST`."""
        options = {
            "tier": self.tier.number,
            "first_scene": self.tier.first_scene,
            "cases": self.singles,
            "infrared": self.infrared,
            "power": self.power,
            "captures": self.captures and seal.path_digest(self.captures),
            "sensor": self.sensor and seal.sensor_digest(Path(self.sensor)),
            **({"mode": self.mode} if self.mode else {}),
            **({"imperfect": self._plan} if self._plan else {}),
            **({"estimated": True} if self.estimated else {}),
            **({"effects": sorted(self.effects)} if self.effects else {}),
        }
        return json.dumps(options, indent=1).encode()

    def _results(self, cases: Sequence[Case], table: EffectTable) -> list[CaseResult]:
        return [
            result
            for scene_set in self.sets
            for result in scene_set.results(self._of_set(cases, scene_set.number), table=table)
        ]

    def _families(self) -> bytes:
        path = self.folder / f".{seal.FAMILIES}"
        path.parent.mkdir(parents=True, exist_ok=True)
        programs.run("families", path)
        try:
            return path.read_bytes()
        finally:
            path.unlink()

    def _draw(self, families: bytes) -> tuple[Case, ...]:
        source = self.sets[0].source
        limits = self._source(self.tier.sets).limits()  # Limits come from a set without cases.
        if self.power:
            return power.draw(source.camera, limits, self.tier.sets, each=self.singles)
        counts, _ = self.tier.scaled_counts(self.singles)
        leave_out = {*(ROWS.keys() - source.effects), *self._world_rows}
        if self.effects:  # Few effects give no pairs, and unknown ones are not among them.
            few: dict[case.CaseKind, int] = {kind: counts[kind] for kind in ("single", "null")}
            counts = few
            leave_out |= ROWS.keys() - {*self.effects}
        return case.draw(
            source.camera,
            counts,
            families=seal.parse_families(families),
            limits=limits,
            kinds=self.tier.kinds,
            leave_out=leave_out,
            upwards=source.upwards,
            beyond=self.tier.beyond,
            imperfect=self._plan,
        )

    def _left_out(self, cases: Sequence[Case]) -> list[Case]:
        if self.power:
            return []
        _, count = self.tier.scaled_counts(self.singles)
        return [case for case in cases if case.kind == "single"][:count]

    def _of_set(self, cases: Sequence[Case], number: int) -> list[Case]:
        return [case for case in cases if case.number % self.tier.sets == number]

    def _call(self, calls: Sequence[Callable[[], None]]) -> None:
        """Call functions, one for each scene set, in parallel processes."""
        if self.jobs == 1:
            for call in calls:
                call()
            return
        context = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(self.jobs, context, _end_with_parent) as pool:
            try:
                for future in [pool.submit(call) for call in calls]:
                    future.result()
            except BaseException:
                for process in multiprocessing.active_children():
                    process.kill()
                raise


def _end_with_parent() -> None:
    """End this process as soon as its parent has ended."""
    parent = multiprocessing.parent_process()

    def watch() -> None:
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
