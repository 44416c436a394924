"""Worker processes: thread counts, signals, and their end with the parent process."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable
from concurrent.futures import Future, ProcessPoolExecutor
from multiprocessing.connection import Connection
from types import TracebackType
from typing import Any


def cores() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0))


class Workers(ProcessPoolExecutor):
    """Processes of one core each, which end when this process ends or stops its work.

    Without the link, workers of a killed process would wait for further tasks and hold memory. An
    interrupt from the keyboard reaches all processes; workers leave it to this one.
    """

    def __init__(
        self, count: int, begin: Callable[..., None] | None = None, arguments: tuple[Any, ...] = ()
    ) -> None:
        """Prepare the processes, which start with the first job.

        Args:
            count: largest number of processes.
            begin: called first in each process.
            arguments: arguments of `begin`.
        """
        context = multiprocessing.get_context("spawn")
        link, self._link = context.Pipe(duplex=False)
        super().__init__(count, context, initializer=_begin, initargs=(link, begin, arguments))

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Run a function in one of the processes."""
        before = signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT,))  # Workers inherit it.
        try:
            return super().submit(fn, *args, **kwargs)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """End the processes: at once after an error, otherwise after their jobs."""
        if kind is not None:
            self._link.close()
        self.shutdown(cancel_futures=kind is not None)


def _begin(link: Connection, begin: Callable[..., None] | None, arguments: tuple[Any, ...]) -> None:
    def watch() -> None:
        link.poll(None)  # Until the other end is closed.
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
    single_threaded()
    if begin is not None:
        begin(*arguments)


def single_threaded() -> None:
    """Limit this process to one core; other workers use the remaining cores."""
    import cv2

    from starling.sim.render import backend

    cv2.setNumThreads(1)
    if backend.is_jit():
        backend.drjit().set_thread_count(1)
