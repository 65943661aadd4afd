"""HTML pages from Jinja2 templates: one skeleton, text escaped, pictures embedded. For the worker, which has Jinja2."""

from __future__ import annotations

import base64
import math
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined, Template

_SHARED = Path(__file__).with_name("templates")


def write_page(path: Path, template: Path, **values: Any) -> None:
    """Render `template` with `values` into the file `path`, piece by piece: with embedded pictures it can be large.

    The template may extend ``base.html``; beside Jinja2's own it has the filter ``number(digits)`` and the functions
    ``embed(path, type)`` and ``count(number, noun)``.

    Raises:
        OSError: the page cannot be written, or a picture cannot be read.
    """
    # A file's name may hold bytes that are no UTF-8.
    _load(template).stream(values).dump(str(path), encoding="utf-8", errors="backslashreplace")


def render(template: Path, **values: Any) -> str:
    """The text of `template`, a part of a page, with `values`."""
    return _load(template).render(values).encode("utf-8", "backslashreplace").decode("utf-8")


def _load(template: Path) -> Template:
    loader = FileSystemLoader([template.parent, _SHARED])
    pages = Environment(loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    pages.filters["number"] = _number
    pages.globals |= {"embed": embed, "count": _count}
    return pages.get_template(template.name)


def embed(path: Path, mime_type: str = "image/png") -> str:
    """The contents of a file as a data URI."""
    return f"data:{mime_type};base64,{base64.b64encode(path.read_bytes()).decode('ascii')}"


def _number(value: float | None, digits: int = 3) -> str:
    return "–" if value is None or not math.isfinite(value) else f"{value:,.{digits}f}"


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"
