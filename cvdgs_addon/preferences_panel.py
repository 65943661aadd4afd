"""The add-on's preferences in Blender, and how they look: the worker, the device, the cache."""

from __future__ import annotations

import bpy

from . import environment
from .activity import ACTIVITY
from .folders import PACKAGE
from .messages import lines_of
from .preferences import Preferences, get_cache, known_machine

_WIDTH = 90  # characters; the preferences' window is wide
_VERSIONS = ("python", "torch", "warp-lang", "numpy")


class CVDGS_Preferences(bpy.types.AddonPreferences):
    """What belongs to the machine and not to a file."""

    bl_idname = PACKAGE

    python: bpy.props.StringProperty(
        name="Worker Python",
        description="A Python of your own with torch and Warp; empty: the one set up here, or one that is found",
        subtype="FILE_PATH",
    )
    base_python: bpy.props.StringProperty(
        name="Base Python for Setup",
        description="The Python 3.11 or later that Set Up Worker starts from; empty: the first that is found",
        subtype="FILE_PATH",
    )
    device: bpy.props.EnumProperty(
        name="Device",
        description="The device that the worker computes on",
        items=(
            ("auto", "Automatic", "An NVIDIA GPU where there is one"),
            ("cpu", "Processor", "Works everywhere"),
            ("cuda", "NVIDIA GPU", "Needs a recent driver, and a torch with CUDA"),
        ),
        default=Preferences.device,
    )
    cache: bpy.props.StringProperty(
        name="Cache",
        description="Folder for thumbnails and compiled kernels; empty: the extension's own folder",
        subtype="DIR_PATH",
    )
    cache_limit: bpy.props.IntProperty(
        name="Cache Size",
        description="Size in MB above which the files used longest ago are deleted",
        min=50,
        soft_max=10_000,
        default=Preferences.cache_limit,
    )
    machine: bpy.props.StringProperty(
        name="Machine", description="Result of the last worker check, as JSON", options={"HIDDEN"}
    )
    speed: bpy.props.FloatProperty(
        name="Speed",
        description="Speed of this machine relative to the reference machine; 0: not measured",
        options={"HIDDEN"},
    )
    stage_speeds: bpy.props.StringProperty(
        name="Stage Speeds", description="The same of the stages that runs have timed, as JSON", options={"HIDDEN"}
    )

    def draw(self, _context: bpy.types.Context) -> None:
        """Called by Blender."""
        draw_preferences(self, self.layout)


def draw_preferences(preferences: bpy.types.AddonPreferences, layout: bpy.types.UILayout) -> None:
    """Draw `preferences` into `layout`."""
    _draw_worker(preferences, layout.box())
    column = layout.column()
    column.use_property_split, column.use_property_decorate = True, False
    column.prop(preferences, "device")
    column.prop(preferences, "cache")
    column.prop(preferences, "cache_limit")
    row = column.row()
    row.label(text=f"{get_cache().size() / 1e6:.0f} MB in use")
    row.operator("cvdgs.clear_cache")


def _draw_worker(preferences: bpy.types.AddonPreferences, box: bpy.types.UILayout) -> None:
    box.label(text="Worker: the Python that does the heavy computation", icon="CONSOLE")
    for name, sentence in ((environment.MAKE_JOB, "Setting up …"), (environment.CHECK_JOB, "Checking …")):
        job = ACTIVITY.running(name)
        if job is not None:
            row = box.row(align=True)
            row.progress(factor=job.progress.fraction, text=f"{sentence} {job.progress.message}")
            row.operator("cvdgs.cancel_job", text="", icon="X").job = name
            return
    missing = environment.why_no_worker()
    if not missing:
        _draw_found(box, environment.worker_python())
    else:
        box.label(text=missing, icon="ERROR")
        if not bpy.app.online_access:
            box.label(text="Set Up Worker needs online access: System > Network > Allow Online Access", icon="INFO")
    for name in (environment.MAKE_JOB, environment.CHECK_JOB):
        job = ACTIVITY.job(name)
        if job is not None and job.problem:
            column = box.column(align=True)
            for number, line in enumerate(lines_of(job.problem, _WIDTH)):
                column.label(text=line, icon="BLANK1" if number else "ERROR")
    row = box.row(align=True)
    row.operator("cvdgs.make_environment", icon="IMPORT")
    row.operator("cvdgs.check_environment", icon="FILE_REFRESH")
    row.operator("cvdgs.remove_environment", icon="TRASH")
    column = box.column()
    column.use_property_split, column.use_property_decorate = True, False
    column.prop(preferences, "python")
    column.prop(preferences, "base_python")


def _draw_found(box: bpy.types.UILayout, python: str) -> None:
    box.label(text=python, icon="CHECKMARK")
    machine = known_machine()
    if not machine or machine.get("asked_of") != python:
        box.label(text="Not checked yet", icon="BLANK1")
        return
    versions = machine.get("versions", {})
    box.label(text=", ".join(f"{name} {versions[name]}" for name in _VERSIONS if name in versions), icon="BLANK1")
    box.label(text=f"{machine.get('device', '')}", icon="BLANK1")


CLASSES: tuple[type, ...] = (CVDGS_Preferences,)
