"""Programs that take the place of the worker's Python and behave, or misbehave, in known ways."""

from __future__ import annotations

import json
import sys
import textwrap
from pathlib import Path
from typing import Any

_PROLOGUE = """
import json, os, shutil, signal, sys, time
request = json.loads(sys.stdin.readline())
def emit(event, **fields): print(json.dumps({"event": event, **fields}), flush=True)
def stop(*_): raise SystemExit(130)
signal.signal(signal.SIGINT, stop)
"""

SUMMARY: dict[str, Any] = {
    "source": "photos",
    "format": "colmap",
    "views": 24,
    "sizes": [[480, 360, 24]],
    "points": 5000,
    "warnings": [{"name": "few-views", "message": "not many views"}],
    "videos": 0,
    "seconds": 0.0,
}

VIDEO = {"format": "sfm", "views": 0, "videos": 1, "seconds": 18.7, "points": 0}
"""What differs for a video."""

REPORT: dict[str, Any] = {
    "schema": "cvdgs-report-1", "versions": {"cvdgs": "0"}, "device": "cpu", "settings": {"capture": "photos"},
    "capture": {"format": "colmap", "views": 24, "train": 21, "test": 3, "width": 480, "height": 360, "points": 5000},
    "gaussians": 400, "sh_degree": 0, "seconds": {"capture": 1.0, "blender": None, "total": None}, "peak_memory_mb": 1,
    "reconstruction": {"psnr": 31.4, "ssim": 0.9}, "views_shown": [], "notes": {}, "warnings": [], "curve": [],
    "decision": {},
    "layers": {
        "deutan-1.0": {
            "ccpr": {"tau": 6, "input": 0.6, "enhanced": 0.9, "unenhanced": 0.5, "rendered": 0.8},
            "ccpr_mean": {"input": 0.6, "enhanced": 0.9, "unenhanced": 0.5, "rendered": 0.8},
            "ssim_simulated": {"input": 0.6, "enhanced": 0.9, "unenhanced": 0.5, "rendered": 0.8},
            "naturalness": {"ssim": 0.9, "psnr": None, "delta_e": 4.2},
            "rwe": {"ratio": 0.9, "enhanced_ratio": 1.2, "absolute": None, "long_range_ratio": None, "pairs": 3},
            "psnr_to_enhanced": 30.0,
        }
    },
}  # fmt: skip
"""With one layer; the second one of a test goes in with `report_with`."""


def report_with(*layers: str) -> dict[str, Any]:
    """A report that has these layers, made in this order."""
    return {**REPORT, "layers": dict.fromkeys(layers, REPORT["layers"]["deutan-1.0"])}


def interpreter(folder: Path, *bodies: str) -> str:
    """A program in `folder` that reads its request, defines ``emit`` and ``request``, and does `bodies`; its path."""
    program, written = folder / "python", folder / "python.new"
    written.write_text(f"#!{sys.executable}\n{_PROLOGUE}" + "\n".join(map(textwrap.dedent, bodies)))
    written.chmod(0o755)
    written.replace(program)  # one that is just starting cannot be written to
    return str(program)


def finishing(run: Path, report: dict[str, Any] = REPORT) -> str:
    """Body of a worker whose run leaves the files of the folder `run`, and that has nothing to say of its page."""
    return f"""
        if request["job"] == "report-page":
            emit("result")
            raise SystemExit
        emit("status", stage="start", message="loading")
        emit("progress", stage="geometry", fraction=0.5, seconds_left=3.0, message="12 Gaussians")
        shutil.copytree({str(run)!r}, request["folder"], dirs_exist_ok=True)
        emit("warning", name="few-views", message="24 views only")
        emit("result", report=json.loads({json.dumps(report)!r}))
        """


SLEEPING = """
    emit("status", stage="start", message="loading")
    time.sleep(60)
    """
CRASHING = """
    emit("status", stage="geometry", message="fitting")
    os.kill(os.getpid(), signal.SIGSEGV)
    """
REFUSING = """
    emit("error", kind="input", message="photos: no cameras - leave out --cameras given to estimate them")
    raise SystemExit(2)
    """
INSPECTING = f"""
    folder = request["thumbnails"]["folder"]
    emit("result", summary=json.loads({json.dumps(SUMMARY)!r}), thumbnails=[folder + "/0.png"])
    """
INSPECTING_A_VIDEO = f"""
    folder = request["thumbnails"]["folder"]
    emit("result", summary=json.loads({json.dumps(SUMMARY | VIDEO)!r}), thumbnails=[folder + "/0.png"])
    """
