"""Entry of the process that turns a finished run into scene.blend: Blender's side of the pipeline.

    python cvdgs_addon/scene/worker.py RUN_FOLDER [options]                       with the bpy wheel
    blender -b --factory-startup -P cvdgs_addon/scene/worker.py -- RUN_FOLDER [options]

Speaks the protocol of ``core/runtime/protocol.py``, with the exit codes of `worker_process`.
"""

from __future__ import annotations

import argparse
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NoReturn


def main(arguments: Sequence[str]) -> NoReturn:
    """Do the job and end the process."""
    from cvdgs.cvdgs_addon.worker_process import serve

    serve(lambda: _parse(arguments), _convert, _clean_up)


def _convert(options: argparse.Namespace, reporter: Any) -> dict[str, Any]:
    from cvdgs.cvdgs_addon.scene.convert import convert

    return vars(convert(options.run_folder, reporter=reporter, options=_conversion_options(options)))


def _clean_up(options: argparse.Namespace) -> None:
    from cvdgs.cvdgs_addon.scene.finished_run import PARTIAL_FOLDER

    shutil.rmtree(Path(options.run_folder) / PARTIAL_FOLDER, ignore_errors=True)


def _parse(arguments: Sequence[str]) -> argparse.Namespace:
    from cvdgs.core.runtime.cli import OneLineParser

    parser = OneLineParser(prog="worker.py", description="Turn a finished run into scene.blend and stills.")
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


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "core"))
    import bootstrap

    bootstrap.load(script=__file__)
    main(sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:])
