"""docs/panel.png: the side bar with a capture, during a run, and with the report of a finished one."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import pytest
from PIL import Image

from cvdgs.core.demo import SHOWROOM

from .desktop import SCALE, Desktop
from .picture_files import FOR_PICTURES, save_smaller
from .side_bar import CAPTURE, VIEWER, header, press_until, toggle

pytestmark = [pytest.mark.slow, pytest.mark.timeout(3000), FOR_PICTURES]

MAKE_HEADER, DISPLAY_HEADER, REPORT_HEADER = header(2), header(3), header(6)
MAKE_BUTTON = (135, 241)  # below the output folder and the qualities, while what is above is closed
MARGIN, WIDTH, HEIGHT = 7, 258, 620  # of a side bar in the picture, without its tabs
GAP = 12
RUN_SHARE = 0.62  # of the run that is shown as under way: its picture is one of the training by then
RUN_MAY_TAKE = 2400.0  # seconds to get there; a minute or two on an idle machine
READ_MAY_TAKE = 120.0


def side_bar(desktop: Desktop, name: str) -> Image.Image:
    desktop.leave()
    x, y, _, _ = desktop.state()["places"]["VIEW_3D UI"]
    return desktop.cut(name, (x + MARGIN, y, x + MARGIN + WIDTH, y + HEIGHT))


def test_the_panel_is_drawn(installed: Desktop, finished_run: str, pictures: Path):
    desktop, capture = installed, installed.share / "showroom"
    shutil.rmtree(capture, ignore_errors=True)
    shutil.copytree(SHOWROOM, capture)
    desktop.quit()
    desktop.start(python=sys.executable, sidebar=True)
    toggle(desktop, VIEWER)
    desktop.ask("bpy.context.scene.cvdgs.capture.folder = '/share/showroom'")
    desktop.wait(lambda state: state["scene"]["views"] > 0, READ_MAY_TAKE)
    bars = [side_bar(desktop, "side-bar-capture")]

    desktop.ask("bpy.context.scene.cvdgs.run.quality = 'DRAFT'")  # which shows the same, sooner
    toggle(desktop, CAPTURE)
    press_until(desktop, MAKE_BUTTON, lambda state: "run" in state["jobs"])
    desktop.wait(lambda state: state["jobs"]["run"]["fraction"] >= RUN_SHARE, RUN_MAY_TAKE)
    bars.append(side_bar(desktop, "side-bar-run"))
    desktop.ask("bpy.ops.cvdgs.cancel_job()")
    desktop.wait(lambda state: state["jobs"]["run"]["state"] == "cancelled", READ_MAY_TAKE)

    desktop.quit()
    desktop.start(python=sys.executable, sidebar=True)
    toggle(desktop, VIEWER, CAPTURE)
    desktop.ask(f"bpy.ops.cvdgs.load_run(directory={finished_run!r})")
    desktop.wait(lambda state: "finished Gaussians" in state["objects"], READ_MAY_TAKE)
    desktop.ask("bpy.data.objects.remove(bpy.data.objects['Cube'])")
    desktop.settle()
    toggle(desktop, MAKE_HEADER, DISPLAY_HEADER, REPORT_HEADER)
    bars.append(side_bar(desktop, "side-bar-report"))

    gap = SCALE * GAP
    panels = Image.new("RGB", (sum(bar.width + gap for bar in bars) - gap, bars[0].height), "white")
    for number, bar in enumerate(bars):
        panels.paste(bar, (number * (bar.width + gap), 0))
    save_smaller(panels, pictures / "panel.png")
