"""Worker processes: thread counts, and their end with the parent process."""

from __future__ import annotations

import multiprocessing
import os
import threading


def cores() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0))


def begin_worker() -> None:
    """Limit this process to one core, and end it when its parent process ends.

    Otherwise the workers of a killed process would wait for further tasks and hold memory.
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
    """Limit this process to one core; other workers use the remaining cores."""
    import cv2

    from starling.sim.render import backend

    cv2.setNumThreads(1)
    if backend.is_jit():
        backend.drjit().set_thread_count(1)
