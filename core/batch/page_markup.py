"""The index page of a batch as one HTML file, from ``page.html``. For the worker: it needs Jinja2.

Nothing is fetched from anywhere, so it opens from a disk.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

from ..files.pages import embed, write_page
from ..files.untrusted import replacing
from ..rendering.requests import PageArguments, seen_by, vision
from ..runs.layout import VIEWER_PAGE, picture_name
from ..runs.report import SCORED_PICTURES, report_or_nothing
from .page import shown_turntables
from .previews import Preview, PreviewFiles, preview_files

_TEMPLATE = Path(__file__).with_name("page.html")
# Of videos within the page; beyond that, browsers take long to open it, and videos are played from their files.
MOST_EMBEDDED_BYTES = 96 << 20


@dataclass(frozen=True)
class _Turn:
    """A turntable on the page.

    Attributes:
        name: among those of its item.
        files: of the preview; None where frames are missing.
        size: width and height of a frame.
        report: figures of the layer in the run's report; empty where there are none.
        links: text and path of files, from the batch's folder.
    """

    name: str
    preview: Preview
    files: PreviewFiles | None
    size: tuple[int, int]
    report: Mapping[str, Any]
    links: list[tuple[str, str]]

    @property
    def vision(self) -> str:
        return vision(self.preview.observer)

    @property
    def captions(self) -> list[str]:
        """What each part of the preview shows, row by row."""
        if not self.preview.observer:
            return ["Original"]
        columns = ["Original", "Enhanced"][-len(self.preview.columns) :]
        return columns + [seen_by(column, self.preview.observer) for column in columns]


@dataclass(frozen=True)
class _Item:
    """An item on the page.

    Attributes:
        viewer: from the batch's folder, the page of its run that shows the scene; "" where there is none.
    """

    name: str
    turns: list[_Turn]
    lead: list[str]
    viewer: str

    @property
    def is_complete(self) -> bool:
        return all(turn.files is not None for turn in self.turns)


class _Videos:
    """What plays a video: its bytes, or the file where the page would become too large."""

    def __init__(self, out: Path, most_bytes: int) -> None:
        self._out, self._left = out, most_bytes
        self.linked = 0

    def source(self, video: Path) -> str:
        size = video.stat().st_size
        if size > self._left:
            self.linked += 1
            return quote(video.relative_to(self._out).as_posix())
        self._left -= size
        return embed(video, "video/mp4")


def write_batch_page(arguments: PageArguments, out: Path, most_embedded: int = MOST_EMBEDDED_BYTES) -> None:
    """Write the page into the batch's folder `out`, from the previews that are there.

    Raises:
        OSError: it cannot be written.
    """
    items = [_shown_item(item, out) for item in arguments.items]
    with replacing(out / arguments.file) as temporary:
        write_page(
            temporary,
            _TEMPLATE,
            title=arguments.title,
            items=items,
            turntables=sum(len(item.turns) for item in items),
            incomplete=[item.name for item in items if not item.is_complete],
            kinds=SCORED_PICTURES,
            videos=_Videos(out, most_embedded),
        )


def _shown_item(item: Mapping[str, Any], out: Path) -> _Item:
    report = report_or_nothing(out / item["run"])
    shown = list(shown_turntables(item, out))
    has_one_view = len({(turn["engine"], turn["camera"]) for turn, _ in shown}) == 1
    turns = []
    for turn, preview in shown:
        name = turn["layer"] if has_one_view else f"{turn['layer']}, {turn['engine']}, {turn['camera']}"
        files = preview_files(preview, out)
        size = _size(out / preview.columns[0] / picture_name(1)) if files is not None else (4, 3)
        figures = (report.get("layers") or {}).get(turn["layer"]) or {}
        turns.append(_Turn(name, preview, files, size, figures, list(_links(turn, item["sheet"], out))))
    return _Item(item["name"], turns, list(_lead(report)), _viewer(out / item["run"], out))


def _viewer(run: Path, out: Path) -> str:
    page = run / VIEWER_PAGE
    if not page.is_file():
        return ""
    try:
        return quote(Path(os.path.relpath(page, out)).as_posix())
    except ValueError:  # on another drive
        return page.resolve().as_uri()


def _lead(report: Mapping[str, Any]) -> Iterator[str]:
    quality, views = report.get("reconstruction") or {}, report.get("capture") or {}
    if isinstance(report.get("gaussians"), int):
        yield f"{report['gaussians']:,} Gaussians"
    if views.get("views"):
        yield f"{views['views']} photographs"
    if quality.get("psnr") is not None:
        yield f"{quality['psnr']:.2f} dB on {'held-out' if views.get('test', 1) else 'training'} views"


def _links(turn: Mapping[str, Any], sheet: str | None, out: Path) -> Iterator[tuple[str, str]]:
    """Text and path of the files of a turntable that are there."""
    paths = [("video", turn["video"])]
    paths += [(f"beside what {vision(observer)} sees", path) for observer, path in turn["side_by_side"].items()]
    paths += [("frames", turn["folder"]), ("contact sheet", sheet)]
    return ((text, path) for text, path in paths if path and (out / path).exists())


def _size(picture: Path) -> tuple[int, int]:
    """Width and height of a PNG file (ISO/IEC 15948, section 11.2.1)."""
    with open(picture, "rb") as file:
        header = file.read(24)
    return int.from_bytes(header[16:20], "big"), int.from_bytes(header[20:24], "big")
