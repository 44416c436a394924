"""Tasks made by a Ray cluster: what a node had not finished when it died is made by another.

Ray deals tasks, restarts those that were lost, and holds what comes back; a frame is made by the
same code as on one machine. Nodes need the project installed, and files of a plan where they stand.
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
from starling.sim.datasets.task import Made, Task, make

_AHEAD = 2  # Tasks for each core that are under way: what comes back must not pile up.
_PATIENCE_S = 5.0  # For a cluster's address to answer.


def made(
    plan: Plan, info: CaptureInfo, out: Path, tasks: Sequence[Task], address: str
) -> Iterator[Made]:
    """Make tasks, and give them as they come.

    Args:
        plan, info, out: as `taken.take`.
        tasks: of the plan.
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
        remedy = "Is it a cluster's head, of this Ray's version and with the same RAY_AUTH_TOKEN?"
        raise errors.refuse("ray", "must let this run in", f"{address}: {error}", remedy) from error
    try:
        work = ray.remote(num_cpus=1, max_retries=-1)(_make)
        asked = ray.put((plan, info, out))
        most = _AHEAD * max(1, int(ray.cluster_resources().get("CPU", 1)))
        waiting = list(tasks)[::-1]
        running: list[Any] = []
        while waiting or running:
            while waiting and len(running) < most:
                running.append(work.remote(asked, waiting.pop()))
            ready, running = ray.wait(running, num_returns=1)
            yield _result(ray, ready[0])
    finally:
        ray.shutdown()


def _make(asked: tuple[Plan, CaptureInfo, Path], task: Task) -> Made:
    single_threaded()
    return make(*asked, task)


def _result(ray: Any, ready: Any) -> Made:
    try:
        return ray.get(ready)
    except ray.exceptions.RayTaskError as error:
        if isinstance(error.cause, errors.InputError):
            raise error.cause from None
        raise


def _refuse_silent(address: str) -> None:
    """Refuse an address that does not answer, which Ray itself takes minutes to say."""
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
