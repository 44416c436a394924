"""How many threads libraries use in processes that share a machine."""

from __future__ import annotations

import os


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0))


def single_threaded() -> None:
    """Let this process use one core, as others use the rest."""
    import cv2

    from sim import backend

    cv2.setNumThreads(1)
    if backend.is_jit():
        backend.drjit().set_thread_count(1)
