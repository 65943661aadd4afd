"""What the 3D view shows by itself: a preview after loading and opening, the render once all is quiet."""

from __future__ import annotations

import sys
import time

import numpy as np
import pytest

from .desktop import Desktop

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1200)]

VIEW = (
    "[(a.spaces.active.shading.type, a.spaces.active.shading.color_type, a.spaces.active.region_3d.view_perspective)"
    " for a in bpy.context.screen.areas if a.type == 'VIEW_3D'][0]"
)
# Of the capture's cameras: how many, their collections, how large the largest is beside what they look at, and whether
# views draw lines to their parent.
CAMERAS = """
import mathutils
cameras = [found for found in bpy.context.scene.objects if found.name.startswith("view_")]
splats = next(found for found in bpy.context.scene.objects if found.name.endswith("Gaussians"))
corners = [splats.matrix_world @ mathutils.Vector(corner) for corner in splats.bound_box]
largest = max(found.data.display_size * max(found.matrix_world.to_scale()) for found in cameras)
views = [a.spaces.active for a in bpy.context.screen.areas if a.type == "VIEW_3D"]
answer = dict(
    count=len(cameras),
    collections=sorted({held.name for found in cameras for held in found.users_collection}),
    others=[found.name for found in bpy.data.collections["finished Cameras"].objects if found not in cameras],
    size=largest / max((one - other).length for one in corners for other in corners),
    lines=any(view.overlay.show_relationship_lines for view in views),
)
"""
CUBE_IS_HIDDEN = "bpy.data.objects['Cube'].hide_get()"
PREVIEW = ["SOLID", "VERTEX", "PERSP"]
RENDER_MAY_TAKE = 120.0  # seconds; it waits for the capture to be inspected
LARGEST_CAMERA = 0.05  # of what the cameras look at
SATURATED = 40  # grey levels between the largest and the smallest channel of a pixel
LEAST_SHARE = 0.05  # of the view's pixels, that are coloured; Blender's own grey has none


def coloured_share(desktop: Desktop, name: str) -> float:
    """Share of the 3D view's left half, which no panel covers, that is coloured."""
    x, y, width, height = desktop.state()["places"]["VIEW_3D WINDOW"]
    shown = np.asarray(desktop.look(name).crop((x, y, x + width // 2, y + height)), int)
    return float((np.ptp(shown, axis=2) > SATURATED).mean())


def test_a_run_shows_its_colours_at_once_then_rendered_and_as_a_preview_while_somebody_orbits(
    installed: Desktop, finished_run: str
):
    desktop = installed
    desktop.quit()
    desktop.start(python=sys.executable, sidebar=True)
    desktop.ask(f"bpy.ops.cvdgs.load_run(directory={finished_run!r})")
    assert desktop.tell(VIEW) == PREVIEW
    assert desktop.tell(CUBE_IS_HIDDEN)
    assert coloured_share(desktop, "preview") > LEAST_SHARE
    cameras = desktop.tell("answer", CAMERAS)
    assert cameras["count"] >= 20
    assert (cameras["collections"], cameras["others"], cameras["lines"]) == (["finished Cameras"], [], False)
    assert cameras["size"] < LARGEST_CAMERA

    desktop.ask("bpy.ops.wm.save_as_mainfile(filepath='/share/preview.blend')")
    desktop.wait(lambda state: state["engine"] == "CYCLES", RENDER_MAY_TAKE)
    assert desktop.tell(VIEW)[::2] == ["RENDERED", "CAMERA"]

    x, y, width, height = desktop.state()["places"]["VIEW_3D WINDOW"]
    desktop.drag(x + width / 3, y + height / 2, 40, 5)
    deadline = time.monotonic() + 20.0
    while desktop.tell(VIEW) != PREVIEW:
        assert time.monotonic() < deadline, desktop.tell(VIEW)
    assert coloured_share(desktop, "orbited") > LEAST_SHARE

    desktop.quit()
    desktop.start("/share/preview.blend", python=sys.executable)
    assert desktop.tell(VIEW)[:2] == PREVIEW[:2]
    assert coloured_share(desktop, "opened") > LEAST_SHARE
