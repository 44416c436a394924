"""Tasks made by processes of this machine, a core each."""

from __future__ import annotations

import multiprocessing
import os
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from pathlib import Path

from patterns import errors
from sim.capture_info import CaptureInfo
from sim.generation.plan import Plan
from sim.generation.task import Made, Task, Worker
from sim.threads import single_threaded

_AHEAD = 2  # Tasks that wait for each worker: what is made faster than written must not pile up.
_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")

_worker: dict[str, Worker] = {}  # Of a process: its only one.


def made(
    plan: Plan, info: CaptureInfo, out: Path, tasks: Sequence[Task], workers: int
) -> Iterator[Made]:
    """Make tasks, and give them in their order.

    Args:
        plan, info, out: as `taken.take`.
        tasks: of the plan.
        workers: processes at most; each has one thread of every library.

    Raises:
        InputError: as `Worker.make`, or if a process died.
    """
    workers = max(1, min(workers, len(tasks)))
    context = multiprocessing.get_context("spawn")
    waiting: deque[Future[Made]] = deque()
    with (
        _one_thread(),
        ProcessPoolExecutor(
            workers, context, initializer=_begin, initargs=(plan, info, out)
        ) as pool,
    ):
        try:
            for task in tasks:
                waiting.append(pool.submit(_make, task))
                if len(waiting) >= (1 + _AHEAD) * workers:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        except BrokenProcessPool as error:
            rule, advice = "must live as long as the run", "Start it again: it goes on from here."
            raise errors.refuse("worker", rule, "one that was killed", advice) from error
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


def _begin(plan: Plan, info: CaptureInfo, out: Path) -> None:
    single_threaded()
    _worker["own"] = Worker(plan, info, out)


def _make(task: Task) -> Made:
    return _worker["own"].make(task)


@contextmanager
def _one_thread() -> Iterator[None]:
    """What processes that begin now are told by their environment."""
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


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0))
