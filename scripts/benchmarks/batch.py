"""`benchmark.py batch`: what batches of turntables cost."""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

from ...core.console import ConsoleReporter
from ...core.evaluate.batch import BatchBenchmark, write_batch_figures
from .part import Part


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--run", type=Path, default=Path("out/demo"), help="a finished run (out/demo)")
    parser.add_argument("--frames", type=int, default=16, metavar="N", help="of a turn, in chunks of four (16)")
    parser.add_argument("--rounds", type=int, default=3, help="repetitions; the medians count (3)")


def _measure(options: argparse.Namespace) -> str:
    """Render turntables of a run in several ways; writes batch.csv and batch.md."""
    with tempfile.TemporaryDirectory(prefix="cvdgs-batch-") as folder:
        benchmark = BatchBenchmark(options.run, Path(folder), frames=options.frames, rounds=options.rounds)
        return write_batch_figures(options.out, benchmark.measure(ConsoleReporter(sys.stderr)))


PART = Part(
    "batch", "batches of turntables: workers, frames, kills, a thousand items, engines", _add_arguments, _measure
)
