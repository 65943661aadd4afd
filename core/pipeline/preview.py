"""Pictures of a running job, for a front end to show."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from ..files.images import write_png
from ..files.untrusted import replacing
from ..runtime.protocol import Reporter
from ..splats.gaussians import Gaussians
from ..splats.renderer import SceneRenderer

_INTERVAL = 2.0  # seconds between two pictures of a training; one takes some 30 ms


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

    def show(self, gaussians: Gaussians) -> None:
        """Show Gaussians in world units."""
        with replacing(self._file) as temporary:
            write_png(temporary, self._scene.color(gaussians, self._view))
        self._reporter.preview(self._file)

    def remove(self) -> None:
        """Delete the picture."""
        self._file.unlink(missing_ok=True)


class PreviewedTraining(Reporter):
    """Passes on what a training reports, and shows a picture now and then.

    Args:
        inner: receives the training's progress.
        preview: shows the picture.
        gaussians: as they are now, in world units.
    """

    def __init__(self, inner: Reporter, preview: Preview, gaussians: Callable[[], Gaussians]) -> None:
        self._inner, self._preview, self._gaussians = inner, preview, gaussians
        self._last = -_INTERVAL

    def status(self, stage: str, message: str) -> None:
        self._inner.status(stage, message)

    def progress(self, stage: str, fraction: float, message: str = "") -> None:
        self._inner.progress(stage, fraction, message)
        if time.monotonic() - self._last >= _INTERVAL:
            self._preview.show(self._gaussians())
            self._last = time.monotonic()

    def warning(self, name: str, message: str) -> None:
        self._inner.warning(name, message)
