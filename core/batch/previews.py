"""Small videos for the page of a batch: original and enhanced, as everybody and as the observer sees them, in one.

    original | enhanced
    ---------+---------      the lower row only where there is an observer
    original | enhanced

One video plays them all at the same pace and is cropped by the page to what is looked at. Previews are kept under names
made of what they show, so that a page that is made again does not make them again. Standard library only.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Self

from ..rendering.frames import make_pictures
from ..runs.layout import picture_name
from ..runtime.supervisor import Listener
from .task import BATCH_FOLDER

PREVIEWS_FOLDER = f"{BATCH_FOLDER}/previews"
PREVIEW_WIDTH = 480  # pixels of each picture in a preview, at most
_FORMAT = 1


@dataclass(frozen=True)
class Preview:
    """A preview.

    Attributes:
        columns: folders of the sequences, from left to right.
        frames: pictures of each.
        frames_per_second: of the video.
        observer: layer name of those for whom the lower row is; "" for none.
        model: of the observer's simulation.
    """

    columns: tuple[str, ...]
    frames: int
    frames_per_second: int
    observer: str
    model: str

    @property
    def rows(self) -> int:
        return 2 if self.observer else 1

    def to_dict(self) -> dict[str, Any]:
        """A JSON-ready dictionary; `from_dict` reads it back."""
        return asdict(self)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
        """The preview of `to_dict`."""
        return cls(**{**values, "columns": tuple(values["columns"])})

    def pictures(self, out: Path) -> list[Path]:
        """All that it shows, in the batch's folder `out`."""
        numbers = range(1, self.frames + 1)
        return [out / folder / picture_name(number) for folder in self.columns for number in numbers]


@dataclass(frozen=True)
class PreviewFiles:
    """Where a preview is kept: the MP4, and its first picture as JPEG."""

    video: Path
    poster: Path

    @property
    def are_there(self) -> bool:
        return self.video.is_file() and self.poster.is_file()


def preview_files(preview: Preview, out: Path) -> PreviewFiles | None:
    """Where `preview` is kept in the batch's folder `out`, or will be; None where a picture is missing."""
    told = hashlib.sha256(json.dumps([_FORMAT, PREVIEW_WIDTH, preview.to_dict()]).encode())
    for path in preview.pictures(out):
        try:
            status = path.stat()
        except OSError:
            return None
        told.update(f"{status.st_size} {status.st_mtime_ns}\n".encode())
    stem = out / PREVIEWS_FOLDER / told.hexdigest()[:32]
    return PreviewFiles(stem.with_suffix(".mp4"), stem.with_suffix(".jpg"))


def make_previews(previews: Sequence[Preview], out: Path, listen: Listener) -> dict[Preview, PreviewFiles]:
    """Make those that are not there, in one process of Blender; forget those that nothing shows any more.

    Returns:
        The files of each whose pictures are all there.

    Raises:
        InputError, WorkerDefect, Cancelled: as for `make_pictures`.
    """
    kept = {preview: files for preview in previews if (files := preview_files(preview, out)) is not None}
    missing = [
        {**preview.to_dict(), "video": str(files.video.relative_to(out)), "poster": str(files.poster.relative_to(out))}
        for preview, files in kept.items()
        if not files.are_there
    ]
    if missing:
        make_pictures("previews", {"previews": missing, "width": PREVIEW_WIDTH}, out, listen)
    shown = {path for files in kept.values() for path in (files.video, files.poster)}
    for path in (out / PREVIEWS_FOLDER).glob("*"):
        if path not in shown:
            path.unlink(missing_ok=True)
    return kept
