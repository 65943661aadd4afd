"""Makes the small videos of a batch's page (see ``core/batch/previews.py``)."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ...core.batch.previews import Preview
from ...core.color.srgb import simulate_bytes
from ...core.files.untrusted import partial_file
from ...core.runs.layout import picture_name
from ...core.runtime.protocol import Reporter, StageSpan
from .pixels import Observer, Pixels, downscale, read_picture, write_picture
from .video import STAGE, Column, Quality, encode

_COMPOSING = 0.7  # of the time; the rest is encoding


def make_previews(arguments: Mapping[str, Any], out: Path, *, reporter: Reporter) -> dict[str, Any]:
    """Make the previews; replaces the file that is open.

    Args:
        arguments: ``previews``: each as `Preview.to_dict`, with the paths ``video`` and ``poster``; ``width``.

    Raises:
        InputError: a picture is missing.
        OSError: a preview cannot be written.
        RuntimeError: Blender could not write it.
    """
    wanted = arguments["previews"]
    for index, values in enumerate(wanted):
        files = {name: out / values[name] for name in ("video", "poster")}
        preview = Preview.from_dict({name: value for name, value in values.items() if name not in files})
        message = f"preview {index + 1} of {len(wanted)}"
        span = StageSpan(reporter, STAGE, index / len(wanted), (index + 1) / len(wanted), message)
        _make(preview, out, int(arguments["width"]), files["video"], files["poster"], span)
    return {"previews": len(wanted)}


def half_made(arguments: Mapping[str, Any], out: Path) -> list[Path]:
    """What a job that was cut short may have left."""
    previews = arguments["previews"]
    return [partial_file(out / values[kind]) for kind in ("video", "poster") for values in previews]


def _make(preview: Preview, out: Path, width: int, video: Path, poster: Path, reporter: Reporter) -> None:
    observer = Observer.from_name(preview.observer, preview.model) if preview.observer else None
    with tempfile.TemporaryDirectory() as folder:
        paths = []
        for number in range(1, preview.frames + 1):
            reporter.progress(STAGE, _COMPOSING * (number - 1) / preview.frames)
            columns = [read_picture(out / column / picture_name(number)) for column in preview.columns]
            # BMP, because nothing is saved by compressing what is read once.
            paths.append(Path(folder) / f"{number:04d}.bmp")
            write_picture(paths[-1], _composed(columns, width, observer))
        encoding = StageSpan(reporter, STAGE, _COMPOSING, 1.0, "")
        encode([Column(paths)], preview.frames_per_second, video, Quality.SMALL, encoding)
        write_picture(poster, read_picture(paths[0]))


def _composed(columns: list[Pixels], width: int, observer: Observer | None) -> Pixels:
    """The pictures side by side, and below them what the observer sees; all of the same, even size."""
    small = [downscale(picture, width) for picture in columns]
    height, width = (min(picture.shape[axis] for picture in small) // 2 * 2 for axis in (0, 1))
    row = np.hstack([picture[:height, :width] for picture in small])
    if observer is None:
        return row
    return np.vstack([row, simulate_bytes(row, observer.cvd, observer.severity, observer.model)])
