"""Programs that take the place of the worker's Python in a run on the console, and the run's process."""

from __future__ import annotations

import os
import subprocess
import sys
import textwrap
from pathlib import Path

from cvdgs.core.bootstrap import ROOT

REPORT = {
    "schema": "cvdgs-report-1", "versions": {"cvdgs": "0"}, "device": "cpu", "settings": {"capture": "photos"},
    "capture": {"format": "colmap", "views": 9, "train": 7, "test": 2, "width": 64, "height": 48, "points": 5},
    "gaussians": 5, "sh_degree": 0, "seconds": {"capture": 1.0, "blender": None, "total": None}, "peak_memory_mb": 1,
    "reconstruction": {"psnr": None, "ssim": 0.5}, "layers": {}, "views_shown": [], "notes": {}, "warnings": [],
    "curve": [],
}  # fmt: skip

_PROLOGUE = f"""#!{sys.executable}
import json, os, signal, sys, time
REPORT = {REPORT!r}
request = json.loads(sys.stdin.readline())
folder = request['folder']
def emit(event, **fields): print(json.dumps({{'event': event, **fields}}), flush=True)
"""


def start_run(
    program: Path, body: str, *options: str, out: Path, capture: str | Path = "photos"
) -> subprocess.Popen[str]:
    """Start run.py with a worker that does what `body` says; its program is written to `program`."""
    program.write_text(_PROLOGUE + textwrap.dedent(body))
    program.chmod(0o755)
    script = str(ROOT / "scripts" / "run.py")
    return subprocess.Popen(
        [sys.executable, script, str(capture), "--out", str(out), "--no-blend", *options],
        env={**os.environ, "CVDGS_PYTHON": str(program)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
