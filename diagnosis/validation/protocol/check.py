"""The whole check: light, sealed cases, captures, verdicts of a diagnosis, scores."""

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
from starling.diagnosis.validation.protocol.answered import Answered
from starling.diagnosis.validation.protocol.case import Case
from starling.diagnosis.validation.protocol.figure import figure
from starling.diagnosis.validation.protocol.real_pairs import RealPairs
from starling.diagnosis.validation.protocol.rendered import Rendered
from starling.diagnosis.validation.protocol.scene_set import SceneSet, Table
from starling.diagnosis.validation.protocol.source import Source
from starling.diagnosis.validation.protocol.tier import Tier
from starling.diagnosis.validation.protocol.verdict import Arm

POWER = 1  # The tier of which it is asked: images and depth, and no other matcher's.


@dataclass(frozen=True, kw_only=True, slots=True)
class Check:
    """Where one run of a tier lies, and how it is run."""

    out: Path
    tier: Tier
    blender: Path
    captures: Path | None = None  # Of a real camera, for a tier of real pairs.
    sensor: str | None = None  # Preset or sensor file of that camera.
    infrared: bool = True
    power: bool = False  # Ask how strong effects must be, of cases of their own.
    jobs: int = 2  # Sets of scenes at once, each in a process; one alone stays in this process.
    count: int | None = None  # Of the sets, the first, that are asked and scored; None: all.

    def __post_init__(self) -> None:
        if self.jobs < 1:
            raise refusal("jobs", "must be >= 1", self.jobs, "Give how many sets at once.")
        if self.count is not None and not 1 <= self.count <= self.tier.sets:
            rule = f"must be 1 to {self.tier.sets}"
            raise refusal("sets", rule, self.count, "Leave it away for all of them.")
        given = (self.captures is not None, self.sensor is not None)
        if given != (self._real, self._real):
            rule = "must be given for tier 4, and for no other"
            got = f"{self.captures} and {self.sensor} for tier {self.tier.number}"
            raise refusal("captures and sensor", rule, got, "Give both, or take tier 4.")
        if self._real and not self.infrared:
            raise refusal("tier 4", "must have infrared", "none", "Leave --no-infrared away.")
        if self.tier.arm == "image" and not self.infrared:
            rule, advice = "must have infrared", "Leave --no-infrared away."
            raise refusal(f"tier {self.tier.number}", rule, "none", advice)
        if self.power and self.tier.number != POWER:
            got = f"tier {self.tier.number}"
            raise refusal("power", f"must be asked of tier {POWER}", got, "Ask that.")
        if self.captures is not None and not (self.captures / "capture.toml").is_file():
            advice = "Give a folder with a capture.toml."
            raise refusal("captures", "must be a capture set", self.captures, advice)

    @property
    def sets(self) -> list[SceneSet]:
        """The scene sets that are asked; cases are drawn for all, so that others can be later."""
        return [
            SceneSet(
                folder=self.place / f"set-{number}",
                number=number,
                source=self._source(number),
                infrared=self.infrared,
            )
            for number in range(self.count or self.tier.sets)
        ]

    @property
    def _real(self) -> bool:
        return self.tier.source == "real"

    def _source(self, number: int) -> Source:
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
    def place(self) -> Path:
        """Folder of this run's truth and verdicts; light and signatures serve all runs in `out`."""
        words = [*(["power"] if self.power else []), *([] if self.infrared else ["depth alone"])]
        return self.out / " of ".join(words) if words else self.out

    @property
    def hidden(self) -> Path:
        """Folder of the truth, which no program is told of."""
        return self.place / "hidden"

    def prepared(self, singles: int | None = None) -> tuple[Case, ...]:
        """Make what captures need, draw the cases and seal the truth, or take up what was sealed.

        Args:
            singles: How many, instead of the tier's own number; the rest in proportion. For power
                how many of each effect and level.

        Raises:
            WithheldError: if a renderer fails, another run works here, the truth, the diagnosis'
                families or what is asked for are not what was sealed, there are captures or
                verdicts and no seal, light or pairs are of something else, or the detection limits
                cannot be read.
        """
        self.tier.drawn(singles)  # Refuses what no tier can draw.
        self._each(_prepare, [(one,) for one in self.sets])
        families = self._families()
        told = {seal.FAMILIES: families, seal.ASKED: self._asked(singles)}
        if not (self.place / seal.SEAL).exists():
            answers = [*self.place.glob("set-*/w*/*.json"), *self.place.glob("set-*/cases/*")]
            if answers:
                advice = "Give a new folder: cases are drawn before they are answered."
                rule = "must come after the seal"
                raise refusal("captures and verdicts", rule, answers[0], advice)
            seal.seal(self._drawn(singles, families), told, self.hidden, self.place)
        return seal.verify(told, self.hidden, self.place)

    def diagnosed(self, cases: Sequence[Case], singles: int | None = None) -> None:
        """Have all cases diagnosed that are not yet.

        Args:
            cases: What was sealed.
            singles: As for `prepared`.

        Raises:
            WithheldError: if a program fails, or the code is not what was sealed.
        """
        left_out = self._left_out(cases, singles)
        each = [
            (one, self._of(cases, one.number), self._of(left_out, one.number)) for one in self.sets
        ]
        if not any(one.pending(*of) for one, *of in each):
            return
        self._refuse_other_code()
        try:
            self._each(_diagnose, each)
        finally:
            seal.worked(self.place)  # Programs begin one after the other.
        self._refuse_other_code()

    def scored(self, cases: Sequence[Case], singles: int | None = None) -> dict[str, Any]:
        """Open the truth beside the verdicts; every opening is written down.

        Args:
            cases: What was sealed.
            singles: As for `prepared`.

        Raises:
            WithheldError: if a verdict is missing or damaged.
        """
        left_out = self._left_out(cases, singles)
        answered = self._answered(cases, "whole")
        alone, twins = (
            self._answered(left_out, table) for table in ("without family", "without twins")
        )
        told = {}
        if (arm := self.tier.arm) is not None:
            told["matcher_noticed"] = _noticed(
                [one for one in answered if self.tier.measures(one.case.number)]
            )
            answered, alone, twins = (_of_arm(those, arm) for those in (answered, alone, twins))
        path = self.place / "opened"
        opened = len(path.read_text(encoding="utf-8").splitlines()) + 1 if path.exists() else 1
        with path.open("a", encoding="utf-8") as file:
            file.write(f"{opened}: {len(answered)} and twice {len(twins)} verdicts\n")
        camera = self.sets[0].source.camera
        if self.power:
            told |= {"tier": self.tier.number, "power": power.curves(answered, camera)}
        else:
            tier = self.tier.number
            told |= score.score(
                answered,
                camera,
                tier=tier,
                families=seal.families((self.place / seal.FAMILIES).read_bytes()),
                infrared=self.infrared,
                left_out=twins,
                family_alone=alone,
            )
        same = seal.is_of_this_code(self.place)
        sets = {"asked": len(self.sets), "all": self.tier.sets}
        return {
            **told,
            "infrared": self.infrared,
            "sets": sets,
            "opened": opened,
            "code_as_sealed": same,
            "versions": seal.versions(),
        }

    def _refuse_other_code(self) -> None:
        if not seal.is_of_this_code(self.place):
            rule, advice = "must be the one sealed", "Run that, or give a new folder."
            raise refusal("code", rule, "another", advice)

    def _asked(self, singles: int | None) -> bytes:
        """What this run asks, as `seal.ASKED` is to hold it."""
        told = {
            "tier": self.tier.number,
            "first_scene": self.tier.first,
            "cases": singles,
            "infrared": self.infrared,
            "power": self.power,
            "captures": self.captures and seal.content(self.captures),
            "sensor": self.sensor and seal.of_sensor(Path(self.sensor)),
        }
        return json.dumps(told, indent=1).encode()

    def _answered(self, cases: Sequence[Case], table: Table) -> list[Answered]:
        return [
            answer
            for one in self.sets
            for answer in one.answered(self._of(cases, one.number), table=table)
        ]

    def _families(self) -> bytes:
        path = self.place / f".{seal.FAMILIES}"
        path.parent.mkdir(parents=True, exist_ok=True)
        programs.families(path)
        try:
            return path.read_bytes()
        finally:
            path.unlink()

    def _drawn(self, singles: int | None, families: bytes) -> tuple[Case, ...]:
        source = self.sets[0].source
        camera = source.camera
        least = self._source(self.tier.sets).limits()  # Of a set that no case is of.
        if self.power:
            return power.draw(camera, least, self.tier.sets, each=singles)
        counts, _ = self.tier.drawn(singles)
        return case.draw(
            camera,
            counts,
            families=seal.families(families),
            limits=least,
            kinds=self.tier.kinds,
            leave_out=ROWS.keys() - source.effects,
            upwards=source.upwards,
        )

    def _left_out(self, cases: Sequence[Case], singles: int | None) -> list[Case]:
        if self.power:
            return []
        _, count = self.tier.drawn(singles)
        return [one for one in cases if one.kind == "single"][:count]

    def _of(self, cases: Sequence[Case], number: int) -> list[Case]:
        return [one for one in cases if one.number % self.tier.sets == number]

    def _each(self, work: Callable[..., None], arguments: Sequence[tuple[Any, ...]]) -> None:
        if self.jobs == 1:
            for each in arguments:
                work(*each)
            return
        context = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(self.jobs, mp_context=context) as pool:
            for done in [pool.submit(work, *each) for each in arguments]:
                done.result()


def _noticed(answered: Sequence[Answered]) -> float | None:
    """Share of cases whose device's matcher, which is not ours, was noticed."""
    return figure(answered, lambda one: one.verdict.of_arm("depth").kind != "no gap").value


def _of_arm(answered: Sequence[Answered], arm: Arm) -> list[Answered]:
    return [dataclasses.replace(one, verdict=one.verdict.of_arm(arm)) for one in answered]


def _prepare(of: SceneSet) -> None:
    with lock.alone(of.source.folder):
        of.source.prepare()


def _diagnose(of: SceneSet, cases: Sequence[Case], left_out: Sequence[Case]) -> None:
    of.diagnose(cases, left_out)
