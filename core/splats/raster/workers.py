"""Threads that launch native kernels, which release the interpreter's lock."""

from __future__ import annotations

import queue
import threading
import weakref
from collections.abc import Callable, Sequence

Task = Callable[[], None]


class WorkerPool:
    """A pool of `threads` workers, counting the calling thread; waiting costs no processor time."""

    def __init__(self, threads: int) -> None:
        self.threads = threads
        self._tasks: list[queue.SimpleQueue[Task | None]] = [queue.SimpleQueue() for _ in range(threads - 1)]
        self._results: queue.SimpleQueue[BaseException | None] = queue.SimpleQueue()
        for tasks in self._tasks:
            threading.Thread(target=_serve, args=(tasks, self._results), daemon=True, name="raster").start()
        weakref.finalize(self, _stop, self._tasks)

    def run(self, tasks: Sequence[Task]) -> None:
        """Run at most `threads` tasks at once, the first in the calling thread; returns when all have ended."""
        first, *others = tasks
        started = 0
        try:
            for inbox, task in zip(self._tasks, others, strict=False):
                inbox.put(task)
                started += 1
            first()
        finally:  # also if a signal handler raises: nothing may keep running on the caller's arrays
            errors = [self._results.get() for _ in range(started)]
        for error in errors:
            if error is not None:
                raise error


def _serve(tasks: queue.SimpleQueue[Task | None], results: queue.SimpleQueue[BaseException | None]) -> None:
    while (task := tasks.get()) is not None:
        try:
            task()
        except BaseException as error:  # raised again in the calling thread
            results.put(error)
        else:
            results.put(None)


def _stop(queues: Sequence[queue.SimpleQueue[Task | None]]) -> None:
    for tasks in queues:
        tasks.put(None)
