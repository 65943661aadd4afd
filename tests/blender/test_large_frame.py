"""The turntable, undone and done again, and a frame of 3840 x 2160 through its camera: in the 3D view, and by F12."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from .desktop import Desktop
from .side_bar import CAPTURE, VIEWER, header, press_until, toggle
from .test_colour_at_once import RENDER_MAY_TAKE as VIEW_MAY_TAKE
from .test_finished_scene import LEAST_CONTRAST, settled_view
from .test_second_thoughts import press_in_view
from .test_taken_away import ADD_TURNTABLE, CAMERA_FRAME, VIEW_IN_COLOR, below

pytestmark = [pytest.mark.slow, pytest.mark.timeout(6000)]

MAKE, DISPLAY, TURNTABLE = header(2), header(3), header(5)
REMOVE_TURNTABLE = (243, 141)  # below its header, while all above is closed

ANSWER_MAY_TAKE = 60.0  # seconds; one on an idle machine
SIZE, SMALL = (3840, 2160), 8  # pixels, and how many times smaller the other picture is
RENDER_MAY_TAKE = 3600.0  # seconds; some 10 minutes on two cores that do nothing else
F12 = "96"  # the key's number: by its name xdotool presses Alt as well, which renders the sequencer
BLOCK = 8  # pixels of the small picture
RENDERED = "any(a.spaces.active.shading.type == 'RENDERED' for a in bpy.context.screen.areas if a.type == 'VIEW_3D')"
SAME = 3.0  # grey levels in the mean between pictures of two sizes
SET_SIZE = """
scene = bpy.context.scene
if "Turntable Camera" not in bpy.data.objects:
    bpy.ops.cvdgs.add_turntable()
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
    desktop.keys(F12)
    desktop.wait(lambda state: done.exists() and not state["is_rendering"], RENDER_MAY_TAKE)
    desktop.ask(SAVE.format(name))
    return Image.open(desktop.share / f"{name}.png").convert("RGB")


@pytest.fixture(scope="module")
def loaded(installed: Desktop, finished_run: str) -> Desktop:
    """The finished run, rendered through a camera by itself; the panels are closed."""
    installed.quit()
    installed.start(python=sys.executable, sidebar=True)
    toggle(installed, VIEWER, CAPTURE)
    installed.ask(f"bpy.ops.cvdgs.load_run(directory={finished_run!r})\nbpy.ops.ed.undo_push(message='Load')")
    installed.wait(lambda state: state["engine"] == "CYCLES", VIEW_MAY_TAKE)
    installed.settle()
    toggle(installed, MAKE, DISPLAY)
    return installed


def test_a_turntable_and_its_removal_are_undone(loaded: Desktop):
    desktop = loaded
    toggle(desktop, TURNTABLE)
    before = set(desktop.state()["objects"])
    turned = before | {"Turntable", "Turntable Camera"}

    def has(names: set[str]) -> None:
        desktop.wait(lambda state: set(state["objects"]) == names, ANSWER_MAY_TAKE)

    press_until(desktop, below(TURNTABLE, ADD_TURNTABLE), lambda state: set(state["objects"]) == turned)
    press_in_view(desktop, "ctrl+z")
    has(before)
    press_in_view(desktop, "ctrl+shift+z")
    has(turned)
    desktop.picture("turntable-again")
    press_until(desktop, below(TURNTABLE, REMOVE_TURNTABLE), lambda state: set(state["objects"]) == before)
    press_in_view(desktop, "ctrl+z")
    has(turned)
    toggle(desktop, TURNTABLE)


def test_a_4k_frame_is_seen_in_the_view_and_rendered_whole(loaded: Desktop, pictures: Path):
    desktop = loaded
    desktop.ask("next(a for a in bpy.context.screen.areas if a.type == 'VIEW_3D').spaces.active.shading.type = 'SOLID'")
    desktop.ask(SET_SIZE.format(*SIZE) + DONE)
    toggle(desktop, DISPLAY)
    press_until(desktop, below(DISPLAY, VIEW_IN_COLOR), lambda state: state["is_rendering"] or desktop.tell(RENDERED))
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
    small.save(pictures / "frame-small.png")
    difference = np.asarray(large.reduce(SMALL), float).mean(axis=2) - np.asarray(small, float).mean(axis=2)
    assert np.abs(block_means(difference)).mean() < SAME


def block_means(picture: np.ndarray) -> np.ndarray:
    """(H/8, W/8) of (H, W): one sample a pixel catches threads that the mean of 64 blurs."""
    height, width = (size // BLOCK * BLOCK for size in picture.shape)
    return picture[:height, :width].reshape(height // BLOCK, BLOCK, width // BLOCK, BLOCK).mean(axis=(1, 3))
