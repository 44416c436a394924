"""Processes that simulate, each with scenes of its own."""

from __future__ import annotations

import multiprocessing
from collections.abc import Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from pathlib import Path
from types import TracebackType
from typing import Any

from starling.diagnosis.scenes.fit_scene import Nuisances
from starling.diagnosis.scenes.scene_model import Subject, subject
from starling.sim.console.threads import begin_worker, cores
from starling.sim.sensor.sensor import Sensor

_MOST = 8
_held: dict[str, Any] = {}  # Of a process: its subjects by name.


class Crew:
    """As many processes as there are cores, with the scenes dealt among them.

    Rendering uses all cores, but matching and features one each, which takes longer. What is
    simulated is the same in all processes, so a scene may be held by several.
    """

    def __init__(
        self,
        captures: Path,
        sensor: Sensor,
        asked: Sequence[Subject],
        *,
        aside: Sequence[Subject] = (),
        against: Path | None = None,
    ) -> None:
        """Start them; each loads its scenes, with what was fitted to them.

        Args:
            captures: capture set.
            sensor: the base.
            asked: those of its scenes that all is asked of, which is nearly all of the work.
            aside: others.
            against: capture set that these are compared with.
        """
        context = multiprocessing.get_context("spawn")
        names, others = ([one.name for one in those] for those in (asked, aside))
        fitted = {one.name: one.nuisances for one in (*asked, *aside)}
        self._held = dealt(names, others, min(cores(), _MOST))
        self._given = [0] * len(self._held)  # How much work each was given so far.
        self._pools = [
            ProcessPoolExecutor(
                1,
                mp_context=context,
                initializer=_begin,
                initargs=(captures, sensor, own, against, fitted),
            )
            for own in self._held
        ]

    def submit(self, scene: str, work: Any, *arguments: Any) -> Future[Any]:
        """Have `work(subject, *arguments)` done where a scene is held, by who had least to do."""
        holders = [number for number, own in enumerate(self._held) if scene in own]
        number = min(holders, key=self._given.__getitem__)
        self._given[number] += 1
        return self._pools[number].submit(_do, scene, work, arguments)

    def __enter__(self) -> Crew:
        """Begin."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Send them home."""
        for pool in self._pools:
            pool.shutdown(cancel_futures=True)


def dealt(scenes: Sequence[str], aside: Sequence[str], count: int) -> list[tuple[str, ...]]:
    """Which scenes each of some processes holds.

    Of those that all is asked of each has as many; the few that are left over are shared, so that
    none is idle while others work.

    Args:
        scenes: names of those that all is asked of, at least one.
        aside: names of others, which are dealt in turn.
        count: of the processes.
    """
    whole = len(scenes) // count * count
    shared = scenes[whole:]
    return [
        (
            *scenes[number:whole:count],
            *([shared[number % len(shared)]] if shared else []),
            *aside[number::count],
        )
        for number in range(count)
    ]


def _begin(
    captures: Path,
    sensor: Sensor,
    scenes: tuple[str, ...],
    against: Path | None,
    fitted: Mapping[str, Nuisances],
) -> None:
    from starling.diagnosis.scenes.pairs import scene_pairs
    from starling.sim.captures import capture

    begin_worker()
    other = None if against is None else capture.open_set(against)
    for one, beside in scene_pairs(capture.open_set(captures), other).pairs:
        if one.name in scenes:
            _held[one.name] = subject(one, sensor, against=beside, fitted=fitted[one.name])


def _do(scene: str, work: Any, arguments: tuple[Any, ...]) -> Any:
    return work(_held[scene], *arguments)
