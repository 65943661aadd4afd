"""What an artist takes away from a finished scene, by mouse: a turntable's pictures, splats, a LUT, and the file.

Every click is followed by a look at what it did; for its place see `side_bar`.
"""

from __future__ import annotations

import shutil
import sys

import numpy as np
import pytest
from PIL import Image

from cvdgs.core.splats.ply import read_ply

from .desktop import Desktop
from .side_bar import (
    CAPTURE,
    MAKE,
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

LOAD_RUN = (142, 427)  # in an empty scene
# Places below the header of their sub-panel, while all above it are closed.
DISPLAY, SIMULATE, TURNTABLE, EXPORT = header(3), header(4), header(5), header(7)
FRAMES, ADD_TURNTABLE, WIDTH, HEIGHT, RENDER = (142, 31), (142, 141), (75, 193), (195, 193), (142, 245)
GAUSSIANS, CUBE = (142, 52), (142, 72)
ENHANCED = (142, 156)
IN_VIEWPORT = (193, 31)

FRAME_COUNT, SIZE = 3, (160, 120)
RENDER_MAY_TAKE = 600.0  # seconds; a few on an idle machine
SETTINGS_MAY_TAKE = 30.0  # seconds to come back; half of one on an idle machine
RUN = "finished"  # folder of `finished_run`
# How far the layer is shown, in Blender's Python.
SLIDER = (
    "__import__('bl_ext.user_default.cvdgs.cvdgs_addon.shown', fromlist=['x'])"
    ".shown_layer(bpy.data.objects['Gaussians'])[1]"
)


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
    choose_folder(desktop, LOAD_RUN, finished_run)
    desktop.wait(lambda state: "Gaussians" in state["objects"], 60.0)
    desktop.ask("bpy.data.objects.remove(bpy.data.objects['Cube'])")
    desktop.settle()
    toggle(desktop, MAKE, VIEWER, CAPTURE, DISPLAY)
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
