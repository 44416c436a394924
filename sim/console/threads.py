"""Processes that share a machine: how many threads they use, and when they end."""

from __future__ import annotations

import multiprocessing
import os
import threading


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0))


def begin_worker() -> None:
    """Let this process use one core, and end it when the one that began it ends, however that was.

    Workers of a process that was killed would wait for its next order, and hold their memory.
    """
    single_threaded()
    parent = multiprocessing.parent_process()
    if parent is None:
        return

    def watch() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def single_threaded() -> None:
    """Let this process use one core, as others use the rest."""
    import cv2

    from starling.sim.render import backend

    cv2.setNumThreads(1)
    if backend.is_jit():
        backend.drjit().set_thread_count(1)
