"""Renders showrooms for comparisons by scripts/make_showroom.py in a process of its own: `core` knows no Blender."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from ...bootstrap import ROOT
from ...errors import InputError
from ...events import Reporter

STAGE = "scenes"
_SCRIPT = ROOT / "scripts" / "make_showroom.py"
_CAMERAS = "transforms.json"  # is written last, so a showroom that has it is whole
_PROGRESS = re.compile(r"photographs: +(\d+) %")


def render_showroom(
    folder: Path, arguments: Sequence[str], reporter: Reporter, *, done: float = 0.0, share: float = 1.0
) -> Path:
    """The showroom that make_showroom.py makes of `arguments`, in `folder`; one that is there is not made again.

    Args:
        folder: of the capture; its name has to stand for the arguments.
        arguments: of the script, without ``--out``.
        done, share: of all that the caller renders in this stage; progress goes from the one to the sum.

    Raises:
        InputError: it could not be made, for lack of the bpy wheel above all.
    """
    if (folder / _CAMERAS).is_file():
        return folder
    reporter.status(STAGE, f"rendering {folder.name}")
    command = [sys.executable, str(_SCRIPT), "--out", str(folder), *arguments]
    # Errors go where the output goes, so that no pipe fills up unread.
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
        assert process.stdout is not None
        last = ""
        for line in process.stdout:
            last = line.strip() or last
            found = _PROGRESS.match(line)
            if found:
                reporter.progress(STAGE, done + share * int(found[1]) / 100.0, f"rendering {folder.name}")
    if process.returncode:
        raise InputError(
            f"the showroom could not be rendered ({last})",
            where=folder,
            remedy="install the bpy wheel (pip install '.[blender]'), or leave the axes out that need it",
        )
    return folder
