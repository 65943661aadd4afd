"""Entry of the process that turns a finished run into scene.blend: Blender's side of the pipeline.

    python cvdgs_addon/scene/worker.py RUN_FOLDER [options]                       with the bpy wheel
    blender -b --factory-startup -P cvdgs_addon/scene/worker.py -- RUN_FOLDER [options]

Speaks the protocol of ``core/events.py`` on stdout; everything that Blender prints goes to stderr. Exit codes: 0 done,
2 unusable input or arguments, 130 cancelled by SIGINT or SIGTERM, 1 a defect of ours.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import shutil
import signal
import socket
import sys
import threading
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

ROOT = Path(__file__).resolve().parents[2]

EXIT_DONE, EXIT_DEFECT, EXIT_INPUT, EXIT_CANCELLED = 0, 1, 2, 130


def load_package() -> None:
    """Load this very tree as the package ``cvdgs``, whatever its folder is called and whatever is installed."""
    # Started as a file, Python puts this folder first on the path, where our module names would hide others'.
    here = str(Path(__file__).resolve().parent)
    sys.path[:] = [entry for entry in sys.path if os.path.abspath(entry or ".") != here]
    sys.path.insert(0, str(ROOT / "core"))
    import bootstrap

    bootstrap.load()


def main(arguments: Sequence[str]) -> NoReturn:
    """Do the job and end the process."""
    load_package()
    from cvdgs.core.errors import InputError
    from cvdgs.core.events import JsonReporter, claim_stdout

    reporter = JsonReporter(claim_stdout())
    code = EXIT_DONE
    try:
        options = _parse(arguments)
        # Before bpy is imported, which takes a second: whoever cancels then is heard.
        _end_on_signal(Path(options.run_folder))
        from cvdgs.cvdgs_addon.scene.convert import convert

        result = convert(options.run_folder, reporter=reporter, options=_conversion_options(options))
        reporter.emit("result", **vars(result))
    except InputError as error:
        reporter.emit("error", kind="input", message=str(error))
        code = EXIT_INPUT
    except Exception as error:
        traceback.print_exc()
        reporter.emit("error", kind="defect", message=f"{type(error).__name__}: {error}".splitlines()[0])
        code = EXIT_DEFECT
    _end(code)


def _parse(arguments: Sequence[str]) -> argparse.Namespace:
    from cvdgs.core.errors import InputError

    class Parser(argparse.ArgumentParser):
        def error(self, message: str) -> NoReturn:
            raise InputError(message, where="worker.py", remedy="see the head of the file")

    parser = Parser(prog="worker.py", description="Turn a finished run into scene.blend and stills.")
    parser.add_argument("run_folder", metavar="RUN_FOLDER", help="the output folder of a run")
    parser.add_argument("--view", help="key of the view that stills show (default: the first)")
    parser.add_argument(
        "--display",
        choices=("photo", "scene-linear"),
        default="photo",
        help="photo: colours and blending as trained; scene-linear: for a scene with lamps",
    )
    parser.add_argument(
        "--background",
        type=float,
        nargs=3,
        metavar=("R", "G", "B"),
        help="sRGB behind the Gaussians (default: as trained)",
    )
    parser.add_argument("--no-stills", action="store_true", help="write scene.blend only")
    parser.add_argument("--no-place", action="store_true", help="keep the capture's own axes and units")
    return parser.parse_args(arguments)


def _conversion_options(options: argparse.Namespace):
    from cvdgs.cvdgs_addon.scene.convert import ConversionOptions
    from cvdgs.cvdgs_addon.scene.render_settings import Display

    return ConversionOptions(
        display=Display(options.display),
        background=tuple(options.background) if options.background else None,
        view=options.view,
        stills=not options.no_stills,
        place=not options.no_place,
    )


def _end_on_signal(run_folder: Path) -> None:
    """End the process within moments of SIGINT or SIGTERM, leaving nothing half-written.

    Blender renders in one long call during which Python's signal handlers cannot run on the main thread; a thread that
    Python wakes from the C handler can.
    """
    receiver, sender = socket.socketpair()
    sender.setblocking(False)

    def watch() -> None:
        receiver.recv(1)
        from cvdgs.cvdgs_addon.scene.finished_run import PARTIAL_FOLDER

        shutil.rmtree(run_folder / PARTIAL_FOLDER, ignore_errors=True)
        _end(EXIT_CANCELLED)

    threading.Thread(target=watch, name="cancel", daemon=True).start()
    signal.set_wakeup_fd(sender.detach())
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: None)


def _end(code: int) -> NoReturn:
    """End at once, because Blender 4.5 can hang in its own clean-up; what that would have removed is removed here."""
    bpy = sys.modules.get("bpy")
    if bpy is not None and getattr(bpy, "app", None) is not None:
        shutil.rmtree(bpy.app.tempdir, ignore_errors=True)
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError):
            stream.flush()
    os._exit(code)


if __name__ == "__main__":
    main(sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:])
