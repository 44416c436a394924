"""Processes that simulate, each with scenes of its own."""

from __future__ import annotations

import multiprocessing
from collections.abc import Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from pathlib import Path
from types import TracebackType
from typing import Any

from diagnosis.nuisances import Nuisances
from sim.sensor import Sensor
from sim.threads import begin_worker, cores

_MOST = 8
_held: dict[str, Any] = {}  # Of a process: its subjects by name.


class Crew:
    """As many processes as there are cores, with the scenes dealt among them.

    Rendering uses all cores, but matching and features one each, which takes longer.
    """

    def __init__(
        self,
        captures: Path,
        sensor: Sensor,
        scenes: Sequence[str],
        *,
        against: Path | None = None,
        fitted: Mapping[str, Nuisances] | None = None,
    ) -> None:
        """Start them; each loads its scenes.

        Args:
            captures: capture set.
            sensor: the base.
            scenes: names of those that are simulated; they are dealt in turn.
            against: capture set that these are compared with.
            fitted: by scene what was fitted to it, if it was.
        """
        count = max(1, min(cores(), len(scenes), _MOST))
        context = multiprocessing.get_context("spawn")
        self._pools = [
            ProcessPoolExecutor(
                1,
                mp_context=context,
                initializer=_begin,
                initargs=(captures, sensor, own, against, fitted or {}),
            )
            for own in (tuple(scenes[number::count]) for number in range(count))
        ]
        self._of = {name: self._pools[number % count] for number, name in enumerate(scenes)}

    def submit(self, scene: str, work: Any, *arguments: Any) -> Future[Any]:
        """Have `work(subject, *arguments)` done where a scene is held."""
        return self._of[scene].submit(_do, scene, work, arguments)

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


def _begin(
    captures: Path,
    sensor: Sensor,
    scenes: tuple[str, ...],
    against: Path | None,
    fitted: Mapping[str, Nuisances],
) -> None:
    from diagnosis.scene_pairs import scene_pairs
    from diagnosis.subject import subject
    from sim import capture

    begin_worker()
    other = None if against is None else capture.open_set(against)
    for one, beside in scene_pairs(capture.open_set(captures), other).pairs:
        if one.name in scenes:
            _held[one.name] = subject(one, sensor, against=beside, fitted=fitted.get(one.name))


def _do(scene: str, work: Any, arguments: tuple[Any, ...]) -> Any:
    return work(_held[scene], *arguments)
