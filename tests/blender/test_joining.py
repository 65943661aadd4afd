"""Two runs of one place, by mouse: aligned by photographs, joined, undone and done again; and redraws made faster."""

from __future__ import annotations

import shutil
import sys

import pytest

from .desktop import Desktop
from .side_bar import CAPTURE, VIEWER, header, press, press_until, toggle
from .test_second_thoughts import press_in_view
from .test_taken_away import RUN, below

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1500)]

MAKE, DISPLAY = header(2), header(3)
# Places below the header of Display: while two runs stand in each other, and when they are one.
ALIGNMENT, ALIGN_BY_PHOTOGRAPHS, JOIN, DRAW_FASTER = (101, 169), (142, 226), (142, 371), (142, 432)
OTHER = "other"
JOINED = f"{RUN} + {OTHER} Gaussians"
SOURCES = [f"{RUN} Gaussians", f"{OTHER} Gaussians"]
MOVE = f"""
import mathutils
capture = bpy.data.objects["{OTHER} Capture"]
turn = mathutils.Matrix.Translation((3.0, 1.0, 0.0)) @ mathutils.Matrix.Rotation(0.8, 4, "Z")
capture.matrix_world = turn @ mathutils.Matrix.Scale(0.6, 4) @ capture.matrix_world
bpy.ops.ed.undo_push(message="two runs")
"""
PLACES = f"""
def flat(name):
    return [value for row in bpy.data.objects[name + " Capture"].matrix_world for value in row]
apart = max(abs(a - b) for a, b in zip(flat("{RUN}"), flat("{OTHER}")))
"""
HIDDEN = f"[bpy.data.objects[name].hide_render and bpy.data.objects[name].hide_get() for name in {SOURCES}]"


@pytest.fixture(scope="module")
def two(installed: Desktop, finished_run: str) -> Desktop:
    """The finished run and a copy of it, which stands elsewhere; Display is open."""
    desktop = installed
    shutil.rmtree(desktop.share / OTHER, ignore_errors=True)
    shutil.copytree(desktop.share / RUN, desktop.share / OTHER)
    desktop.quit()
    desktop.start(python=sys.executable, sidebar=True)
    toggle(desktop, VIEWER, CAPTURE)
    for folder in (finished_run, f"/share/{OTHER}"):
        desktop.ask(f"bpy.ops.cvdgs.load_run(directory={folder!r})\nbpy.context.scene.cvdgs.display.automatic = False")
    desktop.ask(MOVE)
    desktop.settle()
    toggle(desktop, MAKE, DISPLAY, DISPLAY)  # Display is the upper one then, and open
    return desktop


def test_two_runs_are_aligned_and_joined_by_their_buttons(two: Desktop):
    assert two.tell("apart", PLACES) > 0.5
    press(two, below(DISPLAY, ALIGNMENT))
    press(two, below(DISPLAY, ALIGN_BY_PHOTOGRAPHS))
    assert two.tell("apart", PLACES) < 1e-3
    press_until(two, below(DISPLAY, JOIN), lambda state: JOINED in state["objects"])
    two.picture("joined")
    assert two.tell(HIDDEN) == [True, True]
    press_in_view(two, "ctrl+z")
    assert JOINED not in two.state()["objects"]
    assert two.tell(HIDDEN) == [False, False]
    press_in_view(two, "ctrl+shift+z")
    assert JOINED in two.state()["objects"]
    assert two.tell(HIDDEN) == [True, True]


def test_smooth_edges_are_given_up_for_faster_redraws(two: Desktop):
    smoothing = "bpy.context.preferences.system.viewport_aa"
    assert two.tell(smoothing) != "OFF"
    press(two, below(DISPLAY, DRAW_FASTER))
    assert two.tell(smoothing) == "OFF"
    two.picture("drawn-faster")
