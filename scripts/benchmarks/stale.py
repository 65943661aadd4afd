"""Says on pages of figures whether their recipe has changed since they were made.

Command: ``benchmark.py provenance --out FOLDER``.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from ...core.errors import InputError
from .options import Part
from .parts import MEASURING
from .provenance import BY_HAND, Facts, mark


def facts_of_parts() -> dict[str, Facts]:
    """What shapes the studies whose pages carry a recipe, by the names of their parts."""
    return {part.name: part.shaped_by for part in MEASURING if part.shaped_by is not None}


def pages_of(folder: Path) -> list[Path]:
    """The pages of a folder that commands have made."""
    return [page for page in sorted(folder.glob("*.md")) if page.name not in BY_HAND]


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    """The folder of the pages is ``--out``."""


def _measure(options: argparse.Namespace) -> str:
    """Mark every page in ``--out``; nothing is measured."""
    pages = pages_of(options.out)
    if not pages:
        raise InputError("there are no pages of figures", where=options.out, remedy="name a folder of pages with --out")
    marked = {page.name: mark(page, facts_of_parts()) for page in pages}
    return "\n".join(f"{name}: {'stale' if line.stale else 'current'}" for name, line in marked.items())


PART = Part("provenance", "say on the pages in --out whether their recipe has changed since", _add_arguments, _measure)
