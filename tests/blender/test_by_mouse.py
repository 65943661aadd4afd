"""What a stranger does with the mouse beside the main way: the arrangement test, and imports.

Every click is followed by a look at what it did; for its place see `side_bar`.
"""

from __future__ import annotations

import shutil
import sys

import colour
import numpy as np
import pytest
from daltonlens import simulate

from .desktop import Desktop
from .side_bar import change_mind, choose_folder, press_until, toggle

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1800)]

# Rows of the tab "CVD" while the scene is empty and nothing but "In the Scene" was opened.
ARRANGEMENT_TEST, IN_THE_SCENE, IMPORT, NEXT_CAMERA = (142, 324), (80, 144), (142, 175), (190, 253)
# Of the arrangement test.
CAPS, CAPS_A_ROW = 15, 8
FIRST_CAP, CAP_STEP, REFERENCE_CAP, SECOND_IN_ROW = (35.0, 420.0), (28.4, 28.0), (31.0, 515.0), (64.0, 515.0)
USE_SUGGESTION = (142, 512)

WORKER_MAY_TAKE = 300.0  # seconds; a few on an idle machine


@pytest.fixture
def empty_scene(installed: Desktop) -> Desktop:
    """A Blender that was just started."""
    installed.quit()
    shutil.rmtree(installed.share / "small Undistorted", ignore_errors=True)
    installed.start(python=sys.executable, sidebar=True)
    return installed


def free_cap(number: int) -> tuple[float, float]:
    """Place of a cap that is offered, counted from 0."""
    row, column = divmod(number, CAPS_A_ROW)
    return FIRST_CAP[0] + column * CAP_STEP[0], FIRST_CAP[1] + row * CAP_STEP[1]


def arranged(state: dict) -> int:
    return state["scene"]["caps_arranged"]


def as_protan(desktop: Desktop, places: list[tuple[float, float]]) -> np.ndarray:
    """(P, 3) CIELAB colours that a protanope sees at places of the side bar."""
    screen = np.asarray(desktop.look("caps"))
    x, y, _, _ = desktop.state()["places"]["VIEW_3D UI"]
    shown = np.array([[screen[round(y + place[1]), round(x + place[0])] for place in places]], np.uint8)
    seen = simulate.Simulator_Machado2009().simulate_cvd(shown, simulate.Deficiency.PROTAN, 1.0)
    return colour.XYZ_to_Lab(colour.sRGB_to_XYZ(seen[0] / 255.0))


def test_what_a_protanope_arranges_suggests_a_protans_eyes(empty_scene: Desktop):
    desktop = empty_scene
    press_until(desktop, ARRANGEMENT_TEST, lambda state: state["scene"]["test_is_open"])
    press_until(desktop, free_cap(0), lambda state: arranged(state) == 1)
    press_until(desktop, SECOND_IN_ROW, lambda state: arranged(state) == 0)
    last = as_protan(desktop, [REFERENCE_CAP])[0]
    for count in range(CAPS):
        offered = as_protan(desktop, [free_cap(number) for number in range(CAPS - count)])
        nearest = int(np.linalg.norm(offered - last, axis=1).argmin())
        last = offered[nearest]
        press_until(desktop, free_cap(nearest), lambda state, goal=count + 1: arranged(state) == goal)
    desktop.picture("arranged")
    press_until(desktop, USE_SUGGESTION, lambda state: not state["scene"]["test_is_open"])
    scene = desktop.state()["scene"]
    assert scene["cvd"] == "protan"
    assert scene["severity"] >= 0.8


def test_a_capture_is_imported_in_the_background(empty_scene: Desktop):
    desktop = empty_scene
    before = desktop.state()["objects"]
    toggle(desktop, IN_THE_SCENE)
    change_mind(desktop, IMPORT)
    assert desktop.state()["jobs"] == {}

    choose_folder(desktop, IMPORT, "/share/nothing")
    state = desktop.wait(lambda state: bool(state["jobs"].get("import", {}).get("problem")), WORKER_MAY_TAKE)
    assert "no photographs" in state["jobs"]["import"]["problem"]
    assert state["objects"] == before
    desktop.picture("import-refused")
    desktop.keys("Escape")  # the popup that says so

    choose_folder(desktop, IMPORT, "/share/small")
    state = desktop.wait(lambda state: "Sparse Points" in state["objects"], WORKER_MAY_TAKE)
    assert state["jobs"]["import"]["state"] == "done"  # of a worker that nothing waited for
    assert sum(name.startswith("view_") for name in state["objects"]) == 20
    desktop.settle()
    press_until(desktop, NEXT_CAMERA, lambda state: state["camera"].startswith("view_"))
    desktop.picture("import-through-a-camera")

    desktop.ask(
        "bpy.context.scene.cvdgs.capture.folder = '/share/small Undistorted'\n"
        "bpy.ops.cvdgs.import_capture('INVOKE_DEFAULT')"  # the folder that is picked now, and not the last one
    )
    state = desktop.wait(lambda state: "Sparse Points.001" in state["objects"], WORKER_MAY_TAKE)
    assert len(state["objects"]) == len(before) + 2 * (20 + 2)
