"""How close Blender's stills come to the rasteriser's images, for both ways of showing the colours."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

from ..color.metrics import psnr
from ..color.spaces import image_to_tensor
from ..errors import InputError
from ..images import read_png
from ..job import blender_command
from ..run_files import ORIGINAL, RENDERS_FOLDER, STILLS_FOLDER

DISPLAYS = ("photo", "scene-linear")


def display_fidelity(run: Path, view: str, scratch: Path) -> dict[str, float]:
    """PSNR in dB of a Cycles still against ``renders/original/<view>.png``, by display.

    Args:
        run: output folder of a finished run; left as it is.
        view: key of a held-out view.
        scratch: an empty folder for copies of the run.

    Raises:
        InputError: the run has no render of that view, or Blender could not show it.
    """
    reference = run / RENDERS_FOLDER / ORIGINAL / f"{view}.png"
    if not reference.is_file():
        raise InputError("no such render", where=reference, remedy="name the folder of a run and a held-out view")
    expected = image_to_tensor(read_png(reference))
    return {
        display: psnr(expected, image_to_tensor(read_png(_still(run, view, display, scratch)))) for display in DISPLAYS
    }


def _still(run: Path, view: str, display: str, scratch: Path) -> Path:
    copy = scratch / display
    shutil.copytree(run, copy)
    command = blender_command([str(copy), "--view", view, "--display", display])
    if subprocess.run(command, capture_output=True).returncode:
        raise InputError("Blender could not render it", where=run, remedy="try scripts/run.py on the capture again")
    return copy / STILLS_FOLDER / f"{ORIGINAL}.png"
