"""A real Blender with its window on a virtual screen: started, clicked, looked at.

The machine provides it; the tests are told by two environment variables where it is:

    CVDGS_REAL_BLENDER        a program that is called as
                                  PROGRAM run ROOT ARGUMENTS...     Blender, with its window
                                  PROGRAM exec ROOT COMMAND...      any command beside it; xdotool has to be there
                                  PROGRAM shot ROOT FILE.png        a picture of the screen
                                  PROGRAM bind ROOT FOLDER...       folders of this machine, at the same path there
    CVDGS_REAL_BLENDER_ROOT   the folder in which it lives; its subfolder share is /share there

More are for pictures, docs/panel.png and docs/result.png among them:

    CVDGS_PICTURES            the folder for them; without it they are forgotten
    CVDGS_FINISHED_RUN        the run that they show, out/demo for example; without it a small one is made
    CVDGS_SCALE               2 on a screen of 2560 x 1600, for finer pictures; everything has that many times its size

    python -m pytest -m slow tests/blender
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from PIL import Image

PROGRAM, ROOT = os.environ.get("CVDGS_REAL_BLENDER", ""), os.environ.get("CVDGS_REAL_BLENDER_ROOT", "")
MISSING = "no real Blender: set CVDGS_REAL_BLENDER and CVDGS_REAL_BLENDER_ROOT (see tests/blender/desktop.py)"

SCALE = int(os.environ.get("CVDGS_SCALE", "1"))
"""Pixels of the screen for one of a screen of 1280 x 800, in which all places and sizes are given."""

_WATCH = Path(__file__).with_name("watch.py")
_START_SECONDS = 120.0
_ANSWER_SECONDS = 120.0  # software OpenGL compiles the shaders of a view that it has not drawn yet
_SETTLE = 1.5  # seconds for a window to answer a click and move its panels
_STEPS = 10  # of a drag
_PACE = 0.4  # seconds within which a window that draws nothing looks at itself many times


class Desktop:
    """The screen and the Blender on it.

    Args:
        pictures: folder for pictures of the screen.
    """

    def __init__(self, pictures: Path) -> None:
        self.share = Path(ROOT, "share")
        self._pictures = pictures
        self._blender: subprocess.Popen | None = None
        self._log, self._said_before = pictures / "blender.log", 0

    def command(self, *arguments: str) -> str:
        """Run Blender without a window, to its end; returns what it says."""
        result = subprocess.run([PROGRAM, "run", ROOT, *arguments], capture_output=True, text=True, timeout=120)
        assert result.returncode == 0, result.stdout + result.stderr
        return result.stdout

    def start(self, *arguments: str, **options: Any) -> dict[str, Any]:
        """Start Blender with its window; returns the first state that `watch.py` writes.

        Args:
            arguments: of Blender, a .blend file for example.
            options: for `watch.py`.
        """
        shutil.copy(_WATCH, self.share / "watch.py")
        (self.share / "options.json").write_text(json.dumps({**options, "scale": SCALE}))
        for left in ("state.json", "code.py"):
            (self.share / left).unlink(missing_ok=True)
        log = open(self._log, "a")  # noqa: SIM115 - Blender writes to it as long as it runs
        self._said_before = self._log.stat().st_size
        self._blender = subprocess.Popen(
            [PROGRAM, "run", ROOT, *arguments, "-P", "/share/watch.py"], stdout=log, stderr=subprocess.STDOUT
        )
        return self.wait(lambda state: state["ready"], _START_SECONDS)

    def state(self) -> dict[str, Any]:
        """What `watch.py` wrote last."""
        while True:
            try:
                return json.loads((self.share / "state.json").read_text())
            except (OSError, ValueError):  # not there yet
                assert self._blender is not None
                assert self._blender.poll() is None, "Blender has ended"
                time.sleep(0.05)

    def wait(self, condition: Callable[[dict[str, Any]], bool], seconds: float) -> dict[str, Any]:
        """The first state for which `condition` holds."""
        deadline = time.monotonic() + seconds
        while not condition(state := self.state()):
            assert time.monotonic() < deadline, f"waited too long; the state is {state}"
            time.sleep(0.05)
        return state

    def ask(self, code: str) -> None:
        """Let Blender run Python code: what a user's mouse cannot do in a test of this length."""
        (self.share / "code.partial").write_text(code)
        os.replace(self.share / "code.partial", self.share / "code.py")
        deadline = time.monotonic() + _ANSWER_SECONDS
        while (self.share / "code.py").exists():
            assert time.monotonic() < deadline, "Blender does not answer"
            time.sleep(0.02)

    def tell(self, expression: str, before: str = "") -> Any:
        """The value of a Python expression in Blender, as JSON has it, after the code `before`."""
        answer = self.share / "answer.json"
        answer.unlink(missing_ok=True)
        self.ask(f"{before}\nimport json\nopen('/share/answer.json', 'w').write(json.dumps({expression}))")
        return json.loads(answer.read_text())

    def click(self, x: float, y: float, *, settle: bool = True) -> None:
        """Click with the left button; pixels from the upper left corner of the screen; wait for its effect."""
        self._move(x, y)
        # A press and a release at the same moment are lost on a busy machine.
        self._exec("xdotool", "sleep", "0.4", "mousedown", "1", "sleep", "0.15", "mouseup", "1")
        if settle:
            self.settle()

    def drag(self, x: float, y: float, right: float, down: float) -> None:
        """Drag from a place with the middle button, which orbits."""
        self.hover(x, y)
        way = ("mousemove_relative", str(round(SCALE * right)), str(round(SCALE * down)))
        self._exec("xdotool", "mousedown", "2", "sleep", "0.3", *way, "sleep", "0.3", "mouseup", "2")

    def slide(self, x: float, y: float, right: float) -> None:
        """Drag a slider from a place with the left button, in steps, as a hand does."""
        self.hover(x, y)
        step = ("mousemove_relative", "--", str(round(SCALE * right / _STEPS)), "0", "sleep", "0.15")
        self._exec("xdotool", "mousedown", "1", "sleep", "0.3", *(step * _STEPS), "sleep", "0.3", "mouseup", "1")
        self.settle()

    def hover(self, x: float, y: float) -> None:
        """Move the mouse to a place; what is there hears the keys."""
        self._move(x, y)
        self.settle()

    def keys(self, *names: str) -> None:
        """Press keys, one after the other."""
        self._exec("xdotool", "key", "--delay", "80", *names)
        self.settle()

    def type(self, text: str) -> None:
        """Type text."""
        self._exec("xdotool", "type", "--delay", "20", text)
        self.settle()

    def picture(self, name: str) -> Path:
        """A picture of the screen, kept under `name`."""
        self.settle()
        path = self._pictures / f"{name}.png"
        subprocess.run([PROGRAM, "shot", ROOT, str(path)], check=True, timeout=30)
        return path

    def cut(self, name: str, box: tuple[float, float, float, float]) -> Image.Image:
        """A part of the screen in all its pixels; a picture of the whole is kept under `name`.

        Args:
            name: of the picture.
            box: left, upper, right and lower end.
        """
        return Image.open(self.picture(name)).convert("RGB").crop(tuple(round(SCALE * end) for end in box))

    def leave(self) -> None:
        """Take the mouse out of the way, so that nothing is highlighted and no tooltip shown."""
        self.hover(640, 790)

    def look(self, name: str) -> Image.Image:
        """What the screen shows, a pixel for each of a screen of 1280 x 800; a picture is kept under `name`."""
        return Image.open(self.picture(name)).convert("RGB").reduce(SCALE)

    def settle(self) -> None:
        """Give the window time to draw what has changed, until it comes to look at itself at its usual pace again."""
        time.sleep(_SETTLE)
        deadline = time.monotonic() + _ANSWER_SECONDS
        while time.monotonic() < deadline:
            before = self.state()["time"]
            time.sleep(_PACE)
            if self.state()["time"] - before > 0.5 * _PACE:
                return

    def console(self) -> str:
        """What Blender has said on its console since it was started."""
        return self._log.read_bytes()[self._said_before :].decode(errors="replace")

    def quit(self) -> None:
        """Let Blender quit as from its menu, and wait for it; nothing may have failed with a traceback."""
        if self._blender is not None and self._blender.poll() is None:
            (self.share / "code.py").write_text("bpy.ops.wm.quit_blender()")
            self._blender.wait(30.0)
            assert "Traceback" not in self.console(), self.console()
        self._blender = None

    def kill(self) -> None:
        """End Blender as a crash does."""
        if self._blender is not None and self._blender.poll() is None:
            self._exec("sh", "-c", "kill -9 $(cat /share/blender.pid)")
            self._blender.wait(30.0)
        self._blender = None

    def _move(self, x: float, y: float) -> None:
        self._exec("xdotool", "mousemove", str(round(SCALE * x)), str(round(SCALE * y)))

    def _exec(self, *command: str) -> None:
        subprocess.run([PROGRAM, "exec", ROOT, *command], check=True, timeout=30)
