"""`benchmark.py step`: the trainer's step timed beside the prototype's."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from ...core.capture import read_capture
from ...core.console import ConsoleReporter
from ...core.demo import SHOWROOM
from ...core.evaluate.training.step_comparison import compare_steps, write_steps
from .data import FOX, PROTOTYPE
from .part import Part

SIZE = 480  # pixels of the longer side: fox at 270x480, as in the notes


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--capture", type=Path, default=None, help="default: the evaluation data's fox, else the demo")
    parser.add_argument("--prototype", type=Path, default=PROTOTYPE, metavar="DIR")
    parser.add_argument("--rounds", type=int, default=5, help="interleaved repetitions; the medians count (5)")
    parser.add_argument("--threads", type=int, default=2)


def _measure(options: argparse.Namespace) -> str:
    """Time our step and the prototype's by turns; writes step.csv and step.md."""
    capture = read_capture(options.capture or (FOX if FOX.is_dir() else SHOWROOM), max_size=SIZE)
    found = compare_steps(capture, options.prototype, options.rounds, options.threads, ConsoleReporter(sys.stderr))
    return write_steps(options.out, capture, found)


PART = Part("step", "a whole training step against the prototype's loop, in one run", _add_arguments, _measure)
