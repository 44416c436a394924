"""Tasks of consecutive views, and the workers that render them: processes here, or a Ray cluster.

Ray distributes tasks, restarts lost ones and holds the results. Another node repeats the unfinished
tasks of a node that died. Frames come from the same code as on one machine. Nodes need the project
installed, and the plan's files at the same paths.
"""

from __future__ import annotations

import os
import socket
from collections import deque
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from starling.patterns import errors
from starling.sim.captures.info import CaptureInfo
from starling.sim.console import output
from starling.sim.console.threads import Workers, single_threaded
from starling.sim.datasets.plan import Plan
from starling.sim.datasets.render_view import RenderedView, Row, render

_QUEUED = 2  # Queued tasks per worker; limits the memory of results that wait to be written.
_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
_AHEAD = 2  # Tasks in progress per core; limits the memory of results that wait to be written.
_PULSE_S = 1.0  # Interval between probes of Ray's process on this node [s].
_PATIENCE_S = 5.0  # Timeout for the cluster's address to answer [s].


@dataclass(frozen=True, kw_only=True, slots=True)
class Task:
    """The views of one shard."""

    number: int
    views: tuple[int, ...]


@dataclass(frozen=True, kw_only=True, slots=True)
class TaskResult:
    """Views that a worker rendered for a task."""

    number: int
    views: tuple[RenderedView, ...]
    skipped: tuple[dict[str, Any], ...] = ()  # Views whose scene is missing, with the reason.

    @property
    def rows(self) -> list[Row]:
        """Rows of the index for all frames."""
        return [row for view in self.views for row in view.rows]


def tasks(plan: Plan, frames: int) -> list[Task]:
    """Split a plan's views, in order, into tasks of `frames` frames, at least one view each."""
    size = max(1, frames // plan.frames)
    count = plan.scenes * plan.views
    return [
        Task(number=number, views=tuple(range(begin, min(begin + size, count))))
        for number, begin in enumerate(range(0, count, size))
    ]


def make(
    plan: Plan, info: CaptureInfo, out: Path, task: Task, *, on_disk: bool = False
) -> TaskResult:
    """Render a task's views (arguments as in `render_view.render`).

    Raises:
        InputError: as `render_view.render`, if the plan says `missing = "stop"`.
        OSError: as `render_view.render`.
    """
    views: list[RenderedView] = []
    skipped: list[dict[str, Any]] = []
    for number in task.views:
        try:
            views.append(render(plan, number, info, out, on_disk=on_disk))
        except errors.InputError as error:
            if plan.missing == "stop":
                raise
            skipped.append({"view": number, "why": str(error)})
    return TaskResult(number=task.number, views=tuple(views), skipped=tuple(skipped))


def run_locally(
    plan: Plan,
    info: CaptureInfo,
    out: Path,
    tasks: Sequence[Task],
    workers: int,
    *,
    on_disk: bool = False,
) -> Generator[TaskResult]:
    """Run tasks and yield their results in the order of the tasks.

    Args:
        plan, info, out: as in `render_view.render`.
        tasks: tasks of the plan.
        workers: largest number of processes; each uses one thread.
        on_disk: as in `render_view.render`.

    Raises:
        InputError: as `make`, or if a process died or could not write.
    """
    workers = max(1, min(workers, len(tasks)))
    waiting: deque[Future[TaskResult]] = deque()
    with output.refused(out), _one_thread(), Workers(workers) as pool:
        try:
            for task in tasks:
                waiting.append(pool.submit(make, plan, info, out, task, on_disk=on_disk))
                if len(waiting) >= (1 + _QUEUED) * workers:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        except BrokenProcessPool as error:
            raise _lost("worker", "one that was killed") from error


def _lost(name: str, got: str) -> errors.InputError:
    rule, advice = "must live as long as the run", "Start it again: it goes on from here."
    return errors.refuse(name, rule, got, advice)


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


def run_on_ray(
    plan: Plan, info: CaptureInfo, out: Path, tasks: Sequence[Task], address: str
) -> Generator[TaskResult]:
    """Run tasks and yield their results as they arrive.

    Args:
        plan, info, out: as in `render_view.render`.
        tasks: tasks of the plan.
        address: HOST:PORT of a cluster, or `local` for one on this machine that ends with the run.

    Raises:
        InputError: as `make`, or if Ray is not installed, does not start or dies, or the address
            does not answer.
    """
    ray = _ray()
    _refuse_silent(address)
    quiet = {"log_to_driver": False, "include_dashboard": False, "logging_level": "ERROR"}
    try:
        ray.init(address=address, **quiet)
    except Exception as error:  # Ray raises errors of many types, also a plain `Exception`.
        remedy = "Give the head of a cluster with this version of Ray and the same RAY_AUTH_TOKEN."
        if address == "local":
            remedy = "Start it again, or leave --ray out: processes of this machine then work."
        raise errors.refuse("ray", "must accept this run", f"{address}: {error}", remedy) from error
    try:
        work = ray.remote(num_cpus=1, max_retries=-1)(_make)
        shared = ray.put((plan, info, out))
        own_node = _own_node(ray)
        most = _AHEAD * max(1, int(ray.cluster_resources().get("CPU", 1)))
        waiting = list(tasks)[::-1]
        running: list[Any] = []
        while waiting or running:
            while waiting and len(running) < most:
                running.append(work.remote(shared, waiting.pop()))
            ready: list[Any] = []
            while not ready:
                _refuse_dead(address, own_node)
                ready, running = ray.wait(running, num_returns=1, timeout=_PULSE_S)
            yield _result(ray, ready[0])
    except ray.exceptions.RayTaskError:  # An error of the task, not of Ray.
        raise
    except ray.exceptions.RayError as error:
        raise _lost("ray", f"{address}: {type(error).__name__}") from error
    finally:
        ray.shutdown()


def _own_node(ray: Any) -> tuple[str, int]:
    """Return host and port of Ray's process on this node."""
    identifier = ray.get_runtime_context().get_node_id()
    (node,) = (node for node in ray.nodes() if node["NodeID"] == identifier)
    return node["NodeManagerAddress"], node["NodeManagerPort"]


def _refuse_dead(address: str, own_node: tuple[str, int]) -> None:
    """Refuse a dead process of Ray on this node.

    Some seconds after its death, Ray ends this process without an error.
    """
    try:
        socket.create_connection(own_node, timeout=_PATIENCE_S).close()
    except ConnectionRefusedError as error:
        raise _lost("ray", f"{address}: its process on this node died") from error
    except OSError:  # A slow answer is no death.
        pass


def _make(shared: tuple[Plan, CaptureInfo, Path], task: Task) -> TaskResult:
    single_threaded()
    return make(*shared, task)


def _result(ray: Any, ready: Any) -> TaskResult:
    try:
        return ray.get(ready)
    except ray.exceptions.RayTaskError as error:
        if isinstance(error.cause, errors.InputError):
            raise error.cause from None
        raise


def _refuse_silent(address: str) -> None:
    """Refuse an address that does not answer; Ray itself takes minutes to report it."""
    if address == "local":
        return
    host, _, port = address.rpartition(":")
    if not host or not port.isdigit():
        raise errors.refuse("ray", "must be HOST:PORT or local", address, "As 10.0.0.1:6379.")
    try:
        socket.create_connection((host, int(port)), timeout=_PATIENCE_S).close()
    except OSError as error:
        remedy = "Start it: ray start --head --port 6379."
        raise errors.refuse("ray", "must answer", f"{address}: {error}", remedy) from error


def _ray() -> Any:
    try:
        import ray
    except ImportError as error:
        raise errors.needs("cluster", "ray", "ray") from error
    return ray
