"""Pool of worker processes that partition the scenes of a diagnosis."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from concurrent.futures import Future
from pathlib import Path
from types import TracebackType
from typing import Any

from starling.diagnosis.scenes.fit_scene import Nuisances
from starling.diagnosis.scenes.scene_model import SceneModel, load_scene_model
from starling.diagnosis.scenes.shelf import temporary_folder, use_folder
from starling.sim.console.threads import Workers, cores
from starling.sim.sensor.sensor import Sensor

_MOST = 8  # Largest number of workers.
_held: dict[str, Any] = {}  # Scene models of this worker process, by name.


class WorkerPool:
    """One worker per core; the scenes are partitioned among the workers.

    Rendering uses all cores. Matching and features use one core each and take longer. All workers
    simulate the same results, so several of them may hold one scene.
    """

    def __init__(
        self,
        captures: Path,
        sensor: Sensor,
        training: Sequence[SceneModel],
        *,
        held_out: Sequence[SceneModel] = (),
        against: Path | None = None,
    ) -> None:
        """Start the workers; each loads its scenes with their fitted nuisance parameters.

        Args:
            captures: capture set.
            sensor: the base.
            training: scenes that need nearly all of the work.
            held_out: other scenes of the set.
            against: capture set that the captures are compared with.
        """
        names, other_names = ([scene.name for scene in scenes] for scenes in (training, held_out))
        fitted = {scene.name: scene.nuisances for scene in (*training, *held_out)}
        self._held = partition(names, other_names, min(cores(), _MOST))
        self._submitted = [0] * len(self._held)  # Number of jobs given to each worker.
        self._folder = temporary_folder()
        self._pools = [
            Workers(1, _begin, (captures, sensor, scenes, against, fitted, self._folder.name))
            for scenes in self._held
        ]

    def submit(self, scene: str, work: Any, *arguments: Any) -> Future[Any]:
        """Run `work(scene_model, *arguments)` on the least busy worker that holds the scene."""
        holders = [number for number, scenes in enumerate(self._held) if scene in scenes]
        number = min(holders, key=self._submitted.__getitem__)
        self._submitted[number] += 1
        return self._pools[number].submit(_run, scene, work, arguments)

    def __enter__(self) -> WorkerPool:
        """Return the pool."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Stop the workers."""
        for pool in self._pools:
            pool.__exit__(kind, error, trace)
        self._folder.cleanup()


def partition(scenes: Sequence[str], held_out: Sequence[str], count: int) -> list[tuple[str, ...]]:
    """Partition scenes among workers.

    Each worker gets equally many training scenes. Remaining ones are shared by several workers, so
    that none is idle.

    Args:
        scenes: names of the training scenes, at least one.
        held_out: names of other scenes, dealt in turn.
        count: number of workers.
    """
    whole = len(scenes) // count * count
    shared = scenes[whole:]
    return [
        (
            *scenes[number:whole:count],
            *([shared[number % len(shared)]] if shared else []),
            *held_out[number::count],
        )
        for number in range(count)
    ]


def _begin(
    captures: Path,
    sensor: Sensor,
    scenes: tuple[str, ...],
    against: Path | None,
    fitted: Mapping[str, Nuisances],
    folder: str,
) -> None:
    from starling.diagnosis.scenes.selection import pair_scenes
    from starling.sim.captures import capture

    use_folder(Path(tempfile.mkdtemp(dir=folder)))
    reference_set = None if against is None else capture.open_set(against)
    for scene, reference in pair_scenes(capture.open_set(captures), reference_set).pairs:
        if scene.name in scenes:
            _held[scene.name] = load_scene_model(
                scene, sensor, against=reference, fitted=fitted[scene.name]
            )


def _run(scene: str, work: Any, arguments: tuple[Any, ...]) -> Any:
    return work(_held[scene], *arguments)
