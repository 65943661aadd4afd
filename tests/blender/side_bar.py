"""The mouse in the side bar's tab "CVD" and in Blender's file browser.

Where to click is measured on Blender 5.2's factory settings on a screen of 1280 x 800. Places of the side bar are
pixels from its upper left corner, those of the file browser, which takes the whole window, from that of the screen.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from .desktop import Desktop

Place = tuple[float, float]
Condition = Callable[[dict[str, Any]], bool]

# Headers of sub-panels that are open in an empty scene, from below, so that closing one moves none of the others.
MAKE, VIEWER, CAPTURE = (50.0, 358.0), (50.0, 172.0), (50.0, 16.0)
HEADER_STEP = 28  # pixels from one closed sub-panel's header to the next one's
_CLICKS, _CLICK_MAY_TAKE = 4, 12.0  # seconds
_LEAST_CHANGE = 0.5  # grey levels in the mean; a sub-panel that opens changes several
_PATH, _CANCEL, _ACCEPT = (620, 48), (1071, 757), (1207, 757)
_BROWSER = "FILE_BROWSER WINDOW"
# What the browser has, in Blender's Python.
_PARAMETERS = "next(a for a in bpy.context.screen.areas if a.type == 'FILE_BROWSER').spaces.active.params"


def header(number: int) -> Place:
    """The header of a sub-panel, counted from 0, while all above it are closed."""
    return 50, 16 + HEADER_STEP * number


def toggle(desktop: Desktop, *headers: Place) -> None:
    """Close or open sub-panels; what is below their headers then looks different."""
    for place in headers:
        x, y, _, _ = desktop.state()["places"]["VIEW_3D UI"]
        desktop.hover(x + place[0], y + place[1])  # before the first look: the mouse highlights what is below it
        before = _below(desktop, place)
        for _ in range(_CLICKS):
            press(desktop, place)
            if np.abs(_below(desktop, place) - before).mean() > _LEAST_CHANGE:
                break
        else:
            raise AssertionError(f"the sub-panel at {place} neither opens nor closes")


def _below(desktop: Desktop, place: Place) -> np.ndarray:
    """(H, W, 3) picture of the side bar below a header."""
    x, y, width, height = desktop.state()["places"]["VIEW_3D UI"]
    top = y + round(place[1]) + HEADER_STEP // 2
    return np.asarray(desktop.look("side-bar").crop((x, top, x + width, y + height)), float)


def press(desktop: Desktop, place: Place, **options: bool) -> None:
    """Click a place of the side bar."""
    x, y, _, _ = desktop.state()["places"]["VIEW_3D UI"]
    desktop.click(x + place[0], y + place[1], **options)


def press_until(desktop: Desktop, place: Place, condition: Condition) -> float:
    """Click a place of the side bar until it has an effect; returns the seconds after the last click."""
    return _until(desktop, lambda: press(desktop, place, settle=False), condition)


def type_into(desktop: Desktop, place: Place, number: float, value: str) -> None:
    """Replace the number in a field of the side bar, until `value`, an expression in Blender, is that number."""
    for _ in range(_CLICKS):
        press(desktop, place)
        desktop.keys("ctrl+a")
        desktop.type(f"{number:g}")
        desktop.keys("Return")
        if desktop.tell(f"abs({value} - {number:g}) < 1e-6"):
            return
    raise AssertionError(f"the field keeps {desktop.tell(value)}; see {desktop.picture('field-kept')}")


def choose_folder(desktop: Desktop, button: Place, folder: str) -> None:
    """Press a button that opens the file browser, and choose a folder there."""
    _open_browser(desktop, button)
    _enter(desktop, _PATH, folder)
    _accept(desktop)


def take_proposal(desktop: Desktop, button: Place, picture: str) -> None:
    """Press a button that opens the file browser, look at the name that it proposes, and accept that."""
    _open_browser(desktop, button)
    desktop.picture(picture)
    _accept(desktop)


def save(desktop: Desktop) -> None:
    """Press Ctrl-S over the 3D view."""
    x, y, width, height = desktop.state()["places"]["VIEW_3D WINDOW"]
    desktop.hover(x + width / 3, y + height / 3)
    desktop.keys("ctrl+s")


def save_as(desktop: Desktop, path: str) -> None:
    """Save a file that has no name yet."""
    save(desktop)
    choose_file(desktop, path)


def choose_file(desktop: Desktop, path: str) -> None:
    """Accept a file, or a folder that ends with "/", in the file browser that has just been opened."""
    desktop.wait(lambda state: _BROWSER in state["places"], _CLICK_MAY_TAKE)
    desktop.settle()
    folder, _, name = path.rpartition("/")
    # Its list may take long, a click on a field may be lost, and then Return accepts what was proposed.
    desktop.ask(f"{_PARAMETERS}.directory = {f'{folder}/'.encode()!r}")
    if name:
        desktop.ask(f"{_PARAMETERS}.filename = {name!r}")
    desktop.settle()
    _accept(desktop)


def change_mind(desktop: Desktop, button: Place) -> None:
    """Press a button that opens the file browser, and cancel there."""
    _open_browser(desktop, button)
    _until(desktop, lambda: desktop.click(*_CANCEL, settle=False), lambda state: _BROWSER not in state["places"])
    desktop.settle()


def _open_browser(desktop: Desktop, button: Place) -> None:
    press_until(desktop, button, lambda state: _BROWSER in state["places"])
    desktop.settle()


def _accept(desktop: Desktop) -> None:
    _until(desktop, lambda: desktop.click(*_ACCEPT, settle=False), lambda state: _BROWSER not in state["places"])
    desktop.settle()


def _enter(desktop: Desktop, field: Place, text: str) -> None:
    desktop.click(*field)
    desktop.keys("ctrl+a")
    desktop.type(text)
    desktop.keys("Return")


def _until(desktop: Desktop, click: Callable[[], None], condition: Condition) -> float:
    """Click until it has an effect: a busy machine loses clicks. Returns the seconds after the last click."""
    for _ in range(_CLICKS):
        click()
        clicked = time.monotonic()
        while time.monotonic() - clicked < _CLICK_MAY_TAKE:
            if condition(desktop.state()):
                return time.monotonic() - clicked
            time.sleep(0.05)
    raise AssertionError(f"clicks have no effect; the state is {desktop.state()}")
