"""Worker processes on this machine, one core each."""

from __future__ import annotations

import multiprocessing
import os
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from pathlib import Path

from starling.patterns import errors
from starling.sim.captures.info import CaptureInfo
from starling.sim.console.threads import begin_worker
from starling.sim.datasets.plan import Plan
from starling.sim.datasets.task import Task, TaskResult, make

_AHEAD = 2  # Queued tasks per worker; limits the memory of results that wait to be written.
_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


def run(
    plan: Plan, info: CaptureInfo, out: Path, tasks: Sequence[Task], workers: int
) -> Iterator[TaskResult]:
    """Run tasks and yield their results in the order of the tasks.

    Args:
        plan, info, out: as in `render_view.render`.
        tasks: tasks of the plan.
        workers: largest number of processes; each uses one thread.

    Raises:
        InputError: as `task.make`, or if a process died.
    """
    workers = max(1, min(workers, len(tasks)))
    context = multiprocessing.get_context("spawn")
    waiting: deque[Future[TaskResult]] = deque()
    with (
        _one_thread(),
        ProcessPoolExecutor(workers, context, initializer=begin_worker) as pool,
    ):
        try:
            for task in tasks:
                waiting.append(pool.submit(make, plan, info, out, task))
                if len(waiting) >= (1 + _AHEAD) * workers:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        except BrokenProcessPool as error:
            rule, advice = "must live as long as the run", "Start it again: it goes on from here."
            raise errors.refuse("worker", rule, "one that was killed", advice) from error
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


@contextmanager
def _one_thread() -> Iterator[None]:
    """Set the environment so that processes started inside use one thread per library."""
    before = {name: os.environ.get(name) for name in _ONE_THREAD}
    os.environ.update(dict.fromkeys(_ONE_THREAD, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
