"""Runs the training loop of a prototype on a capture, so that a benchmark can hold ours against it.

The prototype is a first version of the trainer that is not part of the repository; benchmarks leave it out where it is
missing. It reads one prepared folder; its loop renders, takes a fused L1 + SSIM loss, goes backward and steps Adam,
without densification.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...capture import Capture
from ...images import write_png

_SCRIPT = "train_loop.py"
_RESULT = re.compile(r"^it .*median ms.* TOTAL ([0-9.]+)$", re.MULTILINE)
_MEASURED = re.compile(r"^EVAL step .* train_s ([0-9.]+) .* psnr ([0-9.]+) ", re.MULTILINE)
_NEVER = "ev=1000000000"  # its option for "measure held-out views at step"


class PrototypeLoop:
    """The prototype on one capture.

    Args:
        folder: where its scripts are.
        capture: photographs of one size and lens. The prototype assumes square pixels and a centred principal point, so
            it gets them without the few rows and columns that are too many on one side.
        scratch: an empty folder for its input and its build.
    """

    def __init__(self, folder: Path, capture: Capture, scratch: Path) -> None:
        self._folder = folder.resolve()
        self._scratch = scratch
        self._prepare(capture)

    @staticmethod
    def is_there(folder: Path) -> bool:
        """Whether `folder` holds the prototype."""
        return (folder / _SCRIPT).is_file()

    def step_milliseconds(self, steps: int, threads: int) -> float:
        """Median wall time of a whole training step over the last hundred of `steps`."""
        found = _RESULT.findall(self._run(steps, threads, _NEVER))
        return float(_only_if(found)[-1])

    def curve(self, steps: int, every: int, threads: int) -> list[tuple[float, float]]:
        """(seconds of training, held-out PSNR in dB) after every so many of `steps`; measuring is not counted."""
        measured = ",".join(str(step) for step in range(every, steps + 1, every))
        found = _MEASURED.findall(self._run(steps, threads, f"ev={measured}"))
        return [(float(seconds), float(psnr)) for seconds, psnr in _only_if(found)]

    def _run(self, steps: int, threads: int, measured: str) -> str:
        """What the prototype prints."""
        environment = {
            **os.environ,
            "WP_CACHE": str(self._scratch / "cache"),
            "TORCH_EXTENSIONS_DIR": str(self._scratch / "build"),
            "OMP_WAIT_POLICY": "passive",
        }
        command = [sys.executable, str(self._folder / _SCRIPT), "A3", str(steps), "fused", f"th={threads}", measured]
        result = subprocess.run(command, cwd=self._scratch, env=environment, capture_output=True, text=True)
        if result.returncode != 0:
            raise RuntimeError(f"the prototype failed: {result.stderr.strip().splitlines()[-1:]}")
        return result.stdout

    def _prepare(self, capture: Capture) -> None:
        """Write the folder that the prototype reads from its working directory."""
        place = self._scratch / "fox270"
        for name in ("out", "cache", "build"):
            (self._scratch / name).mkdir(parents=True, exist_ok=True)
        first = capture.views[0].camera
        rows, columns = centred(first.cy, first.height), centred(first.cx, first.width)
        for view in capture.views:
            write_png(place / "images" / f"{view.key}.png", np.ascontiguousarray(view.image[rows, columns]))
        np.savez(
            place / "np.npz",
            W=columns.stop - columns.start,
            H=rows.stop - rows.start,
            f=first.fx,
            names=np.array([f"{view.key}.jpg" for view in capture.views]),
            qt=np.stack([_quaternion_and_translation(view.world_to_camera) for view in capture.views]),
            xyz=capture.points.astype(np.float64),
            rgb=capture.point_colors,
        )


def _only_if(found: list[Any]) -> list[Any]:
    """`found`, if anything was."""
    if not found:
        raise RuntimeError("the prototype printed no figures")
    return found


def centred(principal: float, size: int) -> slice:
    """The pixels along one axis that have the principal point in their middle, to half a pixel."""
    surplus = round(2.0 * principal - size)
    return slice(max(surplus, 0), size + min(surplus, 0))


def _quaternion_and_translation(pose: NDArray[np.float64]) -> NDArray[np.float64]:
    """(7,) wxyz and xyz of a (4, 4) rigid transform."""
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(pose[:3, :3]).as_quat()
    return np.array([w, x, y, z, *pose[:3, 3]])
