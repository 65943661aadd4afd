"""The page of a whole batch: one file with the turntables playing, layers and observers to switch, and the figures.

Nothing is fetched from anywhere, so it opens from a disk. Standard library only; `page_html` writes the markup.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from ..files.untrusted import replacing
from ..rendering.frames import simulation_model
from ..rendering.requests import PageArguments, vision
from ..runs.layout import ORIGINAL, picture_name
from ..runs.report import report_or_nothing
from ..runtime.supervisor import Listener
from .page_html import ShownItem, ShownPage, ShownTurn, page_text
from .previews import Preview, PreviewFiles, make_previews
from .task import Task

# Of videos within the page; beyond that, browsers take long to open it, and videos are played from their files.
MOST_EMBEDDED_BYTES = 96 << 20


def run(task: Task, out: Path, listen: Listener) -> None:
    """Make the page of what is there; what is not is said to be missing.

    Raises:
        InputError: the page cannot be written.
        WorkerDefect: Blender failed to make the videos.
        Cancelled: nothing half-written is left.
    """
    arguments = PageArguments.from_dict(task.arguments)
    previews = {preview for item in arguments.items for _, preview in _turns(item, out)}
    files = make_previews(sorted(previews, key=lambda preview: preview.columns), out, listen)
    listen({"event": "status", "stage": "page", "message": f"writing {arguments.file}"})
    items = tuple(_shown_item(item, out, files) for item in arguments.items)
    page = ShownPage(arguments.title, items, out, MOST_EMBEDDED_BYTES)
    with replacing(out / arguments.file) as temporary, open(temporary, "w", encoding="utf-8") as file:
        file.writelines(page_text(page))


def _turns(item: Mapping[str, Any], out: Path) -> Iterator[tuple[Mapping[str, Any], Preview]]:
    """The turntables of an item that the page shows, each with its preview.

    A layer stands beside the original colours of the same camera and engine; those are shown alone where there is no
    layer.
    """
    turntables = item["turntables"]
    originals = {_view(turn): turn for turn in turntables if turn["layer"] == ORIGINAL}
    has_layers = any(turn["layer"] != ORIGINAL for turn in turntables)
    model = simulation_model(out / item["run"])
    for turn in turntables:
        observer = "" if turn["layer"] == ORIGINAL else turn["layer"]
        if not observer and has_layers:
            continue
        original = originals.get(_view(turn)) if observer else None
        columns = tuple(shown["folder"] for shown in (original, turn) if shown is not None)
        yield turn, Preview(columns, int(turn["frames"]), int(turn["frames_per_second"]), observer, model)


def _view(turn: Mapping[str, Any]) -> tuple[str, str]:
    return turn["engine"], turn["camera"]


def _shown_item(item: Mapping[str, Any], out: Path, files: Mapping[Preview, PreviewFiles]) -> ShownItem:
    report = report_or_nothing(out / item["run"])
    pairs = list(_turns(item, out))
    views = {_view(turn) for turn, _ in pairs}
    turns = []
    for turn, preview in pairs:
        name = turn["layer"] if len(views) == 1 else f"{turn['layer']}, {turn['engine']}, {turn['camera']}"
        kept = files.get(preview)
        turns.append(
            ShownTurn(
                name=name,
                preview=preview,
                files=kept,
                size=_size(out / preview.columns[0] / picture_name(1)) if kept is not None else (4, 3),
                report=(report.get("layers") or {}).get(turn["layer"]) or {},
                links=tuple(_links(turn, out)),
            )
        )
    sheet = item["sheet"] if item["sheet"] and (out / item["sheet"]).is_file() else None
    return ShownItem(item["name"], tuple(turns), report, sheet)


def _links(turn: Mapping[str, Any], out: Path) -> Iterator[tuple[str, str]]:
    """Text and path of the files of a turntable that are there."""
    paths = [("video", turn["video"])]
    paths += [(f"beside what {vision(observer)} sees", path) for observer, path in turn["side_by_side"].items()]
    paths.append(("pictures", turn["folder"]))
    return ((text, path) for text, path in paths if path and (out / path).exists())


def _size(picture: Path) -> tuple[int, int]:
    """Width and height of a PNG file (ISO/IEC 15948, section 11.2.1)."""
    with open(picture, "rb") as file:
        header = file.read(24)
    return int.from_bytes(header[16:20], "big"), int.from_bytes(header[20:24], "big")
