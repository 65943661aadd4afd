"""Undo after what the panels do, an asset for other files, and files that link the scene or lie on another machine.

Every click is followed by a look at what it did; for its place see `side_bar`.
"""

from __future__ import annotations

import shutil
import sys

import pytest

from .desktop import Desktop
from .side_bar import CAPTURE, VIEWER, choose_file, header, press, press_until, toggle
from .test_colour_at_once import LEAST_SHARE, PREVIEW, RENDER_MAY_TAKE, VIEW, coloured_share
from .test_taken_away import RUN, below

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1500)]

MAKE, DISPLAY, SIMULATE = header(2), header(3), header(4)
# Places below the headers, while all other sub-panels are closed, after View in Colour.
ENHANCED, RELIGHT_HEADER, RELIGHT = (202, 203), (36, 302), (112, 335)
UNDO_MAY_TAKE = 60.0  # seconds while Cycles draws the view; one on an idle machine
FROM_OUTSIDE = 0.01  # of the view's pixels, that are coloured; most are backs of walls
RENDERS, SAVE_ASSET = (81, 31), (134, 228)
SPLATS = f"bpy.data.objects['{RUN} Gaussians']"
SPLATS_MODULE = "__import__('bl_ext.user_default.cvdgs.cvdgs_addon.scene.splats', fromlist=['x'])"
IN_RENDERS = "bpy.context.scene.cvdgs.simulate.in_renders"
NODES = "len(bpy.context.scene.compositing_node_group.nodes) if bpy.context.scene.compositing_node_group else 0"
LINK = """
with bpy.data.libraries.load("/share/elsewhere/shop.blend", link=True) as (source, target):
    target.objects = [name for name in source.objects if name.endswith("Gaussians")]
for linked in target.objects:
    bpy.context.scene.collection.objects.link(linked)
"""
OVERRIDE = f"""
linked = next(found for found in bpy.context.scene.objects if found.library)
made = linked.override_create(remap_local_usages=True)
{SPLATS_MODULE}.set_input(made, "Enhanced", 0.25)
bpy.context.view_layer.update()
"""


def value_of(desktop: Desktop, name: str) -> float:
    """An input of the Gaussians."""
    return float(desktop.tell(f"{SPLATS_MODULE}.get_input({SPLATS}, {name!r})"))


def press_in_view(desktop: Desktop, *keys: str) -> None:
    x, y, width, height = desktop.state()["places"]["VIEW_3D WINDOW"]
    desktop.hover(x + width / 4, y + 0.85 * height)
    desktop.keys(*keys)


@pytest.fixture(scope="module")
def loaded(installed: Desktop, finished_run: str) -> Desktop:
    """The finished run, rendered through a camera by itself; the panels are closed."""
    desktop = installed
    for folder in ("assets", "elsewhere"):
        shutil.rmtree(desktop.share / folder, ignore_errors=True)
        (desktop.share / folder).mkdir()
    desktop.quit()
    desktop.start(python=sys.executable, sidebar=True)
    toggle(desktop, VIEWER, CAPTURE)
    desktop.ask(f"bpy.ops.cvdgs.load_run(directory={finished_run!r})\nbpy.ops.ed.undo_push(message='Load')")
    desktop.wait(lambda state: state["engine"] == "CYCLES", RENDER_MAY_TAKE)
    desktop.settle()
    toggle(desktop, MAKE, DISPLAY)
    return desktop


def test_the_simulation_is_undone_and_done_again(loaded: Desktop):
    desktop = loaded
    toggle(desktop, SIMULATE)
    press(desktop, below(SIMULATE, RENDERS))
    assert desktop.tell(IN_RENDERS)
    made = desktop.tell(NODES)
    assert made > 0
    press_in_view(desktop, "ctrl+z")
    assert not desktop.tell(IN_RENDERS)
    assert desktop.tell(NODES) == 0
    press_in_view(desktop, "ctrl+shift+z")
    assert desktop.tell(IN_RENDERS)
    assert desktop.tell(NODES) == made
    press_in_view(desktop, "ctrl+z")


def test_the_node_is_saved_as_an_asset_where_somebody_chooses(loaded: Desktop):
    desktop = loaded
    press(desktop, below(SIMULATE, SAVE_ASSET))
    choose_file(desktop, "/share/assets/")
    assert [file.name for file in (desktop.share / "assets").iterdir()] == ["CVD simulation.blend"]
    toggle(desktop, SIMULATE)


def test_a_slider_that_is_dragged_is_one_step_of_undo(loaded: Desktop):
    desktop = loaded
    toggle(desktop, DISPLAY)
    x, y, _, _ = desktop.state()["places"]["VIEW_3D UI"]
    place = below(DISPLAY, ENHANCED)
    desktop.slide(x + place[0], y + place[1], -150)
    assert 0.0 < value_of(desktop, "Enhanced") < 0.7
    desktop.picture("slider-dragged")
    press_in_view(desktop, "ctrl+z")
    assert value_of(desktop, "Enhanced") == 1.0


def test_relighting_is_undone_with_its_lamp(loaded: Desktop):
    desktop = loaded
    before = set(desktop.state()["objects"])
    toggle(desktop, below(DISPLAY, RELIGHT_HEADER))
    press_until(desktop, below(DISPLAY, RELIGHT), lambda state: set(state["objects"]) != before)
    assert value_of(desktop, "Relight") == 1.0
    assert set(desktop.state()["objects"]) - before == {"Relight Lamp"}
    desktop.picture("relit")
    press_in_view(desktop, "ctrl+z")
    desktop.wait(lambda state: value_of(desktop, "Relight") == 0.0, UNDO_MAY_TAKE)
    assert set(desktop.state()["objects"]) == before


def test_a_file_on_another_machine_and_one_that_links_it_show_colours(loaded: Desktop):
    desktop = loaded
    desktop.ask("bpy.ops.wm.save_as_mainfile(filepath='/share/elsewhere/shop.blend')")
    desktop.quit()
    moved = (desktop.share / RUN).rename(desktop.share / f"{RUN} elsewhere")  # as good as not there
    try:
        desktop.start("/share/elsewhere/shop.blend", python=sys.executable)
        desktop.settle()
        assert desktop.tell(VIEW)[:2] == PREVIEW[:2]
        assert coloured_share(desktop, "on-another-machine") > LEAST_SHARE
        desktop.quit()

        desktop.start(python=sys.executable)
        desktop.settle()
        desktop.ask(LINK)
        desktop.settle()
        assert desktop.tell(VIEW)[:2] == PREVIEW[:2]
        assert coloured_share(desktop, "linked") > FROM_OUTSIDE
        assert desktop.tell(f"{SPLATS_MODULE}.get_input(made, 'Enhanced')", OVERRIDE) == 0.25
        assert coloured_share(desktop, "overridden") > FROM_OUTSIDE
        desktop.quit()
    finally:
        moved.rename(desktop.share / RUN)
