"""A finished run as it lies in its folder: cameras, Gaussians and colour layers, read and checked. numpy only."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...core.capture.folder import CaptureView, read_capture_folder
from ...core.errors import InputError
from ...core.runs.layout import CAPTURE_FOLDER, GAUSSIANS_FILE, files_by_layer, layer_gaussians_file
from ...core.splats.gaussians import Gaussians
from ...core.splats.io.ply import read_floaters, read_ply

PARTIAL_FOLDER = ".blender.partial"
"""Where the conversion makes its files before it moves them into place; to be deleted whenever nothing runs."""

RUN_PROPERTY = "cvdgs_run"
"""Custom property of a Gaussians' object: the folder of the run that it came from, as Blender's fields have folders."""

_RUN_AGAIN = "choose the output folder of a finished run"


@dataclass(frozen=True)
class FinishedRun:
    """What a run folder holds for Blender.

    Attributes:
        folder: the run folder.
        views: at least one, in file order.
        gaussians: geometry and original colours.
        layers: (N, 3) colours by layer name.
        background: sRGB that the Gaussians were trained over: black, or white for cut-outs.
        up: (3,) unit vector, or None where the run does not say what is up.
        metres_per_unit: of the run's world, or None where nobody has measured it.
        floaters: (N,) how likely each Gaussian is a floater, 0 to 1, or None where the run does not say.
    """

    folder: Path
    views: tuple[CaptureView, ...]
    gaussians: Gaussians
    layers: Mapping[str, NDArray[np.float32]]
    background: tuple[float, float, float]
    up: NDArray[np.float64] | None = None
    metres_per_unit: float | None = None
    floaters: NDArray[np.float32] | None = None

    @property
    def name(self) -> str:
        """What objects of the run are called after: its folder."""
        return self.folder.resolve().name or "Run"

    def view(self, key: str) -> CaptureView:
        """The view called `key`.

        Raises:
            InputError: there is none.
        """
        for view in self.views:
            if view.key == key:
                return view
        names = ", ".join(view.key for view in self.views[:3])
        raise InputError(f"no view is called '{key}'", where=self.folder, remedy=f"choose one of {names}, ...")


def read_run(folder: str | Path) -> FinishedRun:
    """Read the run in `folder`.

    Raises:
        InputError: a file is missing or damaged, or a layer does not belong to these Gaussians.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError("no such folder", where=folder, remedy=_RUN_AGAIN)
    of_layers = files_by_layer(folder, layer_gaussians_file)
    splats = sorted(set(folder.glob("*.ply")) - set(of_layers.values()))
    if len(splats) > 1 and not (folder / GAUSSIANS_FILE).is_file():
        what = f"{len(splats)} splat files ({splats[0].name}, ...), no run: sequences of splats cannot be shown"
        raise InputError(what, where=folder, remedy=_RUN_AGAIN)
    capture = read_capture_folder(folder / CAPTURE_FOLDER)
    gaussians = read_ply(_existing(folder / GAUSSIANS_FILE))
    if not len(gaussians):
        raise InputError("it holds no Gaussians", where=folder / GAUSSIANS_FILE, remedy=_RUN_AGAIN)
    layers = {}
    for name, path in of_layers.items():
        layer = read_ply(path)
        if len(layer) != len(gaussians):
            raise InputError(
                f"{len(layer)} Gaussians, but {GAUSSIANS_FILE} has {len(gaussians)}", where=path, remedy=_RUN_AGAIN
            )
        layers[name] = layer.base_colors
    background = (1.0, 1.0, 1.0) if capture.is_cut_out else (0.0, 0.0, 0.0)
    floaters = read_floaters(folder / GAUSSIANS_FILE)
    return FinishedRun(
        folder, capture.views, gaussians, layers, background, capture.up, capture.metres_per_unit, floaters
    )


def _existing(path: Path) -> Path:
    if not path.is_file():
        raise InputError("no such file", where=path, remedy=_RUN_AGAIN)
    return path
