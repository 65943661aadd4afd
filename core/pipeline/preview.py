"""Pictures of a running job, for a front end to show."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..files.images import write_png
from ..files.untrusted import replacing
from ..runtime.protocol import Reporter
from ..splats.gaussians import Gaussians
from ..splats.renderer import SceneRenderer
from ..splats.training.initialise import InitialGaussians

_INTERVAL = 2.0  # seconds between two pictures of a training; one takes some 30 ms
_DOTS = InitialGaussians(opacity=0.95, neighbours=3)  # of sparse points, half as large: they hide each other less
_LARGEST = 3.0  # times the median size of these; far from all others they would cover the picture


class Preview:
    """One view of the capture, as the run has it so far.

    Args:
        scene: renders it.
        view: index of the view.
        folder: where the picture is kept until `remove`.
        reporter: told of every new picture.
    """

    def __init__(self, scene: SceneRenderer, view: int, folder: Path, reporter: Reporter) -> None:
        self._scene, self._view, self._reporter = scene, view, reporter
        self._file = folder / ".preview.png"

    def of(self, scene: SceneRenderer) -> Preview:
        """The same of a scene with other cameras."""
        return Preview(scene, self._view, self._file.parent, self._reporter)

    def show_points(self, points: NDArray[np.float32], colors: NDArray[np.uint8]) -> None:
        """Show (P, 3) sparse points in world units, in (P, 3) sRGB colours: what is known before any training."""
        if len(points):
            dots = _DOTS.isotropic(points, colors.astype(np.float32) / 255.0)
            most = np.median(dots.log_scales) + np.log(_LARGEST)
            self.show(replace(dots, log_scales=np.minimum(dots.log_scales, most) - np.float32(np.log(2.0))))

    def show(self, gaussians: Gaussians) -> None:
        """Show Gaussians in world units."""
        with replacing(self._file) as temporary:
            write_png(temporary, self._scene.color(gaussians, self._view))
        self._reporter.preview(self._file)

    def remove(self) -> None:
        """Delete the picture."""
        self._file.unlink(missing_ok=True)


class PreviewedTraining(Reporter):
    """Passes on what a training reports, and shows a picture now and then of the scene that it says it fits.

    Args:
        inner: receives the training's progress.
        preview: shows the picture.
    """

    def __init__(self, inner: Reporter, preview: Preview) -> None:
        self._inner, self._preview = inner, preview
        self._gaussians: Callable[[], Gaussians] | None = None
        self._last = -_INTERVAL

    def scene(self, gaussians: Callable[[], Gaussians]) -> None:
        self._gaussians = gaussians

    def status(self, stage: str, message: str) -> None:
        self._inner.status(stage, message)

    def progress(self, stage: str, fraction: float, message: str = "") -> None:
        self._inner.progress(stage, fraction, message)
        if self._gaussians is not None and time.monotonic() - self._last >= _INTERVAL:
            self._preview.show(self._gaussians())
            self._last = time.monotonic()

    def warning(self, name: str, message: str) -> None:
        self._inner.warning(name, message)
