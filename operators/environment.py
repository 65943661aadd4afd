"""Operators of the preferences: the worker's environment and the cache."""

from __future__ import annotations

import bpy

from ..core.errors import InputError
from ..cvdgs_addon import environment
from ..cvdgs_addon.activity import ACTIVITY
from ..cvdgs_addon.preferences import get_cache
from .base import reports_errors


class CVDGS_OT_make_environment(bpy.types.Operator):
    """Download what the worker needs into the extension's own folder; goes away with the extension"""

    bl_idname = "cvdgs.make_environment"
    bl_label = "Set Up Worker"

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        if ACTIVITY.running(environment.MAKE_JOB):
            cls.poll_message_set("The worker is being set up")
            return False
        if not bpy.app.online_access:
            cls.poll_message_set("Allow Online Access in Preferences > System > Network first")
            return False
        return True

    @reports_errors
    def execute(self, _context: bpy.types.Context) -> set[str]:
        if not bpy.app.online_access:
            remedy = "allow it under Preferences > System > Network"
            raise InputError("online access is not allowed", remedy=remedy)
        environment.start_making(environment.find_base_python())
        return {"FINISHED"}

    @reports_errors
    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        environment.find_base_python()  # refuses before it asks
        folder = environment.environment_folder()
        message = f"{environment.DOWNLOAD_SIZE}, by pip, from the index of Python packages, into {folder}"
        return context.window_manager.invoke_confirm(
            self, event, title="Set Up Worker", message=message, confirm_text="Download", icon="INTERNET"
        )


class CVDGS_OT_remove_environment(bpy.types.Operator):
    """Delete the environment that was made, to free its space or to make it again"""

    bl_idname = "cvdgs.remove_environment"
    bl_label = "Remove Worker"

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        if not environment.environment_folder().exists():
            cls.poll_message_set("No environment was made")
            return False
        return True

    @reports_errors
    def execute(self, _context: bpy.types.Context) -> set[str]:
        environment.remove_environment()
        return {"FINISHED"}

    @reports_errors
    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        return context.window_manager.invoke_confirm(self, event)


class CVDGS_OT_check_environment(bpy.types.Operator):
    """Find out the worker's versions and device, compile its kernels, and measure its speed for the time estimates"""

    bl_idname = "cvdgs.check_environment"
    bl_label = "Check Worker"

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        if ACTIVITY.running(environment.CHECK_JOB):
            cls.poll_message_set("The worker is being checked")
            return False
        return True

    @reports_errors
    def execute(self, _context: bpy.types.Context) -> set[str]:
        environment.worker_python()
        environment.start_check()
        return {"FINISHED"}


class CVDGS_OT_clear_cache(bpy.types.Operator):
    """Delete thumbnails and compiled kernels; they are made again when they are needed"""

    bl_idname = "cvdgs.clear_cache"
    bl_label = "Clear Cache"

    def execute(self, _context: bpy.types.Context) -> set[str]:
        get_cache().clear()
        return {"FINISHED"}


CLASSES: tuple[type, ...] = (
    CVDGS_OT_make_environment,
    CVDGS_OT_remove_environment,
    CVDGS_OT_check_environment,
    CVDGS_OT_clear_cache,
)
