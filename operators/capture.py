"""Operators of the sub-panel "Capture", and of its part that brings a capture into the scene."""

from __future__ import annotations

import bpy

from ..core.demo import SHOWROOM
from ..core.intake.kinds import ARCHIVE_EXTENSION, VIDEO_EXTENSIONS
from ..cvdgs_addon.activity import ACTIVITY
from ..cvdgs_addon.folders import normalised_folder
from ..cvdgs_addon.importing import JOB as IMPORT_JOB
from ..cvdgs_addon.importing import ImportRequest, import_now, ready_folder, start_import
from ..cvdgs_addon.inspection import JOB as INSPECTION_JOB
from ..cvdgs_addon.inspection import inspect_now, start_inspection
from ..cvdgs_addon.report_pages import start_writing_pages, write_pages_now
from ..cvdgs_addon.scene.cameras import is_capture_camera, use_camera
from ..cvdgs_addon.scene.import_capture import ImportOptions, capture_of, place_again
from ..cvdgs_addon.scene.placement import Placing, Up, is_capture, metres_of_unit
from ..cvdgs_addon.scene.ruler import add_ruler, ends_of, measure
from ..cvdgs_addon.shown import shown_splats
from .base import NOT_REPEATED, Action

_UP_ITEMS = (
    ("AUTO", "Automatic", "The mean of the cameras' up directions, unless that is close to +Z already"),
    *((up.value, up.value, f"The capture's {up.value} axis points up") for up in Up if up is not Up.AUTO),
)
_FILES = ";".join(f"*{ending}" for ending in (*VIDEO_EXTENSIONS, ARCHIVE_EXTENSION))
NO_CAPTURE = "Import a capture, start a run or load a finished one first"


class CVDGS_OT_inspect_capture(Action, bpy.types.Operator):
    """Read the folder again: format, number and size of the photographs, warnings, thumbnails"""

    bl_idname = "cvdgs.inspect_capture"
    bl_label = "Inspect Capture"
    bl_options = NOT_REPEATED

    @classmethod
    def missing(cls, context: bpy.types.Context) -> str:
        if not context.scene.cvdgs.capture.folder:
            return "Choose a folder of photographs first"
        return "The folder is already being read" if ACTIVITY.running(INSPECTION_JOB) else ""

    def act(self, context: bpy.types.Context) -> None:
        inspect_now(context.scene)

    def on_click(self, context: bpy.types.Context, _event: bpy.types.Event) -> None:
        start_inspection(context.scene)


class CVDGS_OT_choose_capture_file(Action, bpy.types.Operator):
    """Choose a video, or a zip of photographs, in place of a folder"""

    bl_idname = "cvdgs.choose_capture_file"
    bl_label = "Choose Video or Zip"

    filepath: bpy.props.StringProperty(name="File", subtype="FILE_PATH", options={"SKIP_SAVE"})
    filter_glob: bpy.props.StringProperty(default=_FILES, options={"HIDDEN"})

    def act(self, context: bpy.types.Context) -> None:
        context.scene.cvdgs.capture.folder = self.filepath

    def on_click(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}


class CVDGS_OT_use_demo(Action, bpy.types.Operator):
    """Try the add-on with the small capture of a textile showroom that comes with it"""

    bl_idname = "cvdgs.use_demo"
    bl_label = "Use the Demo"

    def act(self, context: bpy.types.Context) -> None:
        context.scene.cvdgs.capture.cameras = "AUTO"
        context.scene.cvdgs.capture.folder = str(SHOWROOM)


class _Placed:
    """Up axis and size, as operator properties."""

    up: bpy.props.EnumProperty(name="Up", description="The axis of the capture that points up", items=_UP_ITEMS)
    distance: bpy.props.FloatProperty(
        name="Distance",
        description="From the cameras to the subject, which sets the scale; 0: keep the capture's scale, unless it is "
        "too small or too large for Blender",
        subtype="DISTANCE",
        min=0.0,
        soft_max=100.0,
    )

    def placing(self) -> Placing:
        return Placing(Up(self.up), self.distance)


class CVDGS_OT_import_capture(_Placed, Action, bpy.types.Operator):
    """Add the capture's cameras, photographs and sparse points to the scene"""

    bl_idname = "cvdgs.import_capture"
    bl_label = "Import Capture"

    directory: bpy.props.StringProperty(
        name="Folder",
        description="Of a capture or a run; empty: the one chosen under Capture",
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
    def missing(cls, _context: bpy.types.Context) -> str:
        return "A capture is already being imported" if ACTIVITY.running(IMPORT_JOB) else ""

    def _request(self, context: bpy.types.Context) -> ImportRequest:
        capture = context.scene.cvdgs.capture
        options = ImportOptions(self.images, self.points, self.placing())
        return ImportRequest(self.directory or capture.folder, capture.cameras.lower(), options)

    def act(self, context: bpy.types.Context) -> None:
        request = self._request(context)
        if not self._waits and ready_folder(normalised_folder(request.folder)) is None:
            start_import(context.scene, request)
            return
        added = import_now(context.scene, request)
        if context.scene.camera is None:
            use_camera(context.scene, next(iter(added.cameras.values())))
        self.report({"INFO"}, f"Added {len(added.cameras)} cameras to the scene")

    def on_click(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str] | None:
        self._waits = False
        if not self._request(context).folder:
            context.window_manager.fileselect_add(self)
            return {"RUNNING_MODAL"}
        self.act(context)
        return None


class _OfCapture(Action):
    """An operator on the capture that is in the scene."""

    @classmethod
    def missing(cls, context: bpy.types.Context) -> str:
        return NO_CAPTURE if _shown_capture(context) is None else ""


class CVDGS_OT_place_capture(_Placed, _OfCapture, bpy.types.Operator):
    """Turn the capture upright and rescale it; replaces the transform of its Empty"""

    bl_idname = "cvdgs.place_capture"
    bl_label = "Place Capture"

    def act(self, context: bpy.types.Context) -> None:
        place_again(_shown_capture(context), self.placing())


class CVDGS_OT_add_ruler(_OfCapture, bpy.types.Operator):
    """Add two marks, A and B, to be moved to two places whose distance you know"""

    bl_idname = "cvdgs.add_ruler"
    bl_label = "Add Ruler"

    def act(self, context: bpy.types.Context) -> None:
        ends = add_ruler(_shown_capture(context))
        self.report({"INFO"}, f"Move {ends[0].name} and {ends[1].name} to the ends of a length that you know")


class CVDGS_OT_measure(_OfCapture, bpy.types.Operator):
    """Give the capture its true size, by the distance between the two marks of its ruler"""

    bl_idname = "cvdgs.measure"
    bl_label = "Set Length"

    length: bpy.props.FloatProperty(
        name="Length", description="From A to B, as measured", subtype="DISTANCE", unit="LENGTH", min=1e-6, default=1.0
    )

    _waits = True  # for the worker that writes the run's report page; an artist must not be held up

    @classmethod
    def missing(cls, context: bpy.types.Context) -> str:
        reason = super().missing(context)
        return reason or ("" if len(ends_of(_shown_capture(context))) == 2 else "Add a ruler first")

    def on_click(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        self._waits = False
        return context.window_manager.invoke_props_dialog(self)

    def act(self, context: bpy.types.Context) -> None:
        metres = self.length * metres_of_unit(context.scene)  # Blender's lengths are in units of the scene
        told = measure(_shown_capture(context), metres)
        (write_pages_now if self._waits else start_writing_pages)(told)
        said = f"A to B is {metres:.3g} m now in the scene"
        if told:
            said += ", and in its run for exports. Undo does not reach the run: set the right length to correct it"
        self.report({"INFO"}, said)


class CVDGS_OT_look_through(Action, bpy.types.Operator):
    """Look through another camera of the capture, and set the render size to that of its photograph"""

    bl_idname = "cvdgs.look_through"
    bl_label = "Look Through"

    step: bpy.props.IntProperty(name="Step", description="How many cameras to move on; negative: back", default=1)

    @classmethod
    def missing(cls, context: bpy.types.Context) -> str:
        return "" if any(map(is_capture_camera, context.scene.objects)) else NO_CAPTURE

    def act(self, context: bpy.types.Context) -> None:
        scene = context.scene
        cameras = [candidate for candidate in scene.objects if is_capture_camera(candidate)]
        at = cameras.index(scene.camera) + self.step if scene.camera in cameras else 0
        use_camera(scene, cameras[at % len(cameras)])
        if context.space_data is not None and context.space_data.type == "VIEW_3D":
            context.space_data.region_3d.view_perspective = "CAMERA"
        self.report({"INFO"}, scene.camera.name)


def _shown_capture(context: bpy.types.Context) -> bpy.types.Object | None:
    """The capture of the active object if that is seen, else of the Gaussians that the panels are about, else any."""
    active = context.view_layer.objects.active
    found = capture_of(active) if active is not None and active.visible_get() else None
    found = found or capture_of(shown_splats(context))
    return found or next((candidate for candidate in context.scene.objects if is_capture(candidate)), None)


CLASSES: tuple[type, ...] = (
    CVDGS_OT_inspect_capture,
    CVDGS_OT_choose_capture_file,
    CVDGS_OT_use_demo,
    CVDGS_OT_import_capture,
    CVDGS_OT_place_capture,
    CVDGS_OT_add_ruler,
    CVDGS_OT_measure,
    CVDGS_OT_look_through,
)
