"""The background jobs of this Blender: polled by a timer, shown in the panels, ended with the file or with Blender.

A running process has no place in Blender's data. `ACTIVITY` and `pictures.PICTURES` are what of the add-on outlives a
call.
"""

from __future__ import annotations

import atexit
from collections.abc import Callable
from dataclasses import dataclass

import bpy

from .background import BackgroundJob
from .messages import show_problem

_INTERVAL = 0.1  # seconds between looks at the jobs; progress is reported every 0.2

Hook = Callable[[BackgroundJob], None]


@dataclass
class _Entry:
    job: BackgroundJob
    on_end: Hook
    on_change: Hook
    ends_with_file: bool


class Activity:
    """Background jobs by name; of each name one runs at a time, and the last one stays to be looked at."""

    def __init__(self) -> None:
        self._entries: dict[str, _Entry] = {}

        @bpy.app.handlers.persistent
        def after_load(*_: object) -> None:
            # Not before: a file that cannot be read leaves the one that is open, and its jobs, as they are. While a
            # file loads nobody looks at the jobs, and no scene of the new one has the `session_uid` of an old one.
            self._end_with_file()

        # Blender knows timers and handlers by identity, and every access to a method makes another object.
        self._timer, self._after_load = self.look, after_load

    def start(
        self,
        name: str,
        job: BackgroundJob,
        on_end: Hook,
        *,
        on_change: Hook = lambda _: None,
        ends_with_file: bool = False,
    ) -> None:
        """Follow `job`; one of the same name that still runs is cancelled.

        Args:
            on_end: called on the main thread when the job has ended, however it did.
            on_change: called on the main thread when the running job was heard of.
            ends_with_file: whether the job belongs to the open file.
        """
        self.drop(name)
        self._entries[name] = _Entry(job, on_end, on_change, ends_with_file)
        if not bpy.app.timers.is_registered(self._timer):
            bpy.app.timers.register(self._timer, first_interval=_INTERVAL, persistent=True)

    def job(self, name: str) -> BackgroundJob | None:
        """The job of that name that runs or ran last."""
        entry = self._entries.get(name)
        return entry.job if entry else None

    def running(self, name: str) -> BackgroundJob | None:
        """The job of that name, if it still runs."""
        job = self.job(name)
        return job if job is not None and job.is_running else None

    def drop(self, name: str) -> None:
        """Cancel the job of that name and forget it, without waiting for its end; `on_end` is not called."""
        entry = self._entries.pop(name, None)
        if entry is not None and entry.job.is_running:
            entry.job.cancel()

    def is_busy(self) -> bool:
        """Whether any job runs."""
        return any(entry.job.is_running for entry in self._entries.values())

    def end(self, name: str) -> None:
        """End the job of that name, wait for it, and forget it; `on_end` is not called."""
        entry = self._entries.pop(name, None)
        if entry is not None and entry.job.is_running:
            entry.job.end()

    def end_all(self) -> None:
        """End every job and forget it."""
        for entry in self._entries.values():
            entry.job.cancel()
        for name in list(self._entries):
            self.end(name)

    def register(self) -> None:
        """Let the jobs end with the file or with Blender."""
        bpy.app.handlers.load_post.append(self._after_load)
        atexit.register(self.end_all)

    def unregister(self) -> None:
        """End all jobs and leave nothing behind in Blender."""
        self.end_all()
        if bpy.app.timers.is_registered(self._timer):
            bpy.app.timers.unregister(self._timer)
        if self._after_load in bpy.app.handlers.load_post:
            bpy.app.handlers.load_post.remove(self._after_load)
        atexit.unregister(self.end_all)

    def _end_with_file(self) -> None:
        for name in [name for name, entry in self._entries.items() if entry.ends_with_file]:
            self.end(name)

    def look(self) -> float | None:
        """Take in what has happened; returns the seconds to the next look, or None, as Blender's timers want it."""
        entries = list(self._entries.values())
        for entry in entries:
            if entry.job.is_running and entry.job.poll():
                _call(entry.on_change if entry.job.is_running else entry.on_end, entry.job)
                redraw_panels()
        return _INTERVAL if self.is_busy() else None


ACTIVITY = Activity()


def redraw_panels() -> None:
    """Draw the side bars of the 3D views and the preferences anew, and nothing that takes long."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            for region in area.regions:
                if (area.type, region.type) in (("VIEW_3D", "UI"), ("PREFERENCES", "WINDOW")):
                    region.tag_redraw()


def remember_for_undo(title: str) -> None:
    """Make what a background job did to the file a step that the user can undo."""
    windows = bpy.context.window_manager.windows
    if not bpy.app.background and windows:
        with bpy.context.temp_override(window=windows[0]):  # a timer has none
            bpy.ops.ed.undo_push(message=title)


def _call(hook: Hook, job: BackgroundJob) -> None:
    try:
        hook(job)
    except Exception as error:  # Blender's timers only print
        show_problem(job.title, f"{type(error).__name__}: {error} - this is a bug in the add-on")
        raise


def scene_by_uid(session_uid: int) -> bpy.types.Scene | None:
    """The scene with this `bpy.types.ID.session_uid`, whatever it is called by now; None where it is gone."""
    return next((scene for scene in bpy.data.scenes if scene.session_uid == session_uid), None)
