"""The main job: from photographs or videos to a CVD-friendly Gaussian scene in Blender.

    python scripts/run.py CAPTURE --out DIR [options]
    blender -b -P scripts/run.py -- CAPTURE --out DIR [options]
    python scripts/run.py --doctor                              what is here, what is missing, how to get it

Needs the standard library only: the work is done by worker processes with their own interpreters.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "core"))
import bootstrap

bootstrap.load(oldest=(3, 10))
from cvdgs.core.doctor.console import DOCTOR, diagnose_in_console

# It is for machines where little is right yet: it comes before the imports that need a newer Python, and before the
# parser, which wants a capture and --out.
if __name__ == "__main__" and DOCTOR in sys.argv:
    sys.exit(diagnose_in_console(as_json="--json" in sys.argv))

bootstrap.require_python()
from cvdgs.core.errors import InputError
from cvdgs.core.pipeline.given import LAYERS
from cvdgs.core.pipeline.launch import run_in_console
from cvdgs.core.runtime.cli import OneLineParser, add_settings, script_arguments
from cvdgs.core.settings import CVD_TYPES, OPTIONS, QUALITIES, Layer, Settings


def build_parser() -> argparse.ArgumentParser:
    """The options of docs/command-line.md; their ranges are checked by `Settings`."""
    parser = OneLineParser(prog="run.py", description=__doc__.splitlines()[0], allow_abbrev=False)
    add = parser.add_argument
    add(
        "capture",
        metavar="CAPTURE",
        help="folder of photographs, with cameras (COLMAP model or transforms.json) or without; or a video, or a zip",
    )
    add("--out", required=True, metavar="DIR", help="folder for the results; replaced only when the run succeeds")
    add("--cvd", action="append", metavar="TYPE", help=f"{'|'.join(CVD_TYPES)}; repeat for several layers (deutan)")
    add("--severity", action="append", type=float, metavar="0..1", help="one for all layers, or one per --cvd (1)")
    words = {quality.name.lower(): quality for quality in QUALITIES}
    steps = ", ".join(f"{word} {one.iterations} steps at {one.max_size} pixels" for word, one in words.items())
    add("--quality", choices=words, help=f"--iterations and --max-size by one word: {steps}")
    add_settings(parser, OPTIONS)
    add("--json", action="store_true", help="events on stdout, one JSON object per line, instead of a progress bar")
    add(
        DOCTOR,
        action="store_true",
        help="instead of a run, show what is installed, what is missing and how to get it; also with --json",
    )
    return parser


def parse_options(arguments: list[str]) -> argparse.Namespace:
    """The options, with those that ``--quality`` stands for where they are not given themselves."""
    options = build_parser().parse_args(arguments)
    for quality in QUALITIES:
        if quality.name.lower() == options.quality:
            usual = {"iterations": quality.iterations, "max_size": quality.max_size}
            return argparse.Namespace(**{**usual, **vars(options)})
    return options


def parse_settings(options: argparse.Namespace) -> Settings:
    """The validated settings for parsed options."""
    types = options.cvd or ["deutan"]
    severities = options.severity or [1.0]
    if len(severities) == 1:
        severities = severities * len(types)
    if len(severities) != len(types):
        raise InputError(
            f"{len(severities)} severities for {len(types)} types",
            where="--severity",
            remedy="give one, or one per --cvd",
        )
    layers = tuple(Layer(cvd, severity) for cvd, severity in zip(types, severities, strict=True))
    others = {name: value for name, value in vars(options).items() if name in OPTIONS}
    return Settings(options.capture, options.out, layers, **others)


def given_options(options: argparse.Namespace) -> set[str]:
    """Names of the options that are given, as `run_in_console` takes them."""
    return {name for name in OPTIONS if name in options} | ({LAYERS} if options.cvd or options.severity else set())


def main(arguments: list[str]) -> int:
    """Parse, run, and return the exit code of the contract."""
    try:
        options = parse_options(arguments)
        settings = parse_settings(options)
    except InputError as error:
        print(f"run.py: {error}", file=sys.stderr)
        return 2
    return run_in_console(settings, json_events=options.json, given=given_options(options))


if __name__ == "__main__":
    code = main(script_arguments())
    sys.stdout.flush()
    sys.exit(code)
