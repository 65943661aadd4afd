"""Operators that bring a capture into the scene and set it up there."""

from __future__ import annotations

import bpy

from ..cvdgs_addon.activity import ACTIVITY
from ..cvdgs_addon.folders import normalised_folder
from ..cvdgs_addon.importing import JOB, ImportRequest, import_now, ready_folder, start_import
from ..cvdgs_addon.scene.cameras import is_capture_camera, use_camera
from ..cvdgs_addon.scene.import_capture import ImportOptions, capture_of, place_again
from ..cvdgs_addon.scene.placement import Placing, Up, is_capture
from .base import reports_errors

_UP_ITEMS = (
    ("AUTO", "Automatic", "The mean of the cameras' up directions, unless +Z is near it already"),
    *((up.value, up.value, f"{up.value} of the capture becomes up") for up in Up if up is not Up.AUTO),
)


class _Placed:
    """Up axis and size, as operator properties."""

    up: bpy.props.EnumProperty(name="Up", description="Which axis of the capture is up", items=_UP_ITEMS)
    distance: bpy.props.FloatProperty(
        name="Distance",
        description="Of the cameras from the subject, which sets the scale; 0: left as it is, or a few metres where "
        "that is too small or large for Blender",
        subtype="DISTANCE",
        min=0.0,
        soft_max=100.0,
    )

    def placing(self) -> Placing:
        return Placing(Up(self.up), self.distance)


class CVDGS_OT_import_capture(_Placed, bpy.types.Operator):
    """Bring the capture's cameras, photographs and sparse points into the scene"""

    bl_idname = "cvdgs.import_capture"
    bl_label = "Import Capture"
    bl_options = {"REGISTER", "UNDO"}

    directory: bpy.props.StringProperty(
        name="Folder",
        description="Of the capture or of a run; empty: the one picked under Capture",
        subtype="DIR_PATH",
        options={"SKIP_SAVE"},  # the next capture is another one
    )
    filter_folder: bpy.props.BoolProperty(default=True, options={"HIDDEN", "SKIP_SAVE"})
    images: bpy.props.BoolProperty(
        name="Photographs", description="Show each camera's photograph behind it", default=True
    )
    points: bpy.props.BoolProperty(name="Sparse Points", description="Add the sparse points", default=True)

    _waits = True  # for the worker: a script goes on with the result, an artist must not be held up

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        if ACTIVITY.running(JOB):
            cls.poll_message_set("A capture is being imported; wait for it or cancel it")
            return False
        return True

    def _request(self, context: bpy.types.Context) -> ImportRequest:
        capture = context.scene.cvdgs.capture
        options = ImportOptions(self.images, self.points, self.placing())
        return ImportRequest(self.directory or capture.folder, capture.sfm, options)

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        request = self._request(context)
        if not self._waits and ready_folder(normalised_folder(request.folder)) is None:
            start_import(context.scene, request)
            return {"FINISHED"}
        added = import_now(context.scene, request)
        if context.scene.camera is None:
            use_camera(context.scene, next(iter(added.cameras.values())))
        self.report({"INFO"}, f"{len(added.cameras)} cameras are in the scene")
        return {"FINISHED"}

    @reports_errors
    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        self._waits = False
        if not self._request(context).folder:
            context.window_manager.fileselect_add(self)
            return {"RUNNING_MODAL"}
        return self.execute(context)


class CVDGS_OT_place_capture(_Placed, bpy.types.Operator):
    """Set the capture upright and to another size; the transform of its Empty is replaced"""

    bl_idname = "cvdgs.place_capture"
    bl_label = "Place Capture"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if _shown_capture(context) is None:
            cls.poll_message_set("First import a capture, make a run or load a finished one")
            return False
        return True

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        place_again(_shown_capture(context), self.placing())
        return {"FINISHED"}


class CVDGS_OT_look_through(bpy.types.Operator):
    """Look through the capture's next camera, at the size of its photograph"""

    bl_idname = "cvdgs.look_through"
    bl_label = "Look Through"
    bl_options = {"REGISTER", "UNDO"}

    step: bpy.props.IntProperty(name="Step", description="How many cameras further; negative: back", default=1)

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if not any(is_capture_camera(candidate) for candidate in context.scene.objects):
            cls.poll_message_set("First import a capture, make a run or load a finished one")
            return False
        return True

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        scene = context.scene
        cameras = [candidate for candidate in scene.objects if is_capture_camera(candidate)]
        at = cameras.index(scene.camera) + self.step if scene.camera in cameras else 0
        use_camera(scene, cameras[at % len(cameras)])
        if context.space_data is not None and context.space_data.type == "VIEW_3D":
            context.space_data.region_3d.view_perspective = "CAMERA"
        self.report({"INFO"}, scene.camera.name)
        return {"FINISHED"}


def _shown_capture(context: bpy.types.Context) -> bpy.types.Object | None:
    """The capture of the active object, else the scene's first."""
    found = capture_of(context.view_layer.objects.active)
    return found or next((candidate for candidate in context.scene.objects if is_capture(candidate)), None)


CLASSES: tuple[type, ...] = (CVDGS_OT_import_capture, CVDGS_OT_place_capture, CVDGS_OT_look_through)
