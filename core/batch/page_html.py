"""The markup of a batch's page; see `page`. Standard library only.

Everything can be done with the keyboard, nothing is told by colour alone, and on paper each turntable is its first
picture with the figures. Without scripts, videos and figures stand one below the other.
"""

from __future__ import annotations

import base64
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from html import escape
from importlib import resources
from pathlib import Path
from typing import Any
from urllib.parse import quote

from ..rendering.requests import seen_by, vision
from ..runs.report import SCORED_PICTURES
from .previews import Preview, PreviewFiles

_GLOSSARY = {
    "Contrast that is left (CCPR)": (
        "share of the pairs of places whose colours differ for normal vision and still differ for the observer; 1 is "
        "all of them"
    ),
    "Structure that is left (SSIM)": (
        "likeness of the scene as it is and as the observer sees it; 1 is the same structure"
    ),
    "Naturalness": (
        "how close the enhanced photographs are to the original ones: 1 is equal by SSIM, 0 is equal by mean ΔE00"
    ),
    "View consistency (RWE)": (
        "how much a colour changes from view to view, against the photographs: 1 is as much as there, less is steadier"
    ),
}


@dataclass(frozen=True)
class ShownTurn:
    """A turntable on the page.

    Attributes:
        name: among those of its item.
        preview: what it shows.
        files: of the preview; None where pictures are missing.
        size: width and height of a picture.
        report: figures of the layer in the run's report; empty where there are none.
        links: text and path of files, from the batch's folder.
    """

    name: str
    preview: Preview
    files: PreviewFiles | None
    size: tuple[int, int]
    report: Mapping[str, Any]
    links: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class ShownItem:
    """An item on the page.

    Attributes:
        name: in the batch.
        turns: its turntables.
        report: of its run; empty where there is none.
        sheet: path of its contact sheet from the batch's folder.
    """

    name: str
    turns: tuple[ShownTurn, ...]
    report: Mapping[str, Any]
    sheet: str | None

    @property
    def is_complete(self) -> bool:
        return all(turn.files is not None for turn in self.turns)


@dataclass
class ShownPage:
    """All that a page shows.

    Attributes:
        title: of the batch.
        items: in the batch's order.
        out: the batch's folder, where the page lies.
        embeddable: bytes of videos that may still be embedded.
    """

    title: str
    items: tuple[ShownItem, ...]
    out: Path
    embeddable: int
    linked: int = field(default=0, init=False)  # videos that are not embedded

    def video_source(self, video: Path) -> str:
        """What plays `video`: its bytes, or the file where the page would become too large."""
        size = video.stat().st_size
        if size > self.embeddable:
            self.linked += 1
            return quote(video.relative_to(self.out).as_posix())
        self.embeddable -= size
        return _data(video, "video/mp4")


def page_text(page: ShownPage) -> Iterator[str]:
    """The page, piece by piece: with its videos it can be large."""
    style, script = _resource("page_style.css"), _resource("page_player.js")
    yield (
        "<!doctype html>\n<html lang='en'>\n<head>\n<meta charset='utf-8'>\n"
        "<meta name='viewport' content='width=device-width, initial-scale=1'>\n"
        f"<title>{escape(page.title)}</title>\n<style>\n{style}</style>\n</head>\n<body>\n"
    )
    yield _header(page)
    yield "<main>\n"
    for number, item in enumerate(page.items):
        yield from _item(page, number, item)
    yield f"</main>\n{_footer(page)}<script>\n{script}</script>\n</body>\n</html>\n"


def _header(page: ShownPage) -> str:
    turns = sum(len(item.turns) for item in page.items)
    lead = f"{_count(len(page.items), 'item')}, {_count(turns, 'turntable')}"
    incomplete = [item.name for item in page.items if not item.is_complete]
    note = ""
    if incomplete:
        note = f"<p class='note'>Not complete: {escape(', '.join(incomplete))}. The batch's logs say why.</p>\n"
    entries = "".join(
        f"<li><a href='#item-{number}'>{escape(item.name)}</a>{'' if item.is_complete else ' (not complete)'}</li>\n"
        for number, item in enumerate(page.items)
    )
    nav = f"<nav aria-label='Items'><ul>\n{entries}</ul></nav>\n" if len(page.items) > 1 else ""
    return f"<header>\n<h1>{escape(page.title)}</h1>\n<p class='lead'>{lead}</p>\n{note}{nav}</header>\n"


def _item(page: ShownPage, number: int, item: ShownItem) -> Iterator[str]:
    yield f"<article class='item' id='item-{number}'>\n<h2>{escape(item.name)}</h2>\n{_lead(item.report)}"
    if len(item.turns) > 1:
        options = [(str(index), turn.name) for index, turn in enumerate(item.turns)]
        choice = _choice("Turntable", f"item-{number}-turn", "", options, chosen="0")
        yield f"<div class='choices turns' hidden>{choice}</div>\n"
    for index, turn in enumerate(item.turns):
        yield _turn(page, f"item-{number}-turn-{index}", item, turn)
    yield "</article>\n"


def _turn(page: ShownPage, key: str, item: ShownItem, turn: ShownTurn) -> str:
    links = [*turn.links, *([("contact sheet", item.sheet)] if item.sheet else [])]
    files = " · ".join(f"<a href='{quote(path)}'>{escape(text)}</a>" for text, path in links)
    return (
        f"<section class='turn' id='{key}' aria-label='{escape(f'{item.name}, {turn.name}', quote=True)}'>\n"
        + (_player(page, key, turn) if turn.files is not None else _missing(turn))
        + _figures(turn)
        + (f"<p class='files'>Files: {files}</p>\n" if files else "")
        + "</section>\n"
    )


def _missing(turn: ShownTurn) -> str:
    return f"<p class='note'>{escape(turn.name)}: some of its pictures are missing; the batch's logs say why.</p>\n"


def _player(page: ShownPage, key: str, turn: ShownTurn) -> str:
    preview, files = turn.preview, turn.files
    assert files is not None
    columns = len(preview.columns)
    captions = _captions(preview)
    listed = "".join(f"<li><span>{escape(caption)}</span></li>" for caption in captions)
    said = escape(f"A turn around the scene: {'; '.join(captions)}", quote=True)
    step = 360.0 / preview.frames
    width, height = turn.size
    variables = f"--columns: {columns}; --rows: {preview.rows}; --width: {width}; --height: {height}"
    return (
        f"<div class='choices'>{_view_choices(key, preview)}</div>\n"
        f"<div class='stage' style='{variables}' role='group' aria-label='{said}'>\n"
        f"<img class='film' alt='{said}' src='{_data(files.poster, 'image/jpeg')}'>\n"
        f"<video class='film' loop muted playsinline src='{page.video_source(files.video)}'></video>\n"
        f"<ul class='film captions'>{listed}</ul>\n</div>\n"
        f"<div class='transport' hidden><button type='button' class='play'>Pause</button>"
        f"<input type='range' min='0' max='{360.0 - step:g}' step='{step:g}' value='0' aria-label='Picture'"
        f" data-pace='{preview.frames_per_second}'><output>1 / {preview.frames}</output></div>\n"
    )


def _captions(preview: Preview) -> list[str]:
    """What each part of the preview shows, row by row."""
    if not preview.observer:
        return ["Original"]
    columns = ["Original", "Enhanced"] if len(preview.columns) > 1 else ["Enhanced"]
    return columns + [seen_by(column, preview.observer) for column in columns]


def _view_choices(key: str, preview: Preview) -> str:
    choices = ""
    if len(preview.columns) > 1:
        options = [("both", "both"), ("first", "original"), ("second", "enhanced")]
        choices += _choice("Colours", f"{key}-colours", "colours", options, chosen="both")
    if preview.observer:
        options = [("both", "both"), ("normal", "normal vision"), ("observer", vision(preview.observer))]
        choices += _choice("Seen by", f"{key}-seen", "seen", options, chosen="both")
    return choices


def _choice(legend: str, name: str, kind: str, options: list[tuple[str, str]], *, chosen: str) -> str:
    labels = "".join(
        f"<label><input type='radio' name='{name}' class='{kind}' value='{value}'"
        f"{' checked' if value == chosen else ''}><span>{escape(text)}</span></label>"
        for value, text in options
    )
    return f"<fieldset><legend>{legend}</legend>{labels}</fieldset>\n"


def _figures(turn: ShownTurn) -> str:
    """The figures of the layer, as far as the run's report has them."""
    layer = turn.report
    if not layer:
        return ""
    natural, drift = layer.get("naturalness") or {}, layer.get("rwe") or {}
    contrast, structure = layer.get("ccpr") or {}, layer.get("ssim_simulated") or {}
    rows = [
        _row("Contrast that is left (CCPR)", [contrast.get(kind) for kind in SCORED_PICTURES], 3, bars=True),
        _row("Structure that is left (SSIM)", [structure.get(kind) for kind in SCORED_PICTURES], 3, bars=True),
        _row("Naturalness: SSIM", [None, natural.get("ssim"), None, None], 3),
        _row("Naturalness: mean ΔE00", [None, natural.get("delta_e"), None, None], 1),
        _row("View consistency (RWE)", [None, drift.get("enhanced_ratio"), None, drift.get("ratio")], 2),
    ]
    head = "".join(f"<th scope='col'>{name}</th>" for name in SCORED_PICTURES.values())
    caption = f"Measured by the run, for {escape(vision(turn.preview.observer))}"
    return (
        f"<div class='scroll'><table><caption>{caption}</caption>"
        f"<thead><tr><th scope='col'></th>{head}</tr></thead><tbody>\n{''.join(rows)}</tbody></table></div>\n"
    )


def _lead(report: Mapping[str, Any]) -> str:
    quality, views = report.get("reconstruction") or {}, report.get("capture") or {}
    parts = []
    if isinstance(report.get("gaussians"), int):
        parts.append(f"{report['gaussians']:,} Gaussians")
    if views.get("views"):
        parts.append(f"{views['views']} photographs")
    if quality.get("psnr") is not None:
        judged = "held-out" if views.get("test", 1) else "training"
        parts.append(f"{quality['psnr']:.2f} dB on {judged} views")
    return f"<p class='lead'>{' · '.join(parts)}</p>\n" if parts else ""


def _row(name: str, values: list[float | None], digits: int, *, bars: bool = False) -> str:
    """A line of the table; `bars` draws what is from 0 to 1 and makes the largest bold."""
    known = [value for value in values if value is not None]
    cells = ""
    for value in values:
        text = "–" if value is None else f"{value:.{digits}f}"
        if bars and value is not None:
            text += f"<span class='bar' style='width: {100.0 * min(max(value, 0.0), 1.0):.0f}%'></span>"
        is_best = bars and len(known) > 1 and value == max(known)
        cells += f"<td{' class=best' if is_best else ''}>{text}</td>"
    return f"<tr><th scope='row'>{escape(name)}</th>{cells}</tr>\n"


def _footer(page: ShownPage) -> str:
    terms = "".join(f"<dt>{escape(term)}</dt><dd>{escape(text)}</dd>\n" for term, text in _GLOSSARY.items())
    linked = ""
    if page.linked:
        linked = f"<p>{_count(page.linked, 'video')} did not fit into this file and lie beside it.</p>\n"
    how = "Drag a picture to turn it, or use the slider and the arrow keys."
    return f"<footer>\n<p class='how'>{how}</p>\n{linked}<dl>\n{terms}</dl>\n</footer>\n"


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def _data(path: Path, kind: str) -> str:
    return f"data:{kind};base64,{base64.b64encode(path.read_bytes()).decode('ascii')}"


def _resource(name: str) -> str:
    text = resources.files(__package__).joinpath(name).read_text(encoding="utf-8")
    return re.sub(r"\n\n+", "\n", text)
