"""Work that goes on while Blender's window stays alive: a thread that follows worker processes. No bpy.

The thread never touches Blender's data. What it hears waits in a queue until the main thread asks with `poll`.
"""

from __future__ import annotations

import queue
import sys
import threading
import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any

from ..core.errors import Cancelled, InputError
from ..core.runtime.process import Event, Workers
from ..core.runtime.progress import RunProgress
from ..core.runtime.supervisor import Listener, WorkerDefect

# A worker has 1.2 s to end by itself (`core.runtime.process`); then its folder is tidied up.
_END_SECONDS = 4.0

Work = Callable[[Workers, Listener], Any]
"""Uses the workers that it is given, tells a listener of their events, and returns the result."""


class State(Enum):
    """Where a background job stands."""

    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"
    CANCELLED = "cancelled"


@dataclass(frozen=True)
class _End:
    """How the thread ended."""

    state: State
    result: Any = None
    problem: str = ""


class BackgroundJob:
    """A piece of work in a thread of its own; everything but the work itself is for the main thread.

    Args:
        title: what the user reads.
        work: does it.
        workers: that the work may use; cancelling ends them.
        stages: that the work reports, in order, for the progress of the whole.
        expected: seconds by stage, of which the ratios count; None takes what the worker forecasts.

    Attributes:
        title: what the user reads.
        state: as of the last `poll`.
        progress: of the whole work.
        warnings: what the workers warned of.
        preview: path of the latest picture that a worker showed, or "".
        previews: how many pictures there were.
        result: of the work, once it is done.
        problem: one line, once it has failed.
        is_cancelling: whether `cancel` was called.
    """

    def __init__(
        self,
        title: str,
        work: Work,
        workers: Workers,
        stages: tuple[str, ...],
        expected: Mapping[str, float] | None = None,
    ) -> None:
        self.title = title
        self.state = State.RUNNING
        self.progress = RunProgress(stages, expected=expected)
        self.warnings: list[str] = []
        self.preview, self.previews = "", 0
        self.result: Any = None
        self.problem = ""
        self.is_cancelling = False
        self._workers = workers
        self._heard: queue.SimpleQueue[Event | _End] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._run, args=(work,), name=title, daemon=True)
        self._thread.start()

    def _run(self, work: Work) -> None:
        try:
            end = _End(State.DONE, work(self._workers, self._heard.put))
        except (InputError, WorkerDefect) as error:
            end = _End(State.FAILED, problem=str(error))
        except Cancelled:
            end = _End(State.CANCELLED)
        except Exception as error:
            traceback.print_exc(file=sys.stderr)
            end = _End(State.FAILED, problem=f"{type(error).__name__}: {error} - this is a bug in the add-on")
        self._heard.put(end)

    @property
    def is_running(self) -> bool:
        return self.state is State.RUNNING

    def poll(self) -> bool:
        """Take in what the thread has heard since; returns whether there was anything. Never waits."""
        changed = False
        while True:
            try:
                heard = self._heard.get_nowait()
            except queue.Empty:
                return changed
            changed = True
            if isinstance(heard, _End):
                self.state, self.result, self.problem = heard.state, heard.result, heard.problem
            else:
                self._take_in(heard)

    def _take_in(self, event: Event) -> None:
        kind = event["event"]
        if kind == "warning":
            self.warnings.append(str(event["message"]))
        elif kind == "preview":
            self.preview, self.previews = str(event["file"]), self.previews + 1
        else:
            self.progress.update(event)

    def cancel(self) -> None:
        """Ask the work to end; returns at once, and a later `poll` tells when it has."""
        self.is_cancelling = True
        self._workers.cancel()

    def wait(self) -> None:
        """Wait until the work has ended, and take in how."""
        self._thread.join()
        self.poll()

    def end(self) -> None:
        """Cancel the work and wait until it has cleaned up behind itself."""
        self.cancel()
        self._thread.join(_END_SECONDS)
        self.poll()
