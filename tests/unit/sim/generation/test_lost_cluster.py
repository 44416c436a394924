"""A cluster that does not start or dies ends a run in one line."""

from __future__ import annotations

import socket
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from starling.patterns.errors import InputError
from starling.sim.captures.writer import info_of
from starling.sim.datasets import plan as plans
from starling.sim.datasets import workers
from starling.sim.datasets.workers import TaskResult
from starling.sim.sensor import presets

PLAN: dict[str, Any] = {
    "seed": 1,
    "scenes": 1,
    "source": [{"kind": "builtin", "scene": "wall", "number": 1.0}],
    "sensor": [{"preset": "d435"}],
}


class RayError(Exception):
    """Base of Ray's errors."""


class RayTaskError(RayError):
    """Error that a task raised."""

    def __init__(self, cause: Exception) -> None:
        super().__init__(str(cause))
        self.cause = cause


class LocalRayletDiedError(RayError):
    """The process of Ray on this node died."""


class FakeRay:
    """The functions of Ray that a run uses; `begin` and `give` fail as the test wants."""

    exceptions = SimpleNamespace(RayError=RayError, RayTaskError=RayTaskError)

    def __init__(self, begin: Callable[[], None], give: Callable[[], TaskResult]) -> None:
        self.begin, self.give, self.closed = begin, give, False
        self.server = socket.create_server(("127.0.0.1", 0))  # Ray's process on this node.

    def init(self, **_: Any) -> None:
        self.begin()

    def remote(self, **_: Any) -> Callable[[Any], Any]:
        return lambda _: SimpleNamespace(remote=lambda *_: "task")

    def put(self, value: Any) -> Any:
        return value

    def cluster_resources(self) -> dict[str, float]:
        return {"CPU": 1.0}

    def get_runtime_context(self) -> Any:
        return SimpleNamespace(get_node_id=lambda: "own")

    def nodes(self) -> list[dict[str, Any]]:
        host, port = self.server.getsockname()
        local = {"NodeID": "own", "NodeManagerAddress": host, "NodeManagerPort": port}
        return [local, {**local, "NodeID": "other", "NodeManagerPort": 1}]

    def wait(
        self, running: list[Any], *, num_returns: int, timeout: float
    ) -> tuple[list[Any], list[Any]]:
        assert timeout > 0
        return running[:num_returns], running[num_returns:]

    def get(self, _: Any) -> TaskResult:
        return self.give()

    def shutdown(self) -> None:
        self.server.close()
        self.closed = True


def throws(error: Exception) -> Callable[[], Any]:
    def thrower() -> None:
        raise error

    return thrower


def run(ray: FakeRay, monkeypatch: pytest.MonkeyPatch, address: str = "local") -> list[TaskResult]:
    monkeypatch.setattr(workers, "_ray", lambda: ray)
    plan = plans.from_table(PLAN, Path("."))
    info = info_of(presets.load("d435"), source="a", licence="b", notes="")
    return list(workers.run_on_ray(plan, info, Path("out"), workers.tasks(plan, 1), address))


def test_a_dead_cluster_is_refused_as_a_dead_worker_is(monkeypatch: pytest.MonkeyPatch):
    ray = FakeRay(lambda: None, throws(LocalRayletDiedError("The raylet died")))
    message = (
        r"^ray must live as long as the run; got local: LocalRayletDiedError\. "
        r"Start it again: it goes on from here\.$"
    )
    with pytest.raises(InputError, match=message):
        run(ray, monkeypatch)
    assert ray.closed


def test_a_dead_process_on_this_node_is_refused(monkeypatch: pytest.MonkeyPatch):
    ray = FakeRay(lambda: None, throws(AssertionError()))
    nodes = ray.nodes()
    monkeypatch.setattr(ray, "nodes", lambda: nodes)
    ray.server.close()
    with pytest.raises(InputError, match="got local: its process on this node died"):
        run(ray, monkeypatch)
    assert ray.closed


@pytest.mark.parametrize("error", [Exception("timed out"), RuntimeError("a"), ConnectionError("b")])
def test_a_cluster_that_does_not_start_is_refused(
    error: Exception, monkeypatch: pytest.MonkeyPatch
):
    ray = FakeRay(throws(error), throws(AssertionError()))
    with pytest.raises(InputError, match=r"^ray must accept this run; got local: .*leave --ray"):
        run(ray, monkeypatch)
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = f"127.0.0.1:{server.getsockname()[1]}"
        with pytest.raises(InputError, match=r"ray must accept this run; .*Give the head of a clu"):
            run(ray, monkeypatch, address)


def test_errors_of_a_task_stay_what_they_are(monkeypatch: pytest.MonkeyPatch):
    refused = FakeRay(lambda: None, throws(RayTaskError(InputError("mesh must exist"))))
    with pytest.raises(InputError, match=r"^mesh must exist$"):
        run(refused, monkeypatch)
    broken = FakeRay(lambda: None, throws(RayTaskError(KeyError("a"))))
    with pytest.raises(RayTaskError):
        run(broken, monkeypatch)


def test_results_pass(monkeypatch: pytest.MonkeyPatch):
    result = TaskResult(number=0, views=())
    assert run(FakeRay(lambda: None, lambda: result), monkeypatch) == [result]
