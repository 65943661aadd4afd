"""What an artist takes away from a finished scene, by mouse: a turntable's pictures, splats, a LUT, and the file.

The file is opened again, and goes on.

Every click is followed by a look at what it did; for its place see `side_bar`.
"""

from __future__ import annotations

import shutil
import sys

import numpy as np
import pytest
from PIL import Image

from cvdgs.core.splats.io.ply import read_ply

from .desktop import SCALE, Desktop
from .side_bar import (
    CAPTURE,
    VIEWER,
    choose_folder,
    header,
    press,
    press_until,
    save,
    save_as,
    take_proposal,
    toggle,
    type_into,
)

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1800)]

# Places below the header of their sub-panel, while all above it are closed.
CLOSED_VIEWER, MAKE, DISPLAY, SIMULATE, TURNTABLE, EXPORT = (header(number) for number in (1, 2, 3, 4, 5, 7))
LOAD_RUN, ADD_LAYER = (142, 69), (135, 118)  # before a run is there, and when it lacks the viewer's layer
PRESETS = (142, 31)
FRAMES, ADD_TURNTABLE, WIDTH, HEIGHT, RENDER = (142, 31), (142, 141), (75, 167), (195, 167), (142, 242)
GAUSSIANS, CUBE = (142, 70), (142, 132)
ENHANCED = (142, 177)
VIEW_IN_COLOR = (142, 57)
IN_VIEWPORT = (193, 31)

FRAME_COUNT, SIZE = 3, (160, 120)
RENDER_MAY_TAKE = 600.0  # seconds; a few on an idle machine
SETTINGS_MAY_TAKE = 30.0  # seconds to come back; half of one on an idle machine
LAYER_MAY_TAKE = 600.0  # seconds; ten on an idle machine
MENU_STEPS = 3  # from the upper end of the menu of presets to protanomaly
RUN = "finished"  # folder of `finished_run`
# How far the layer is shown, in Blender's Python.
SLIDER = (
    "__import__('bl_ext.user_default.cvdgs.cvdgs_addon.shown', fromlist=['x'])"
    ".shown_layer(bpy.data.objects['finished Gaussians'])[1]"
)


# The corners of the camera's frame in the 3D view, in pixels from its lower left corner.
CAMERA_FRAME = """
from bpy_extras.view3d_utils import location_3d_to_region_2d
area = next(a for a in bpy.context.window_manager.windows[0].screen.areas if a.type == "VIEW_3D")
region = next(r for r in area.regions if r.type == "WINDOW")
camera = bpy.context.scene.camera
places = [camera.matrix_world @ corner for corner in camera.data.view_frame(scene=bpy.context.scene)]
corners = [list(location_3d_to_region_2d(region, area.spaces.active.region_3d, place)) for place in places]
"""


def below(panel: tuple[float, float], place: tuple[float, float]) -> tuple[float, float]:
    return place[0], panel[1] + place[1]


def settings(desktop: Desktop) -> dict:
    """What the panels keep with the scene, as far as the test changes it."""
    group = "bpy.context.scene.cvdgs"
    return desktop.tell(
        f"dict(frames={group}.turntable.frames, width={group}.turntable.width, height={group}.turntable.height_pixels,"
        f" in_viewport={group}.simulate.in_viewport, node=bool(bpy.context.scene.compositing_node_group))"
    )


@pytest.fixture(scope="module")
def loaded(installed: Desktop, finished_run: str) -> Desktop:
    """The finished run, loaded with the file browser; the panels are closed."""
    desktop = installed
    shutil.rmtree(desktop.share / "turntable", ignore_errors=True)
    for file in (desktop.share / "shop.blend", *desktop.share.glob(f"{RUN} *")):
        file.unlink(missing_ok=True)
    desktop.quit()
    desktop.start(python=sys.executable, sidebar=True)
    toggle(desktop, VIEWER, CAPTURE)
    choose_folder(desktop, below(MAKE, LOAD_RUN), finished_run)
    desktop.wait(lambda state: "finished Gaussians" in state["objects"], 60.0)
    desktop.ask("bpy.data.objects.remove(bpy.data.objects['Cube'])")
    desktop.settle()
    toggle(desktop, MAKE, DISPLAY)
    desktop.picture("loaded")
    return desktop


def test_the_turntable_is_set_and_rendered_beside_the_file_that_was_saved(loaded: Desktop):
    desktop, folder = loaded, loaded.share / "turntable"
    toggle(desktop, TURNTABLE)
    fields = ((FRAMES, FRAME_COUNT, "frames"), (WIDTH, SIZE[0], "width"), (HEIGHT, SIZE[1], "height_pixels"))
    for place, number, name in fields:
        type_into(desktop, below(TURNTABLE, place), number, f"bpy.context.scene.cvdgs.turntable.{name}")
    press_until(desktop, below(TURNTABLE, ADD_TURNTABLE), lambda state: "Turntable Camera" in state["objects"])
    desktop.picture("turntable-settings")

    press(desktop, below(TURNTABLE, RENDER))
    desktop.picture("turntable-where")
    desktop.keys("Escape")  # the popup that says where the pictures would go
    assert not desktop.state()["is_rendering"]
    save_as(desktop, "/share/shop.blend")
    assert (desktop.share / "shop.blend").is_file()

    before = desktop.state()["engine"]
    press_until(desktop, below(TURNTABLE, RENDER), lambda state: state["is_rendering"] or folder.exists())
    last = folder / f"{FRAME_COUNT:04}.png"
    desktop.wait(lambda state: last.is_file() and not state["is_rendering"], RENDER_MAY_TAKE)
    pictures = [np.asarray(Image.open(path), float) for path in sorted(folder.iterdir())]
    assert [picture.shape for picture in pictures] == [(SIZE[1], SIZE[0], 3)] * FRAME_COUNT
    desktop.wait(lambda state: state["engine"] == before, SETTINGS_MAY_TAKE)
    toggle(desktop, TURNTABLE)


def test_splats_and_lut_are_named_after_the_run_and_what_is_shown(loaded: Desktop):
    desktop, run = loaded, loaded.share / RUN
    toggle(desktop, EXPORT)
    take_proposal(desktop, below(EXPORT, GAUSSIANS), "export-gaussians")
    exported = read_ply(desktop.share / f"{RUN} deutan-1.0.ply")
    expected = read_ply(run / "splats.deutan-1.0.ply")
    np.testing.assert_allclose(exported.base_colors, expected.base_colors, atol=1e-5)

    toggle(desktop, EXPORT, DISPLAY)
    type_into(desktop, below(DISPLAY, ENHANCED), 0.25, SLIDER)
    desktop.picture("display-quarter")
    toggle(desktop, DISPLAY, EXPORT)
    take_proposal(desktop, below(EXPORT, GAUSSIANS), "export-gaussians-again")
    original = read_ply(run / "splats.ply").base_colors
    blended = read_ply(desktop.share / f"{RUN} deutan-1.0 at 25 percent.ply").base_colors
    np.testing.assert_allclose(blended, 0.75 * original + 0.25 * expected.base_colors, atol=1e-4)

    take_proposal(desktop, below(EXPORT, CUBE), "export-cube")
    cube = desktop.share / f"{RUN} deutan-1.0.cube"
    assert cube.read_bytes() == (run / "layer.deutan-1.0.cube").read_bytes()
    toggle(desktop, EXPORT)


def test_the_file_opens_again_as_it_was_left(loaded: Desktop):
    desktop, file = loaded, loaded.share / "shop.blend"
    toggle(desktop, SIMULATE)
    press(desktop, below(SIMULATE, IN_VIEWPORT))
    toggle(desktop, SIMULATE)
    left = settings(desktop)
    assert left["in_viewport"]
    assert left["node"]
    saved = file.stat().st_mtime_ns
    save(desktop)
    desktop.wait(lambda _: file.stat().st_mtime_ns > saved, 60.0)
    objects = set(desktop.state()["objects"])
    desktop.quit()

    state = desktop.start("/share/shop.blend", python=sys.executable, sidebar=True)
    assert set(state["objects"]) == objects
    assert {"color_original", "color_deutan-1.0"} <= set(state["layers"])
    assert state["scene"]["run"] == f"/share/{RUN}"
    assert settings(desktop) == left
    assert desktop.tell(SLIDER) == pytest.approx(0.25)
    desktop.picture("opened-again")

    toggle(desktop, DISPLAY)  # it works as well
    type_into(desktop, below(DISPLAY, ENHANCED), 1.0, SLIDER)
    toggle(desktop, DISPLAY, EXPORT)
    (desktop.share / f"{RUN} deutan-1.0.ply").unlink()
    take_proposal(desktop, below(EXPORT, GAUSSIANS), "export-opened-again")
    assert (desktop.share / f"{RUN} deutan-1.0.ply").is_file()
    toggle(desktop, EXPORT)


def test_the_file_that_was_opened_again_gets_a_layer_for_another_observer(loaded: Desktop):
    desktop = loaded
    toggle(desktop, CLOSED_VIEWER)
    press(desktop, below(CLOSED_VIEWER, PRESETS))
    desktop.keys(*["Down"] * MENU_STEPS, "Return")
    viewer = desktop.state()["scene"]
    assert (viewer["cvd"], round(viewer["severity"], 3)) == ("protan", 0.6)
    toggle(desktop, CLOSED_VIEWER, MAKE)
    desktop.picture("layer-for-another")
    press_until(desktop, below(MAKE, ADD_LAYER), lambda state: "run" in state["jobs"])
    state = desktop.wait(lambda state: state["jobs"]["run"]["state"] != "running", LAYER_MAY_TAKE)
    assert state["jobs"]["run"]["problem"] == ""
    state = desktop.wait(lambda state: "color_protan-0.6" in state["layers"], 60.0)
    assert state["objects"].count("finished Gaussians") == 1
    desktop.keys("Escape")  # the popup that says so
    saved = (desktop.share / "shop.blend").stat().st_mtime_ns
    save(desktop)
    desktop.wait(lambda _: (desktop.share / "shop.blend").stat().st_mtime_ns > saved, 60.0)
    desktop.quit()

    state = desktop.start("/share/shop.blend", python=sys.executable, sidebar=True)
    assert {"color_original", "color_deutan-1.0", "color_protan-0.6"} <= set(state["layers"])
    desktop.picture("opened-with-the-new-layer")


def test_undo_leaves_what_was_found_in_the_folder(loaded: Desktop):
    desktop, folder = loaded, "/share/small"
    desktop.ask(
        f"bpy.context.scene.cvdgs.capture.folder = {folder!r}\n"
        "bpy.ops.ed.undo_push(message='the folder')"  # as the field does
    )
    desktop.wait(lambda state: state["scene"]["inspected"] == folder, LAYER_MAY_TAKE)
    before = set(desktop.state()["objects"])
    desktop.ask("bpy.ops.mesh.primitive_cube_add()\nbpy.ops.ed.undo_push(message='a cube')")
    desktop.wait(lambda state: set(state["objects"]) > before, 60.0)
    x, y, width, height = desktop.state()["places"]["VIEW_3D WINDOW"]
    desktop.hover(x + width / 3, y + height / 3)
    desktop.keys("ctrl+z")
    desktop.wait(lambda state: set(state["objects"]) == before, 60.0)
    desktop.wait(lambda state: state["scene"]["inspected"] == folder, LAYER_MAY_TAKE)
    desktop.keys("ctrl+shift+z")
    desktop.wait(lambda state: set(state["objects"]) > before, 60.0)


def test_the_view_in_colour_shows_all_of_the_cameras_frame_beside_the_side_bar(loaded: Desktop):
    desktop = loaded
    toggle(desktop, MAKE, DISPLAY)
    press_until(desktop, below(DISPLAY, VIEW_IN_COLOR), lambda state: state["engine"] == "CYCLES")
    assert desktop.state()["camera"] == "Turntable Camera"
    corners = np.array(desktop.tell("corners", CAMERA_FRAME)) / SCALE
    places = desktop.state()["places"]
    left, _, width, height = places["VIEW_3D WINDOW"]
    assert corners.min() >= 0.0
    assert corners[:, 0].max() <= places["VIEW_3D UI"][0] - left
    assert corners[:, 1].max() <= height
    size = np.ptp(corners, axis=0)
    assert max(size[0] / width, size[1] / height) > 0.6
