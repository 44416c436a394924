"""The validation of a tier: light, sealed cases, captures, verdicts and scores."""

from __future__ import annotations

import dataclasses
import json
import multiprocessing
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from starling.diagnosis.validation.camera.catalogue import ROWS
from starling.diagnosis.validation.camera.errors import refusal
from starling.diagnosis.validation.protocol import case, lock, power, programs, score, seal
from starling.diagnosis.validation.protocol.case import Case
from starling.diagnosis.validation.protocol.case_result import CaseResult
from starling.diagnosis.validation.protocol.real_pairs import RealPairs
from starling.diagnosis.validation.protocol.rendered import Rendered
from starling.diagnosis.validation.protocol.scene_set import EffectTable, SceneSet
from starling.diagnosis.validation.protocol.score_statistic import score_statistic
from starling.diagnosis.validation.protocol.source import CaptureSource
from starling.diagnosis.validation.protocol.tier import Tier
from starling.diagnosis.validation.protocol.verdict import SegmentName

POWER_TIER = 1  # Tier of the power curves: images and depth, without the second matcher.


@dataclass(frozen=True, kw_only=True, slots=True)
class Check:
    """Folder and options of one run of a tier."""

    out: Path
    tier: Tier
    blender: Path  # Python interpreter with `bpy`.
    captures: Path | None = None  # Capture set of a real camera, for tier 4.
    sensor: str | None = None  # Preset or sensor file of that camera.
    infrared: bool = True  # Whether captures hold infrared.
    power: bool = False  # Whether to measure power curves, with separate cases.
    jobs: int = 2  # Scene sets in parallel, each in a process; 1 stays in this process.
    set_limit: int | None = None  # Number of scene sets to diagnose and score; None for all.

    def __post_init__(self) -> None:
        if self.jobs < 1:
            raise refusal("jobs", "must be >= 1", self.jobs, "Give the number of parallel sets.")
        if self.set_limit is not None and not 1 <= self.set_limit <= self.tier.sets:
            rule = f"must be 1 to {self.tier.sets}"
            raise refusal("sets", rule, self.set_limit, "Omit it for all sets.")
        present = (self.captures is not None, self.sensor is not None)
        if present != (self._real, self._real):
            rule = "must be given for tier 4, and for no other"
            got = f"{self.captures} and {self.sensor} for tier {self.tier.number}"
            raise refusal("captures and sensor", rule, got, "Give both, or take tier 4.")
        if self._real and not self.infrared:
            raise refusal("tier 4", "must have infrared", "none", "Omit --no-infrared.")
        if self.tier.segment == "image" and not self.infrared:
            rule, advice = "must have infrared", "Omit --no-infrared."
            raise refusal(f"tier {self.tier.number}", rule, "none", advice)
        if self.power and self.tier.number != POWER_TIER:
            got = f"tier {self.tier.number}"
            rule = f"must be used with tier {POWER_TIER}"
            raise refusal("power", rule, got, f"Give --tier {POWER_TIER}.")
        if self.captures is not None and not (self.captures / "capture.toml").is_file():
            advice = "Give a folder with a capture.toml."
            raise refusal("captures", "must be a capture set", self.captures, advice)

    @property
    def sets(self) -> list[SceneSet]:
        """The scene sets of this run. Cases are drawn for all sets, so that a run can add sets."""
        return [
            SceneSet(
                folder=self.folder / f"set-{number}",
                number=number,
                source=self._source(number),
                infrared=self.infrared,
            )
            for number in range(self.set_limit or self.tier.sets)
        ]

    @property
    def _real(self) -> bool:
        return self.tier.source == "real"

    def _source(self, number: int) -> CaptureSource:
        folder = self.out / f"set-{number}"
        if self.captures is None or self.sensor is None:
            return Rendered(folder=folder, number=number, tier=self.tier, blender=self.blender)
        return RealPairs(
            folder=folder,
            number=number,
            scenes=self.tier.scenes,
            captures=self.captures,
            believed=self.sensor,
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

    def prepare(self, singles: int | None = None) -> tuple[Case, ...]:
        """Prepare the capture sources, then draw and seal the cases or verify an existing seal.

        Args:
            singles: Number of singles in place of that of the tier; other kinds scale in
                proportion. For power curves, the number of cases per effect and level.

        Returns:
            The sealed cases.

        Raises:
            WithheldError: if a renderer fails, or another run uses the folder. Also if the truth,
                the effect families or the request differ from the seal, or verdicts exist without
                a seal. Also if existing inputs or detection limits are invalid.
        """
        self.tier.scaled_counts(singles)  # Raises an error for an invalid number.
        self._map(_prepare, [(scene_set,) for scene_set in self.sets])
        families = self._families()
        public_files = {seal.FAMILIES: families, seal.REQUEST: self._request(singles)}
        if not (self.folder / seal.SEAL).exists():
            files = [*self.folder.glob("set-*/w*/*.json"), *self.folder.glob("set-*/cases/*")]
            if files:
                advice = "Give a new folder: cases are sealed before they are diagnosed."
                rule = "must come after the seal"
                raise refusal("captures and verdicts", rule, files[0], advice)
            seal.seal(self._draw(singles, families), public_files, self.hidden, self.folder)
        return seal.verify(public_files, self.hidden, self.folder)

    def diagnose(self, cases: Sequence[Case], singles: int | None = None) -> None:
        """Diagnose all cases without a verdict.

        Args:
            cases: The sealed cases.
            singles: Number of singles, as for `prepare`.

        Raises:
            WithheldError: if a program fails, or the code differs from the sealed code.
        """
        left_out = self._left_out(cases, singles)
        work = [
            (
                scene_set,
                self._cases_of_set(cases, scene_set.number),
                self._cases_of_set(left_out, scene_set.number),
            )
            for scene_set in self.sets
        ]
        if not any(scene_set.pending(*arguments) for scene_set, *arguments in work):
            return
        self._require_sealed_code()
        try:
            self._map(_diagnose, work)
        finally:
            seal.log_code(self.folder)  # The code may change between the programs.
        self._require_sealed_code()

    def score(self, cases: Sequence[Case], singles: int | None = None) -> dict[str, Any]:
        """Score the verdicts against the truth. Each opening of the truth is recorded.

        Args:
            cases: The sealed cases.
            singles: Number of singles, as for `prepare`.

        Returns:
            The scores as JSON values.

        Raises:
            WithheldError: if a verdict is missing or damaged.
        """
        left_out = self._left_out(cases, singles)
        results = self._results(cases, "whole")
        without_family, without_twins = (
            self._results(left_out, table) for table in ("without family", "without twins")
        )
        scores = {}
        if (segment := self.tier.segment) is not None:
            scores["matcher_noticed"] = _matcher_detection_rate(
                [result for result in results if self.tier.has_own_depth(result.case.number)]
            )
            results, without_family, without_twins = (
                _restrict(group, segment) for group in (results, without_family, without_twins)
            )
        path = self.folder / "opened"
        opened = len(path.read_text(encoding="utf-8").splitlines()) + 1 if path.exists() else 1
        with path.open("a", encoding="utf-8") as file:
            file.write(f"{opened}: {len(results)} and twice {len(without_twins)} verdicts\n")
        camera = self.sets[0].source.camera
        if self.power:
            scores |= {"tier": self.tier.number, "power": power.curves(results, camera)}
        else:
            tier = self.tier.number
            scores |= score.score(
                results,
                camera,
                tier=tier,
                families=seal.parse_families((self.folder / seal.FAMILIES).read_bytes()),
                infrared=self.infrared,
                left_out=without_twins,
                family_alone=without_family,
            )
        same = seal.code_is_sealed(self.folder)
        sets = {"asked": len(self.sets), "all": self.tier.sets}
        return {
            **scores,
            "infrared": self.infrared,
            "sets": sets,
            "opened": opened,
            "code_as_sealed": same,
            "versions": seal.versions(),
        }

    def _require_sealed_code(self) -> None:
        if not seal.code_is_sealed(self.folder):
            rule, advice = "must be the sealed code", "Run that code, or give a new folder."
            raise refusal("code", rule, "other code", advice)

    def _request(self, singles: int | None) -> bytes:
        """Options of this run, the content of `seal.REQUEST`."""
        options = {
            "tier": self.tier.number,
            "first_scene": self.tier.first_scene,
            "cases": singles,
            "infrared": self.infrared,
            "power": self.power,
            "captures": self.captures and seal.path_digest(self.captures),
            "sensor": self.sensor and seal.sensor_digest(Path(self.sensor)),
        }
        return json.dumps(options, indent=1).encode()

    def _results(self, cases: Sequence[Case], table: EffectTable) -> list[CaseResult]:
        return [
            result
            for scene_set in self.sets
            for result in scene_set.results(
                self._cases_of_set(cases, scene_set.number), table=table
            )
        ]

    def _families(self) -> bytes:
        path = self.folder / f".{seal.FAMILIES}"
        path.parent.mkdir(parents=True, exist_ok=True)
        programs.families(path)
        try:
            return path.read_bytes()
        finally:
            path.unlink()

    def _draw(self, singles: int | None, families: bytes) -> tuple[Case, ...]:
        source = self.sets[0].source
        camera = source.camera
        limits = self._source(self.tier.sets).limits()  # Limits come from a set without cases.
        if self.power:
            return power.draw(camera, limits, self.tier.sets, each=singles)
        counts, _ = self.tier.scaled_counts(singles)
        return case.draw(
            camera,
            counts,
            families=seal.parse_families(families),
            limits=limits,
            kinds=self.tier.kinds,
            leave_out=ROWS.keys() - source.effects,
            upwards=source.upwards,
        )

    def _left_out(self, cases: Sequence[Case], singles: int | None) -> list[Case]:
        if self.power:
            return []
        _, count = self.tier.scaled_counts(singles)
        return [case for case in cases if case.kind == "single"][:count]

    def _cases_of_set(self, cases: Sequence[Case], number: int) -> list[Case]:
        return [case for case in cases if case.number % self.tier.sets == number]

    def _map(self, work: Callable[..., None], arguments: Sequence[tuple[Any, ...]]) -> None:
        if self.jobs == 1:
            for item in arguments:
                work(*item)
            return
        context = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(self.jobs, mp_context=context) as pool:
            for future in [pool.submit(work, *item) for item in arguments]:
                future.result()


def _matcher_detection_rate(results: Sequence[CaseResult]) -> float | None:
    """Share of cases with depth of the second matcher in which the diagnosis reports a gap."""
    return score_statistic(
        results, lambda result: result.verdict.restricted_to("depth").kind != "no gap"
    ).value


def _restrict(results: Sequence[CaseResult], segment: SegmentName) -> list[CaseResult]:
    return [
        dataclasses.replace(result, verdict=result.verdict.restricted_to(segment))
        for result in results
    ]


def _prepare(scene_set: SceneSet) -> None:
    with lock.exclusive(scene_set.source.folder):
        scene_set.source.prepare()


def _diagnose(scene_set: SceneSet, cases: Sequence[Case], left_out: Sequence[Case]) -> None:
    scene_set.diagnose(cases, left_out)
