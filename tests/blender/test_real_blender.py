"""As an artist meets it: the zip, a wrong folder, a cancelled run, a run, a second layer, save, quit, open again.

Every click is followed by a look at what it did; for its place see `side_bar`.
"""

from __future__ import annotations

import re
import subprocess
import sys
import time

import pytest

from .desktop import Desktop
from .side_bar import press, press_until

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1500)]

# Rows of the tab "CVD" that stay where they are as long as those above are closed.
CAPTURE, VIEWER_WHEN_CAPTURE_IS_EMPTY, FOLDER = (50, 16), (50, 172), (110, 46)
DRAFT, MAKE, CANCEL = (135, 168), (135, 241), (243, 123)
ADD_LAYER = (135, 220)

RUNNING, CANCELLED = "running", "cancelled"
WORKER_MAY_TAKE = 900.0  # seconds; tens on an idle machine


def enter_folder(desktop: Desktop, path: str) -> None:
    """Type a path into the field of the sub-panel Capture."""
    press(desktop, FOLDER)
    press(desktop, FOLDER)  # the second of a double click may have opened the field already
    desktop.keys("ctrl+a")
    desktop.type(path)
    desktop.keys("Return")


def run_state(state: dict) -> str:
    return state["jobs"].get("run", {}).get("state", "")


def worker_processes() -> list[str]:
    """Command lines of the workers that run by this interpreter."""
    pattern = f"{re.escape(sys.executable)} .*cvdgs/core/__main__.py"
    found = subprocess.run(["pgrep", "-af", pattern], capture_output=True, text=True)
    return found.stdout.splitlines()


def test_an_artist_makes_a_scene(installed):
    desktop = installed
    desktop.start(python=sys.executable, sidebar=True)
    desktop.picture("panel-empty")
    press(desktop, VIEWER_WHEN_CAPTURE_IS_EMPTY)

    enter_folder(desktop, "/share/nothing")
    state = desktop.wait(lambda state: bool(state["scene"]["problem"]), 60.0)
    assert "no photographs" in state["scene"]["problem"]
    desktop.picture("panel-wrong-folder")

    enter_folder(desktop, "/share/small")
    desktop.wait(lambda state: state["scene"]["views"] == 20, 60.0)
    desktop.picture("panel-capture")
    press(desktop, CAPTURE)
    press_until(desktop, DRAFT, lambda state: state["scene"]["quality"] == "DRAFT")
    press_until(desktop, MAKE, lambda state: run_state(state) == RUNNING)
    desktop.wait(lambda state: state["jobs"]["run"]["stage"] == "geometry", WORKER_MAY_TAKE)
    seconds = press_until(desktop, CANCEL, lambda state: run_state(state) == CANCELLED)
    print(f"cancelled {seconds:.1f} s after the click")
    assert worker_processes() == []
    desktop.settle()
    desktop.picture("panel-cancelled")
    assert not (desktop.share / "small CVD").exists()

    desktop.ask("seen['longest'] = 0.0")
    seconds = press_until(
        desktop, MAKE, lambda state: run_state(state) == RUNNING and bool(state["jobs"]["run"]["message"])
    )
    print(f"first words of progress {seconds:.1f} s after the click")
    desktop.wait(lambda state: state["jobs"]["run"]["previews"] >= 2, WORKER_MAY_TAKE)
    desktop.picture("panel-progress")
    stall = 0.0

    def has_ended(state: dict) -> bool:
        nonlocal stall
        if run_state(state) == RUNNING:
            stall = state["longest"]
        return run_state(state) != RUNNING

    state = desktop.wait(has_ended, WORKER_MAY_TAKE)
    assert state["jobs"]["run"]["problem"] == ""
    print(f"longest stall of the main thread while the worker ran: {1e3 * stall:.0f} ms")
    state = desktop.wait(lambda state: "color_deutan-1.0" in state["layers"], 60.0)
    assert {"small CVD Gaussians", "small CVD Capture"} <= set(state["objects"])
    time.sleep(5.0)
    desktop.keys("Escape")  # the popup that says so
    desktop.picture("panel-result")

    desktop.ask("bpy.ops.cvdgs.viewer_preset(preset='PROTANOPIA')")
    press_until(desktop, ADD_LAYER, lambda state: run_state(state) == RUNNING)
    state = desktop.wait(lambda state: run_state(state) != RUNNING, WORKER_MAY_TAKE)
    assert state["jobs"]["run"]["problem"] == ""
    state = desktop.wait(lambda state: "color_protan-1.0" in state["layers"], 60.0)
    assert state["objects"].count("small CVD Gaussians") == 1
    desktop.picture("panel-two-layers")

    desktop.ask("bpy.ops.wm.save_as_mainfile(filepath='/share/scene.blend')")
    desktop.quit()
    state = desktop.start("/share/scene.blend", python=sys.executable, sidebar=True)
    assert {"color_original", "color_deutan-1.0", "color_protan-1.0"} <= set(state["layers"])
    assert state["scene"]["run"] == "/share/small CVD"
    assert state["scene"]["cvd"] == "protan"
    desktop.picture("panel-opened-again")


@pytest.mark.parametrize("end", ["quit", "kill", "new file"])
def test_the_worker_ends_with_blender(installed, end):
    desktop = installed
    desktop.quit()
    desktop.start(python=sys.executable, sidebar=True)
    desktop.ask(
        "bpy.context.scene.cvdgs.capture.folder = '/share/small'\n"
        f"bpy.context.scene.cvdgs.run.out = '/share/ended by {end}'\n"
        "bpy.ops.cvdgs.make_cvd_friendly('INVOKE_DEFAULT')"
    )
    desktop.wait(lambda state: state["jobs"].get("run", {}).get("stage") == "geometry", WORKER_MAY_TAKE)
    assert len(worker_processes()) > 0
    if end == "quit":
        desktop.quit()
    elif end == "kill":
        desktop.kill()
    else:
        desktop.ask("bpy.ops.wm.read_homefile()")
    deadline = time.monotonic() + 20.0
    while worker_processes() and time.monotonic() < deadline:
        time.sleep(0.1)
    assert worker_processes() == []
    if end != "kill":  # a process that is killed cannot tidy up; the next run does
        assert not (desktop.share / f"ended by {end}").exists()
