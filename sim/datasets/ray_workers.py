"""Workers on a Ray cluster; another node repeats the unfinished tasks of a node that died.

Ray distributes tasks, restarts lost ones and holds the results. Frames come from the same code as
on one machine. Nodes need the project installed, and the plan's files at the same paths.
"""

from __future__ import annotations

import socket
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from starling.patterns import errors
from starling.sim.captures.info import CaptureInfo
from starling.sim.console.threads import single_threaded
from starling.sim.datasets.plan import Plan
from starling.sim.datasets.task import Task, TaskResult, make

_AHEAD = 2  # Tasks in progress per core; limits the memory of results that wait to be written.
_PATIENCE_S = 5.0  # Timeout for the cluster's address to answer [s].


def run(
    plan: Plan, info: CaptureInfo, out: Path, tasks: Sequence[Task], address: str
) -> Iterator[TaskResult]:
    """Run tasks and yield their results as they arrive.

    Args:
        plan, info, out: as in `render_view.render`.
        tasks: tasks of the plan.
        address: HOST:PORT of a cluster, or `local` for one on this machine that ends with the run.

    Raises:
        InputError: as `task.make`, or if Ray is not installed or the address does not answer.
    """
    ray = _ray()
    _refuse_silent(address)
    quiet = {"log_to_driver": False, "include_dashboard": False, "logging_level": "ERROR"}
    try:
        ray.init(address=address, **quiet)
    except ConnectionError as error:
        remedy = "Give the head of a cluster with this version of Ray and the same RAY_AUTH_TOKEN."
        raise errors.refuse("ray", "must accept this run", f"{address}: {error}", remedy) from error
    try:
        work = ray.remote(num_cpus=1, max_retries=-1)(_make)
        shared = ray.put((plan, info, out))
        most = _AHEAD * max(1, int(ray.cluster_resources().get("CPU", 1)))
        waiting = list(tasks)[::-1]
        running: list[Any] = []
        while waiting or running:
            while waiting and len(running) < most:
                running.append(work.remote(shared, waiting.pop()))
            ready, running = ray.wait(running, num_returns=1)
            yield _result(ray, ready[0])
    finally:
        ray.shutdown()


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
