"""Photographs alone, without cameras: recoloured so that people with a colour vision deficiency tell more apart.

    python scripts/enhance.py IMAGES|FOLDER... --out DIR [options]
    blender -b -P scripts/enhance.py -- IMAGES|FOLDER... --out DIR [options]

For example: python scripts/enhance.py fabrics/ --out friendly --cvd protan --severity 0.7

Writes DIR/<name>.png for every photograph, metrics.csv and sheet.html (before, after, and both as the observer sees
them). Needs the standard library only: a worker process with its own interpreter does the work.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "core"))
import bootstrap

bootstrap.load()
from cvdgs.core.errors import InputError
from cvdgs.core.photographs.front import EnhanceRequest, enhance_in_console
from cvdgs.core.runtime.cli import OneLineParser, add_settings, script_arguments
from cvdgs.core.settings import CVD_TYPES


def build_parser() -> argparse.ArgumentParser:
    """The options of docs/command-line.md; `EnhanceRequest` checks their values."""
    parser = OneLineParser(
        prog="enhance.py", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False
    )
    add = parser.add_argument
    add("inputs", nargs="+", metavar="IMAGES|FOLDER", help="photographs; folders are searched with their subfolders")
    add("--out", required=True, metavar="DIR", help="folder for the results; replaced only when everything succeeds")
    add("--cvd", default="deutan", metavar="TYPE", help=f"{'|'.join(CVD_TYPES)} (deutan)")
    add("--severity", type=float, default=1.0, metavar="0..1", help="(1)")
    add_settings(parser, ("simulation", "strength", "enhancer", "change_budget", "fit", "seed", "device"))
    add(
        "--separately",
        action="store_true",
        help="fit each photograph on its own; by default those of like colours are one scene",
    )
    add("--together", action="store_true", help="fit all photographs as one scene, whatever their colours")
    add("--skip-unreadable", action="store_true", help="skip damaged photographs; by default they are an error")
    add("--json", action="store_true", help="events on stdout, one JSON object per line, instead of a progress bar")
    return parser


def main(arguments: list[str]) -> int:
    """Parse, enhance, and return the exit code of the contract."""
    try:
        options = vars(build_parser().parse_args(arguments))
        json_events = options.pop("json")
        request = EnhanceRequest(**{**options, "inputs": tuple(options["inputs"])})
    except InputError as error:
        print(f"enhance.py: {error}", file=sys.stderr)
        return 2
    return enhance_in_console(request, json_events=json_events)


if __name__ == "__main__":
    code = main(script_arguments())
    sys.stdout.flush()
    sys.exit(code)
