"""`benchmark.py display`: Blender's picture of a run beside ours, and how long it takes for it."""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

from ...core.console import ConsoleReporter
from ...core.evaluate.display import display_fidelity
from ...core.evaluate.still_times import StillTimes
from ...core.settings import ENGINES
from .part import Part


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--run", type=Path, default=Path("out/demo"), help="a finished run (out/demo)")
    parser.add_argument("--view", default="view_016", help="its held-out view (view_016)")
    parser.add_argument("--gaussians", type=int, default=20_000, metavar="N", help="in stills that are timed (20000)")
    parser.add_argument(
        "--engine", choices=ENGINES, default=ENGINES[0], help=f"of stills that are timed ({ENGINES[0]})"
    )
    parser.add_argument("--rounds", type=int, default=3, help="that stills are timed; the medians count (3)")


def _measure(options: argparse.Namespace) -> str:
    """Render one view of a run through Blender, for what it shows and how long it takes; writes display.md."""
    with tempfile.TemporaryDirectory() as scratch:
        found = display_fidelity(options.run, options.view, Path(scratch))
    lines = [f"Cycles against our rasteriser, {options.run.name}, {options.view}, original colours:", ""]
    lines += [f"- {display}: {value:.1f} dB" for display, value in found.items()]
    settings = {"gaussians": options.gaussians, "rounds": options.rounds, "engine": options.engine}
    times = StillTimes(options.run, options.view, **settings)
    text = "\n".join([*lines, "", times.measure(ConsoleReporter(sys.stderr))])
    (options.out / "display.md").write_text(text, encoding="utf-8")
    return text


PART = Part("display", "Blender on a finished run: against our rasteriser, and its time", _add_arguments, _measure)
