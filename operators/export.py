"""Operators of the sub-panel "Export": splat files and LUTs for other programs, and web pages."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy_extras.io_utils import ExportHelper

from ..core.runs.layout import ORIGINAL
from ..cvdgs_addon.export import (
    export_cube,
    export_gaussians,
    export_layers,
    export_web_page,
    find_cube,
    proposed_cube_name,
    proposed_folder,
    proposed_name,
    proposed_title,
    read_gaussians,
)
from ..cvdgs_addon.scene.origin import run_of
from ..cvdgs_addon.scene.world_matrix import world_of
from ..cvdgs_addon.shown import shown_layer, shown_splats
from .base import NeedsGaussians, NeedsRun

NO_LUT = "The original colours have no LUT; choose a layer under Display"


class CVDGS_OT_export_gaussians(NeedsGaussians, bpy.types.Operator, ExportHelper):
    """Export the Gaussians as shown, with layer, slider and deletions, as a splat file for other programs"""

    bl_idname = "cvdgs.export_gaussians"
    bl_label = "Export Gaussians"
    bl_options = {"REGISTER"}

    filename_ext = ".ply"
    check_extension = None  # the ending chooses the format

    filter_glob: bpy.props.StringProperty(default="*.ply;*.spz;*.splat", options={"HIDDEN"})
    axes: bpy.props.EnumProperty(
        name="Axes",
        description="The coordinates of the exported Gaussians",
        items=(
            ("CAPTURE", "Capture", "As reconstructed: matches the capture's cameras"),
            ("SCENE", "Scene", "As placed in Blender, including the object's transform"),
        ),
    )

    def on_click(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str] | None:
        _propose(self, context, proposed_name(shown_splats(context)))
        return ExportHelper.invoke(self, context, event)

    def act(self, context: bpy.types.Context) -> None:
        splats = shown_splats(context)
        assert splats is not None  # see `NeedsGaussians.missing`
        layer, enhanced = shown_layer(splats)
        exported = read_gaussians(splats, layer, enhanced, axes=world_of(splats) if self.axes == "SCENE" else None)
        path = bpy.path.abspath(self.filepath)
        export_gaussians(path, exported)
        if exported.lost_view_dependence:
            self.report({"WARNING"}, "Exported without view-dependent colours, because the Gaussians were stretched")
        else:
            self.report({"INFO"}, f"Exported {len(exported.gaussians):,} Gaussians to {path}")


class _AllLayers(NeedsGaussians, ExportHelper):
    """An operator that exports the Gaussians in all layers into one file."""

    bl_options = {"REGISTER"}

    def write(self, path: str, splats: bpy.types.Object) -> int:
        """Write the file; returns the number of Gaussians. Each operator its own."""
        raise AssertionError

    def on_click(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str] | None:
        _propose(self, context, proposed_title(shown_splats(context)))
        return ExportHelper.invoke(self, context, event)

    def act(self, context: bpy.types.Context) -> None:
        path = bpy.path.abspath(self.filepath)  # type: ignore[attr-defined]
        count = self.write(path, shown_splats(context))
        self.report({"INFO"}, f"Exported {count:,} Gaussians to {path}")  # type: ignore[attr-defined]


class CVDGS_OT_export_web_page(_AllLayers, bpy.types.Operator):
    """Export the Gaussians, in all layers, as one web page that shows the scene in any browser, from the disk"""

    bl_idname = "cvdgs.export_web_page"
    bl_label = "Export Web Page"

    filename_ext = ".html"

    filter_glob: bpy.props.StringProperty(default="*.html", options={"HIDDEN"})

    def write(self, path: str, splats: bpy.types.Object) -> int:
        return export_web_page(path, splats)


class CVDGS_OT_export_layers(_AllLayers, bpy.types.Operator):
    """Export the Gaussians as they stand in the scene, in all layers, as glTF or USD"""

    bl_idname = "cvdgs.export_layers"
    bl_label = "Export All Layers"

    filename_ext = ".glb"
    check_extension = None  # the ending chooses the format

    filter_glob: bpy.props.StringProperty(default="*.glb;*.usd;*.usda;*.usdc", options={"HIDDEN"})

    def write(self, path: str, splats: bpy.types.Object) -> int:
        return export_layers(path, splats)


class CVDGS_OT_export_cube(NeedsRun, bpy.types.Operator, ExportHelper):
    """Export the layer's colour mapping as a LUT for grading and compositing (display-referred sRGB)"""

    bl_idname = "cvdgs.export_cube"
    bl_label = "Export LUT"
    bl_options = {"REGISTER"}

    filename_ext = ".cube"

    filter_glob: bpy.props.StringProperty(default="*.cube", options={"HIDDEN"})

    @classmethod
    def missing(cls, context: bpy.types.Context) -> str:
        is_original = not super().missing(context) and shown_layer(shown_splats(context))[0] == ORIGINAL
        return NO_LUT if is_original else super().missing(context)

    def check(self, _context: bpy.types.Context) -> bool:
        """Add the ending; ExportHelper would take the severity's decimals for one."""
        chosen = self.properties
        before = chosen.filepath
        chosen.filepath = bpy.path.ensure_ext(before, self.filename_ext)
        return chosen.filepath != before

    def on_click(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str] | None:
        splats = shown_splats(context)
        find_cube(run_of(splats), shown_layer(splats)[0])  # refuses before it asks
        _propose(self, context, proposed_cube_name(splats))
        return ExportHelper.invoke(self, context, event)

    def act(self, context: bpy.types.Context) -> None:
        splats = shown_splats(context)
        layer, _ = shown_layer(splats)
        path = bpy.path.abspath(self.filepath)
        export_cube(run_of(splats), layer, path)
        self.report({"INFO"}, f"Exported the LUT of {layer} to {path}")


def _propose(operator: bpy.types.Operator, context: bpy.types.Context, name: str) -> None:
    """Set the path to a file of this name, where the last one of its kind went, unless a script has chosen one."""
    if operator.properties.is_property_set("filepath"):
        return
    last = operator.filepath  # Blender's memory of the last call
    folder = Path(last).parent if last else proposed_folder(shown_splats(context))
    operator.filepath = str(Path(folder, name + (Path(last).suffix or operator.filename_ext)))


CLASSES: tuple[type, ...] = (
    CVDGS_OT_export_gaussians,
    CVDGS_OT_export_web_page,
    CVDGS_OT_export_layers,
    CVDGS_OT_export_cube,
)
