"""Operators of the preferences: the worker's environment and the cache."""

from __future__ import annotations

import bpy

from ..core.errors import InputError
from ..core.runtime.environment import is_complete
from ..cvdgs_addon import environment
from ..cvdgs_addon.activity import ACTIVITY
from ..cvdgs_addon.preferences import get_cache
from .base import Action


class CVDGS_OT_make_environment(Action, bpy.types.Operator):
    """Download the worker's Python packages into the extension's own folder; removed with the extension"""

    bl_idname = "cvdgs.make_environment"
    bl_label = "Set Up Worker"
    bl_options = set()

    @classmethod
    def missing(cls, _context: bpy.types.Context) -> str:
        if ACTIVITY.running(environment.MAKE_JOB):
            return "The worker is already being set up"
        if is_complete(environment.environment_folder()):  # setting up begins, and a failure ends, with deleting it
            return "The worker is set up; Remove Worker first to set it up anew"
        return "" if bpy.app.online_access else "Allow Online Access in Preferences > System > Network first"

    def act(self, _context: bpy.types.Context) -> None:
        if not bpy.app.online_access:
            remedy = "allow it under Preferences > System > Network"
            raise InputError("online access is not allowed", remedy=remedy)
        environment.start_making(environment.find_base_python())

    def on_click(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str] | None:
        environment.find_base_python()  # refuses before it asks
        folder = environment.environment_folder()
        message = f"{environment.DOWNLOAD_SIZE}, with pip from the Python package index, into {folder}"
        return context.window_manager.invoke_confirm(
            self, event, title="Set Up Worker", message=message, confirm_text="Download", icon="QUESTION"
        )


class CVDGS_OT_remove_environment(Action, bpy.types.Operator):
    """Delete the worker's Python environment, to free disk space or to set it up again"""

    bl_idname = "cvdgs.remove_environment"
    bl_label = "Remove Worker"
    bl_options = set()

    @classmethod
    def missing(cls, _context: bpy.types.Context) -> str:
        if not environment.environment_folder().exists():
            return "No worker has been set up here"
        # Removing ends the setting up itself, and nothing else runs from a folder that is not complete.
        return "" if ACTIVITY.running(environment.MAKE_JOB) else _running_job()

    def act(self, _context: bpy.types.Context) -> None:
        environment.remove_environment()

    def on_click(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str] | None:
        return context.window_manager.invoke_confirm(self, event)


class CVDGS_OT_check_environment(Action, bpy.types.Operator):
    """Show the worker's versions and device, compile its kernels, and measure its speed for time estimates"""

    bl_idname = "cvdgs.check_environment"
    bl_label = "Check Worker"
    bl_options = set()

    @classmethod
    def missing(cls, _context: bpy.types.Context) -> str:
        if ACTIVITY.running(environment.CHECK_JOB):
            return "The worker is already being checked"
        return environment.why_no_worker()

    def act(self, _context: bpy.types.Context) -> None:
        environment.worker_python()
        environment.start_check()


class CVDGS_OT_clear_cache(Action, bpy.types.Operator):
    """Delete thumbnails and compiled kernels; they are made again when needed"""

    bl_idname = "cvdgs.clear_cache"
    bl_label = "Clear Cache"
    bl_options = set()

    @classmethod
    def missing(cls, _context: bpy.types.Context) -> str:
        return _running_job()

    def act(self, _context: bpy.types.Context) -> None:
        get_cache().clear()


def _running_job() -> str:
    """Why files that a worker may be using stay; "" where no job runs."""
    return "Wait for the running job, or cancel it" if ACTIVITY.is_busy() else ""


CLASSES: tuple[type, ...] = (
    CVDGS_OT_make_environment,
    CVDGS_OT_remove_environment,
    CVDGS_OT_check_environment,
    CVDGS_OT_clear_cache,
)
