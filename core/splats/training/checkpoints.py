"""Checkpoints: the whole state of a training run on disk, from which a run that was broken off goes on."""

from __future__ import annotations

import contextlib
import hashlib
import json
import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError

from .... import __version__
from ...capture.model import View
from ...errors import Cancelled
from ...files.states import SavedState, State, read_state, write_state
from ...files.untrusted import explained, replacing
from ...runs.layout import CHECKPOINT_CAPTURE_FILE, CHECKPOINT_RUN_FILE, CHECKPOINT_STATE_FILE

_LEAST_SECONDS = 30.0  # of training since the last checkpoint, from which a cancelled or finished one leaves another
_FORMAT = "cvdgs-checkpoint-4"  # another one whenever the trainer's state or its steps change
_MOST_BYTES = 16 << 30  # 23 million Gaussians of degree 3 with their moments
_WHAT, _REMEDY = "the checkpoint", "run again without --resume"


BetweenSteps = Callable[[Callable[[], State], bool], None]
"""Is called after each step, with what makes the state, and whether the step was the last one."""


def fingerprint(
    plan: Any,
    seed: int,
    views: Sequence[View],
    held_out: Sequence[View],
    points: NDArray[np.float32],
    colors: NDArray[np.uint8],
) -> str:
    """What a checkpoint has to agree on with a run: the format, the version, the plan, and all that is fitted."""
    digest = hashlib.sha256(f"{_FORMAT} {__version__} {seed} {len(views)} {len(held_out)}\n{plan!r}\n".encode())
    for view in (*views, *held_out):
        parts = (view.world_to_camera, view.image, view.alpha, view.mask, view.smear)
        there = [array is not None for array in parts]
        digest.update(f"{view.key} {view.camera!r} {view.image.shape} {there}\n".encode())
        for part in parts:
            digest.update(b"" if part is None else np.ascontiguousarray(part).tobytes())
    for array in (points, colors):
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


class Checkpoints:
    """The checkpoint of one run, replaced by the next one; a broken-off run leaves it in its folder.

    Args:
        folder: to write into; made when it is needed.
        described: what can be said of the run without reading its state, as JSON: its version and settings.
        resume: whether to go on from the checkpoint that is there.
        warn: told in one line why a checkpoint cannot be used.
        every_seconds: between two of them.
    """

    def __init__(
        self,
        folder: Path,
        described: Mapping[str, Any],
        *,
        resume: bool,
        warn: Callable[[str], None],
        every_seconds: float,
    ) -> None:
        self._folder, self._described, self._resume, self._warn = folder, described, resume, warn
        self._every = every_seconds
        self._run = ""
        self._began = False
        self._latest = time.monotonic()

    def saved(self, run: str) -> SavedState | None:
        """The state of the run with this `fingerprint` to go on from; None where there is none.

        Raises:
            InputError: the checkpoint is damaged.
        """
        self._run = run
        path = self._folder / CHECKPOINT_STATE_FILE
        if not self._resume or not path.exists():
            return None
        metadata, state = read_state(path, _WHAT, _REMEDY, most_bytes=_MOST_BYTES)
        if metadata.get("run") != run:
            self._warn("the checkpoint is of other photographs, cameras or settings; the run starts anew")
            return None
        self._began = True  # the files beside it are this run's
        return state

    def save(self, state: State) -> None:
        """Replace the checkpoint; what cannot be written is said, and the run goes on without."""
        self._write(CHECKPOINT_STATE_FILE, state, self._run)
        self._latest = time.monotonic()

    def kept_capture(self, made_of: Callable[[], str]) -> SavedState | None:
        """What `keep_capture` has kept, to go on from; None where that is nothing, or was made of something else.

        Args:
            made_of: is called where something was kept.

        Raises:
            InputError: it is damaged.
        """
        path = self._folder / CHECKPOINT_CAPTURE_FILE
        if not self._resume or not path.exists():
            return None
        metadata, state = read_state(path, "the kept capture", _REMEDY, most_bytes=_MOST_BYTES)
        return state if metadata.get("run") == made_of() else None

    def keep_capture(self, state: State, made_of: str) -> None:
        """Keep what was long in the making before the training, and from what; errors as for `save`."""
        self._write(CHECKPOINT_CAPTURE_FILE, state, made_of)

    def _write(self, name: str, state: State, run: str) -> None:
        try:
            if not self._began:
                self._begin()
            write_state(self._folder / name, state, {"run": run})
        except (OSError, SafetensorError) as error:
            self._warn(f"no checkpoint could be written{explained(error)}")

    @contextlib.contextmanager
    def watching(self) -> Iterator[BetweenSteps]:
        """Gives what is called between two steps, and saves the state when that is due.

        Meanwhile a cancelled run ends between two steps. It leaves a checkpoint if that is worth it, and so does the
        end, since what follows takes its time, too.
        """
        with _deferred_signals() as cancelled:

            def between_steps(make: Callable[[], State], last: bool) -> None:
                wait = min(_LEAST_SECONDS, self._every) if last or cancelled() else self._every
                if time.monotonic() - self._latest >= wait:
                    self.save(make())
                if cancelled():
                    raise Cancelled

            self._latest = time.monotonic()
            yield between_steps

    def _begin(self) -> None:
        """Describe the run, before its first checkpoint."""
        self._folder.mkdir(exist_ok=True)
        (self._folder / CHECKPOINT_STATE_FILE).unlink(missing_ok=True)
        with replacing(self._folder / CHECKPOINT_RUN_FILE) as temporary:
            temporary.write_text(json.dumps(self._described, allow_nan=False), encoding="utf-8")
        self._began = True


def watched(checkpoints: Checkpoints | None) -> contextlib.AbstractContextManager[BetweenSteps]:
    """`Checkpoints.watching`, or where there are none, what does nothing between steps."""
    return checkpoints.watching() if checkpoints else contextlib.nullcontext(lambda make, last: None)


@contextlib.contextmanager
def _deferred_signals() -> Iterator[Callable[[], bool]]:
    """Defer SIGINT and SIGTERM to the end of the block; gives whether one came. Only the main thread gets any.

    Raises:
        Cancelled: one came, at the end of the block.
    """
    received: list[int] = []

    def note(number: int, _: FrameType | None) -> None:
        received.append(number)

    numbers = (signal.SIGINT, signal.SIGTERM) if threading.current_thread() is threading.main_thread() else ()
    before = {number: signal.signal(number, note) for number in numbers}
    try:
        yield lambda: bool(received)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    if received:
        raise Cancelled  # it came after the last look
