"""`benchmark.py files`: how long many Gaussians and points take in and out of files."""

from __future__ import annotations

import argparse
import sys

from ...core.console import ConsoleReporter
from ...core.evaluate.file_times import time_files, write_file_times
from .part import Part


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("--gaussians", type=int, default=1_000_000, metavar="N", help="in a file (1000000)")
    add("--points", type=int, default=1_000_000, metavar="N", help="of a COLMAP model (1000000)")
    add("--rounds", type=int, default=5, help="repetitions; their medians count (5)")


def _measure(options: argparse.Namespace) -> str:
    """Write and read files, and import one into Blender; writes files.csv and files.md."""
    found = time_files(options.gaussians, options.points, options.rounds, ConsoleReporter(sys.stderr))
    return write_file_times(options.out, options.gaussians, options.points, found)


PART = Part("files", "many Gaussians and points in and out of files, and into Blender", _add_arguments, _measure)
