"""Shared fixtures of all tests: threads, hypothesis profiles, real captures, and the GPU."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import settings

# Each worker of pytest-xdist has one core. Threads that wait for others there would waste it.
if "PYTEST_XDIST_WORKER" in os.environ:
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")

ROOT = Path(__file__).parents[1]

# Rendering takes its time, so no example has a deadline. CI draws half of the usual examples, the
# same ones every time.
settings.register_profile("dev", deadline=None)
settings.register_profile("ci", deadline=None, derandomize=True, max_examples=50)
settings.load_profile("ci" if os.environ.get("CI") else "dev")


@pytest.fixture(scope="session")
def captures() -> Path:
    """Folder of the real capture sets, which may not be redistributed.

    It is `STARLING_CAPTURES`, or else the folder ../*/captures that holds `d415-faro`.
    """
    chosen = os.environ.get("STARLING_CAPTURES")
    if chosen and not Path(chosen).is_dir():
        pytest.skip(f"no real captures at {chosen}; set STARLING_CAPTURES to their folder")
    neighbours = sorted(path.parent for path in ROOT.parent.glob("*/captures/d415-faro"))
    if not chosen and not neighbours:
        pytest.skip("no real captures; set STARLING_CAPTURES to their folder")
    return Path(chosen) if chosen else neighbours[0]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Skip tests marked `gpu` if Dr.Jit finds no CUDA device."""
    marked = [item for item in items if item.get_closest_marker("gpu")]
    if not marked:
        return
    import drjit as dr

    if not dr.has_backend(dr.JitBackend.CUDA):
        for item in marked:
            item.add_marker(pytest.mark.skip(reason="no CUDA device"))
