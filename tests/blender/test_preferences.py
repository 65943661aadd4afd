"""Before the first scene, by mouse in the preferences: Install from Disk, finding the add-on, its worker.

Places are pixels of the screen while the 3D view's place shows the preferences.
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import pytest

from .desktop import Desktop
from .side_bar import choose_file

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]

GET_EXTENSIONS, ADDONS = (88, 248), (88, 283)
MENU, INSTALL_FROM_DISK = (1031, 72), (1100, 195)
SEARCH, UNFOLD = (400, 73), (190, 108)
SET_UP_WORKER, CHECK_WORKER = (338, 390), (616, 390)  # where online access is allowed
CANCEL_DOWNLOAD = (370, 427)
ADDON = "bl_ext.user_default.cvdgs"

SHOW_PREFERENCES = """
area = next(a for a in bpy.context.window_manager.windows[0].screen.areas if a.type == "VIEW_3D")
area.ui_type = "PREFERENCES"
bpy.context.preferences.system.use_online_access = True
"""


@pytest.fixture
def preferences(desktop: Desktop, extension: Path):
    """A Blender that has never seen the extension, with its preferences in its window, and the zip on its disk."""
    desktop.quit()
    shutil.copy(extension, desktop.share / extension.name)
    if "cvdgs" in desktop.command("--command", "extension", "list"):
        desktop.command("--command", "extension", "remove", "cvdgs")
    desktop.start()
    desktop.ask(SHOW_PREFERENCES)
    desktop.settle()
    yield desktop
    desktop.quit()
    desktop.command("--command", "extension", "remove", "cvdgs")


def test_the_zip_is_installed_found_by_its_subject_and_asks_before_it_downloads(preferences: Desktop, extension: Path):
    desktop = preferences
    desktop.click(*GET_EXTENSIONS)
    desktop.click(*MENU)
    desktop.click(*INSTALL_FROM_DISK)
    choose_file(desktop, f"/share/{extension.name}")
    desktop.settle()
    desktop.picture("preferences-installed")
    assert desktop.tell(f"{ADDON!r} in bpy.context.preferences.addons")

    desktop.click(*ADDONS)
    desktop.click(*SEARCH)
    desktop.type("cvd")
    desktop.keys("Return")
    desktop.click(*UNFOLD)
    desktop.picture("preferences-worker")

    desktop.click(*CHECK_WORKER)
    assert desktop.state()["jobs"] == {}, "there is no worker that could be checked"
    base = Path(sys.base_prefix, "bin", "python3")  # the screen's own system may lack venv
    desktop.ask(f"bpy.context.preferences.addons[{ADDON!r}].preferences.base_python = {str(base)!r}")
    desktop.click(*SET_UP_WORKER)
    desktop.picture("preferences-asks")
    assert desktop.state()["jobs"] == {}
    desktop.click(*CANCEL_DOWNLOAD)
    assert desktop.state()["jobs"] == {}, "nothing is downloaded without consent"
    assert "Traceback" not in desktop.console()
