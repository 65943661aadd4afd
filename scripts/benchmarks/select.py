"""`benchmark.py select`: the frame filter of Hu and Xiao (2026) on a folder."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from ...core.console import ConsoleReporter
from ...core.evaluate.enhancers.methods import method_factory
from ...core.evaluate.enhancers.scores import ENHANCED_FOR
from ...core.evaluate.selection import measure_selection, read_frames, write_selection
from ...core.settings import Layer
from .part import Part


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("frames", type=Path, metavar="FOLDER", help="photographs in order, or a capture")
    add("--enhancer", default="lut", help="name or weight file (lut)")
    add("--cvd", default="deutan", metavar="TYPE", help="type (deutan)")
    add("--severity", type=float, default=1.0, metavar="0..1")
    add("--max-size", type=int, default=640, metavar="PIXELS", help="longer side of the frames (640)")


def _measure(options: argparse.Namespace) -> str:
    """Select among the frames of a folder; writes selection.csv and selection.md."""
    frames = read_frames(options.frames, options.max_size)
    observer = Layer(options.cvd, options.severity)
    enhancer = method_factory(options.enhancer)(observer.cvd, observer.severity, ENHANCED_FOR)
    return write_selection(
        options.out, measure_selection(frames, enhancer, observer, reporter=ConsoleReporter(sys.stderr))
    )


PART = Part("select", "hard frames and sequences of a folder, and what easy frames keep", _add_arguments, _measure)
