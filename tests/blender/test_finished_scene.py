"""What an artist does with a finished scene: looks at it through another's eyes, and lets it turn."""

from __future__ import annotations

import sys
import time
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from .desktop import Desktop

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1800)]

FRAMES = 3
RENDER_MAY_TAKE = 300.0  # seconds; a few on an idle machine
VIEW_MAY_TAKE = 400.0
PASS_MAY_TAKE = 45.0  # of the view: Cycles shows it in passes, from coarse to fine
STILL = 4.0  # grey levels by which a picture of the same thing may differ from another in the mean
LEAST_CONTRAST = 20.0  # deviation in grey levels; an empty view has less
WINDOW = (0, 20, 1024, 690)  # what docs/result.png shows of the screen, in pixels: the 3D view and its side bar

LOOK = """
bpy.data.objects.remove(bpy.data.objects["Cube"])
area = next(a for a in bpy.context.window_manager.windows[0].screen.areas if a.type == "VIEW_3D")
space = area.spaces.active
space.region_3d.view_perspective = "CAMERA"
space.overlay.show_overlays = False
# Without a graphics card: discs, a quarter of the pixels, and only those that the camera sees.
from bl_ext.user_default.cvdgs.cvdgs_addon.scene import splats
splats.set_input(bpy.data.objects["Gaussians"], "Camera View", True)
bpy.context.scene.camera = next(o for o in bpy.data.objects if o.type == "CAMERA" and o.parent)  # the turntable's
bpy.context.scene.render.preview_pixel_size = "2"
bpy.context.scene.render.use_border = True
space.shading.type = "RENDERED"
with bpy.context.temp_override(area=area, region=next(r for r in area.regions if r.type == "WINDOW")):
    bpy.ops.view3d.view_center_camera()
"""


@pytest.fixture(scope="module")
def shown(installed: Desktop, finished_run: str) -> Desktop:
    """The finished run, loaded and looked at through a camera in Cycles, which needs no graphics card."""
    installed.quit()
    installed.start(python=sys.executable, sidebar=True)
    installed.ask(f"bpy.ops.cvdgs.load_run(directory={finished_run!r})")
    installed.wait(lambda state: "Gaussians" in state["objects"], 60.0)
    installed.ask("bpy.ops.cvdgs.set_up_render()")
    installed.ask("bpy.ops.cvdgs.add_turntable()")
    installed.ask(LOOK)
    return installed


def settled_view(desktop: Desktop, name: str) -> np.ndarray:
    """(H, W, 3) picture of the 3D view, without its side bar, once something is drawn and does not change any more."""
    before, changed, deadline = None, time.monotonic(), time.monotonic() + VIEW_MAY_TAKE
    while time.monotonic() < deadline:
        path = desktop.picture(name)
        x, y, width, height = desktop.state()["places"]["VIEW_3D WINDOW"]
        side_bar = desktop.state()["places"]["VIEW_3D UI"][0]
        box = (x, y, min(x + width, side_bar), y + height)
        now = np.asarray(Image.open(path).convert("RGB").crop(box), float)
        if before is None or not np.array_equal(before, now) or now.std() < LEAST_CONTRAST:
            before, changed = now, time.monotonic()
        elif time.monotonic() > changed + PASS_MAY_TAKE:
            return now
        time.sleep(1.0)
    raise AssertionError("the 3D view draws nothing, or does not come to rest")


def test_the_viewport_shows_the_scene_as_the_observer_sees_it(shown: Desktop, pictures: Path):
    plain = settled_view(shown, "view-plain")
    shown.ask("bpy.context.scene.cvdgs.simulate.in_viewport = True")
    simulated = settled_view(shown, "view-simulated")
    assert np.abs(simulated - plain).mean() > 1.0
    shown.ask("simulate = bpy.context.scene.cvdgs.simulate; simulate.wipe = True; simulate.wipe_position = 0.5")
    wiped = settled_view(shown, "view-wiped")
    third = plain.shape[1] // 3
    assert np.abs(wiped - plain)[:, :third].mean() < STILL
    assert np.abs(wiped - simulated)[:, -third:].mean() < STILL
    Image.open(pictures / "view-wiped.png").convert("RGB").crop(WINDOW).save(pictures / "result.png", optimize=True)
    shown.ask("bpy.context.scene.cvdgs.simulate.in_viewport = False")
    assert np.abs(settled_view(shown, "view-again") - plain).mean() < STILL


def test_the_turntable_button_renders_the_turn_and_puts_the_settings_back(shown: Desktop):
    folder = shown.share / "turn"
    before = shown.state()["engine"]
    shown.ask(
        "area = next(a for a in bpy.context.window_manager.windows[0].screen.areas if a.type == 'VIEW_3D')\n"
        "area.spaces.active.shading.type = 'SOLID'\n"  # one Cycles is enough
        "turntable = bpy.context.scene.cvdgs.turntable\n"
        f"turntable.frames, turntable.width, turntable.height_pixels = {FRAMES}, 160, 120\n"
        "turntable.folder = '/share/turn'\n"
        "bpy.ops.cvdgs.render_turntable('INVOKE_DEFAULT')"
    )
    last = folder / f"{FRAMES:04}.png"
    shown.wait(lambda state: last.is_file() and not state["is_rendering"], RENDER_MAY_TAKE)
    pictures = [np.asarray(Image.open(path), float) for path in sorted(folder.iterdir())]
    assert [picture.shape for picture in pictures] == [(120, 160, 3)] * FRAMES
    assert all(np.abs(a - b).mean() > 1.0 for a, b in pairwise(pictures))
    assert shown.state()["engine"] == before
