"""Long runs of `starling generate`: killed again and again, and on a cluster that loses a node."""

from __future__ import annotations

import os
import random
import secrets
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from starling.sim.datasets.generate import generate
from tests.system.test_generate import ROOT, content, kill, start, write

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(tmp_path_factory.mktemp("plan"))


@pytest.fixture(scope="module")
def whole(plan: Path) -> Path:
    out = plan.parent / "whole"
    generate(plan, out, workers=1, shard_frames=4)
    return out


def test_run_killed_at_random_times_resumes_to_the_same_set(plan: Path, whole: Path):
    out = plan.parent / "killed often"
    rng = random.Random(20)
    for _ in range(20):
        run = start(plan, out)
        time.sleep(rng.uniform(1.0, 12.0))
        kill(run)
    generate(plan, out, workers=1, shard_frames=4)
    assert content(out) == content(whole)


def test_cluster_that_loses_a_node_gives_the_same_set(plan: Path, whole: Path):
    """Runs a head and a second node on this machine; the node is killed while it works."""
    pytest.importorskip("ray")
    out, port = plan.parent / "ray", "26399"
    tool = [str(Path(sys.executable).with_name("ray"))]
    # A cluster of the test's own, which lets nobody else in.
    secret = {"RAY_AUTH_MODE": "token", "RAY_AUTH_TOKEN": secrets.token_hex(32)}
    environment = {**os.environ, **secret, "PYTHONPATH": str(ROOT)}
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "env": environment}
    start = [*tool, "start", "--num-cpus", "1", "--include-dashboard", "false"]
    subprocess.run([*start, "--head", "--port", port], check=True, **quiet)
    node = subprocess.Popen(
        [*tool, "start", "--num-cpus", "1", "--address", f"127.0.0.1:{port}", "--block"],
        start_new_session=True,
        **quiet,
    )
    try:
        time.sleep(8)
        command = [sys.executable, "-m", "starling", "generate", str(plan)]
        command += ["--out", str(out), "--ray", f"127.0.0.1:{port}", "--shard-frames", "4"]
        with (plan.parent / "ray.log").open("w+") as message:
            run = subprocess.Popen(command, env=environment, stderr=message, stdout=message)
            deadline = time.monotonic() + 240
            while not list(out.glob(".parts/*.json")) and time.monotonic() < deadline:
                assert run.poll() is None, Path(message.name).read_text()
                time.sleep(0.2)
            os.killpg(node.pid, signal.SIGKILL)
            assert run.wait(timeout=300) == 0
    finally:
        subprocess.run([*tool, "stop", "--force"], check=False, **quiet)
        node.wait()
    assert content(out) == content(whole)
