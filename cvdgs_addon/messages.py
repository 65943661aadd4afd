"""What the user is told outside of an operator: popups for what went wrong in the background, reports for the rest."""

from __future__ import annotations

import re
import sys
import textwrap

import bpy

from ..core.settings import OPTIONS, flag

WIDTH = 70  # characters a line; popups and panels do not wrap


# The worker speaks of the command line's options; this is what they are called in the panels.
_OPTIONS = {flag(name): option.label for name, option in OPTIONS.items() if option.label} | {
    "--cameras": "Cameras",
    "--out": "Output",
    "--cvd": "Type",
    "--severity": "Severity",
    "--enhancer": "Enhancer",
    "--device": "Device (preferences)",
    "--max-size": "Quality",
    "--iterations": "Quality",
    "--resume": "adding a layer",
    "--no-blend": "no Scene File and Stills",
    "--no-refine-poses": "Correct Cameras off",
}
_OPTION = re.compile(r"--[a-z][a-z-]*")


def in_panel_words(text: str) -> str:
    """A message of `core` with the names that the user sees in the panels."""
    text = text.replace("add --cameras estimate", "set --cameras to Estimate")
    text = text.replace("leave out --cameras given", "set --cameras to Automatic")
    return _OPTION.sub(lambda found: f"'{_OPTIONS[found[0]]}'" if found[0] in _OPTIONS else found[0], text)


def lines_of(text: str, width: int = WIDTH) -> list[str]:
    """`text` in lines; what to do (after " - ", see `core.errors.InputError`) begins a line of its own."""
    what, *remedies = in_panel_words(text).split(" - ")
    return [line for part in (what, *map(sentence, remedies)) for line in textwrap.wrap(part, width)]


def sentence(text: str) -> str:
    """`text` with a capital at its beginning."""
    return text[:1].upper() + text[1:]


def show_problem(title: str, text: str) -> None:
    """Pop up what went wrong and what to do; without a window it goes to stderr."""
    _show(title, text, "ERROR")


def show_information(title: str, text: str) -> None:
    """Pop up good news; without a window it goes to stderr."""
    _show(title, text, "INFO")


def _show(title: str, text: str, icon: str) -> None:
    windows = bpy.context.window_manager.windows
    if bpy.app.background or not windows:
        print(f"{title}: {text}", file=sys.stderr)
        return

    def draw(popup: bpy.types.UIPopupMenu, _context: bpy.types.Context) -> None:
        for line in lines_of(text):
            popup.layout.label(text=line)

    with bpy.context.temp_override(window=windows[0]):  # a timer has none
        bpy.context.window_manager.popup_menu(draw, title=title, icon=icon)
