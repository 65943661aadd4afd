"""The captures that are studied: the demo, further synthetic showrooms, and any folder."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from ...demo import SHOWROOM
from ...errors import InputError
from ...events import Reporter
from .showroom_process import render_showroom
from .subject import CaptureFolder

DEMO = "demo"
RENDERED: Mapping[str, tuple[str, ...]] = {
    "showroom-protan": ("--seed", "5", "--variant", "protan"),
    "showroom-tritan": ("--seed", "9", "--variant", "tritan", "--satin-roughness", ".15", "--yarn-scale", ".6"),
}
"""Showrooms that are not shipped, and what make_showroom.py makes them of; each has colours that its type confuses."""
SHOWROOMS = (DEMO, *RENDERED)
_SIZE = ("--width", "480", "--height", "360")


def showrooms(folder: Path, reporter: Reporter, wanted: Sequence[str] = SHOWROOMS) -> dict[str, Path]:
    """The synthetic showrooms of these names; those that `folder` has not are rendered there, minutes each.

    Raises:
        InputError: one could not be rendered.
    """
    missing = [name for name in wanted if name in RENDERED]
    found = {}
    for name in wanted:
        if name == DEMO:
            found[name] = SHOWROOM
        else:
            share = 1.0 / len(missing)
            done = missing.index(name) * share
            found[name] = render_showroom(folder / name, (*RENDERED[name], *_SIZE), reporter, done=done, share=share)
    return found


def capture_sources(asked: Sequence[str], max_size: int, folder: Path, reporter: Reporter) -> list[CaptureFolder]:
    """The captures that a command line names.

    Args:
        asked: names of showrooms, folders, or NAME=FOLDER.
        max_size: longer side of the views in pixels.
        folder: for showrooms that have to be rendered.

    Raises:
        InputError: there is no such capture, two have one name, or a showroom could not be rendered.
    """
    places = dict(_place(text) for text in asked)
    if len(places) < len(asked):
        raise InputError("two captures have one name", where="--captures", remedy="use NAME=FOLDER for one of them")
    rendered = showrooms(folder, reporter, [name for name, place in places.items() if place is None])
    return [CaptureFolder(name, place or rendered[name], max_size) for name, place in places.items()]


def _place(text: str) -> tuple[str, Path | None]:
    """A capture's name and folder; None for a showroom that may have to be rendered."""
    if text in SHOWROOMS:
        return text, None
    name, separator, folder = text.partition("=")
    path = Path(folder if separator else text)
    if not path.is_dir():
        names = ", ".join(SHOWROOMS)
        raise InputError(f"no capture '{text}'", where="--captures", remedy=f"use {names}, a folder or NAME=FOLDER")
    return (name if separator else path.resolve().name), path
