"""What an artist does with a finished scene: looks at it through another's eyes, and lets it turn."""

from __future__ import annotations

import sys
import time
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from .desktop import SCALE, Desktop
from .picture_files import FOR_PICTURES, save_smaller
from .side_bar import CAPTURE, MAKE, VIEWER, header, press_until, toggle

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1800)]

FRAMES = 3
RENDER_MAY_TAKE = 300.0  # seconds; a few on an idle machine
SETTINGS_MAY_TAKE = 30.0  # seconds to come back; half of one on an idle machine
VIEW_MAY_TAKE = 900.0  # seconds; a minute or two on an idle machine
LOOKS, LOOK_SECONDS = 4, 2.0  # at a Blender that is at rest
AT_REST = 0.15  # seconds of the processor a second; Cycles keeps all of it busy, the watching takes half of this
STILL = 4.0  # grey levels by which a picture of the same thing may differ from another in the mean
LEAST_CONTRAST = 20.0  # deviation in grey levels; an empty view has less
# Pixels below the header of Display, before and after the view is in colour.
VIEW_IN_COLOR, SIMULATE_BELOW_DISPLAY = 57.0, 447.0

# Nothing in front of the picture, and room for it.
CLEAR = """
bpy.data.objects.remove(bpy.data.objects["Cube"])
bpy.context.preferences.system.use_region_overlap = False
area = next(a for a in bpy.context.window_manager.windows[0].screen.areas if a.type == "VIEW_3D")
space = area.spaces.active
space.overlay.show_overlays = space.show_gizmo = space.show_region_toolbar = space.show_region_tool_header = False
bpy.context.scene.camera = bpy.data.objects["Turntable Camera"]
render = bpy.context.scene.render
render.resolution_x, render.resolution_y = 640, 480
"""
FILL_THE_WINDOW = """
area = next(a for a in bpy.context.window_manager.windows[0].screen.areas if a.type == "VIEW_3D")
with bpy.context.temp_override(area=area):
    bpy.ops.screen.screen_full_area()
"""
FIT_THE_FRAME = """
area = next(a for a in bpy.context.window_manager.windows[0].screen.areas if a.type == "VIEW_3D")
with bpy.context.temp_override(area=area):
    bpy.ops.cvdgs.view_in_color()
"""
SHADING = "[a.spaces.active.shading.type for a in bpy.context.screen.areas if a.type == 'VIEW_3D']"


@pytest.fixture(scope="module")
def shown(installed: Desktop, finished_run: str) -> Desktop:
    """The finished run, loaded and looked at through a camera in Cycles, which needs no graphics card."""
    installed.quit()
    installed.start(python=sys.executable, sidebar=True)
    toggle(installed, MAKE, VIEWER, CAPTURE)
    installed.ask(f"bpy.ops.cvdgs.load_run(directory={finished_run!r})")
    installed.wait(lambda state: "finished Gaussians" in state["objects"], 60.0)
    installed.ask("bpy.ops.cvdgs.add_turntable()")
    installed.ask(CLEAR)
    installed.settle()
    x, y = header(3)
    press_until(installed, (x, y + VIEW_IN_COLOR), lambda state: state["engine"] == "CYCLES")
    installed.settle()
    toggle(installed, (x, y + SIMULATE_BELOW_DISPLAY))
    assert installed.tell(SHADING) == ["RENDERED"]
    return installed


def settled_view(desktop: Desktop, name: str) -> np.ndarray:
    """(H, W, 3) picture of the 3D view, without its side bar, once something is drawn and Blender is at rest."""
    deadline = time.monotonic() + VIEW_MAY_TAKE
    while time.monotonic() < deadline:
        if not is_at_rest(desktop):
            continue
        x, y, width, height = desktop.state()["places"]["VIEW_3D WINDOW"]
        shown = desktop.look(name).crop((x, y, x + width, y + height))
        if np.asarray(shown, float).std() >= LEAST_CONTRAST:
            return np.asarray(shown, float)
    raise AssertionError("the 3D view draws nothing, or does not come to rest")


def is_at_rest(desktop: Desktop) -> bool:
    """Whether Blender leaves the processor alone for some seconds: Cycles has shown its last pass."""
    for _ in range(LOOKS):
        before, looked = desktop.state()["processor"], time.monotonic()
        time.sleep(LOOK_SECONDS)
        if desktop.state()["processor"] - before > AT_REST * (time.monotonic() - looked):
            return False
    return True


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
    shown.ask("bpy.context.scene.cvdgs.simulate.in_viewport = False")
    assert np.abs(settled_view(shown, "view-again") - plain).mean() < STILL


def test_the_comparison_has_the_original_on_the_left_and_both_as_the_observer_sees_them(shown: Desktop):
    shown.ask("simulate = bpy.context.scene.cvdgs.simulate; simulate.wipe = False; simulate.in_viewport = True")
    enhanced = settled_view(shown, "view-enhanced-seen")
    shown.ask("bpy.ops.cvdgs.compare()")
    compared = settled_view(shown, "view-compared")
    third = enhanced.shape[1] // 3
    assert np.abs(compared - enhanced)[:, :third].mean() > 1.0
    assert np.abs(compared - enhanced)[:, -third:].mean() < STILL
    shown.ask("bpy.ops.cvdgs.compare()")


@FOR_PICTURES
def test_the_picture_for_the_readme_is_drawn(shown: Desktop, pictures: Path):
    shown.ask(FILL_THE_WINDOW)
    shown.settle()
    shown.ask(FIT_THE_FRAME)
    shown.settle()
    shown.ask(
        f"bpy.context.scene.render.preview_pixel_size = '{SCALE}'\n"
        "simulate = bpy.context.scene.cvdgs.simulate\n"
        "simulate.in_viewport = simulate.wipe = True; simulate.wipe_position = 0.5"
    )
    settled_view(shown, "view-fine")
    shown.leave()
    places = [place for name, place in shown.state()["places"].items() if name.startswith("VIEW_3D")]
    left, top = (min(place[axis] for place in places) for axis in (0, 1))
    right, bottom = (max(place[axis] + place[axis + 2] for place in places) for axis in (0, 1))
    save_smaller(shown.cut("result-whole", (left, top, right, bottom)), pictures / "result.png")
    shown.ask(FILL_THE_WINDOW)  # and back


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
    shown.wait(lambda state: state["engine"] == before, SETTINGS_MAY_TAKE)
