"""A frame of 3840 x 2160: in the 3D view through the turntable's camera, and as a render by the key F12."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from PIL import Image

from .desktop import Desktop
from .side_bar import CAPTURE, MAKE, VIEWER, header, press_until, toggle
from .test_finished_scene import LEAST_CONTRAST, VIEW_IN_COLOR, settled_view
from .test_taken_away import CAMERA_FRAME

pytestmark = [pytest.mark.slow, pytest.mark.timeout(3000)]

SIZE, SMALL = (3840, 2160), 8  # pixels, and how many times smaller the other picture is
RENDER_MAY_TAKE = 1800.0  # seconds; half a minute on an idle machine
SAME = 3.0  # grey levels in the mean between pictures of two sizes
SET_SIZE = """
scene = bpy.context.scene
scene.camera = bpy.data.objects["Turntable Camera"]
scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = {}, {}, 100
"""
DONE = """
bpy.app.handlers.render_complete.append(lambda *_: open("/share/rendered", "w").close())
"""
SAVE = "bpy.data.images['Render Result'].save_render('/share/{}.png', scene=bpy.context.scene)"


def rendered(desktop: Desktop, name: str, size: tuple[int, int]) -> Image.Image:
    """What F12 over the 3D view renders in that size."""
    done = desktop.share / "rendered"
    done.unlink(missing_ok=True)
    desktop.ask(SET_SIZE.format(*size))
    x, y, width, height = desktop.state()["places"]["VIEW_3D WINDOW"]
    desktop.hover(x + width / 4, y + 0.85 * height)
    desktop.keys("F12")
    desktop.wait(lambda state: done.exists() and not state["is_rendering"], RENDER_MAY_TAKE)
    desktop.ask(SAVE.format(name))
    return Image.open(desktop.share / f"{name}.png").convert("RGB")


def test_a_4k_frame_is_seen_in_the_view_and_rendered_whole(installed: Desktop, finished_run: str, pictures):
    desktop = installed
    desktop.quit()
    desktop.start(python=sys.executable, sidebar=True)
    toggle(desktop, MAKE, VIEWER, CAPTURE)
    desktop.ask(f"bpy.ops.cvdgs.load_run(directory={finished_run!r})\nbpy.ops.cvdgs.add_turntable()")
    desktop.ask(SET_SIZE.format(*SIZE) + DONE)
    desktop.settle()
    x, y = header(3)
    press_until(desktop, (x, y + VIEW_IN_COLOR), lambda state: state["engine"] == "CYCLES")
    settled_view(desktop, "frame-4k-view")
    corners = np.array(desktop.tell("corners", CAMERA_FRAME))
    assert np.ptp(corners, axis=0)[0] / np.ptp(corners, axis=0)[1] == pytest.approx(SIZE[0] / SIZE[1], rel=0.01)

    desktop.ask("next(a for a in bpy.context.screen.areas if a.type == 'VIEW_3D').spaces.active.shading.type = 'SOLID'")
    desktop.settle()
    large = rendered(desktop, "frame-4k", SIZE)
    assert large.size == SIZE
    large.save(pictures / "frame-4k.png")
    assert np.asarray(large, float).std() > LEAST_CONTRAST
    small = rendered(desktop, "frame-small", (SIZE[0] // SMALL, SIZE[1] // SMALL))
    difference = np.asarray(large.reduce(SMALL), float) - np.asarray(small, float)
    assert np.abs(difference).mean() < SAME
    desktop.quit()
