"""`benchmark.py step`: how long a step of the trainer takes."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from ...core.capture import read_capture
from ...core.console import ConsoleReporter
from ...core.demo import SHOWROOM
from ...core.evaluate.training.training_step import measure_steps, write_steps
from .part import Part

SIZE = 480  # pixels of the longer side


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--capture", type=Path, default=SHOWROOM, help="its views and points (the demo)")
    parser.add_argument("--rounds", type=int, default=5, help="repetitions; their median counts (5)")
    parser.add_argument("--threads", type=int, default=2)


def _measure(options: argparse.Namespace) -> str:
    """Time the step; writes step.csv and step.md."""
    capture = read_capture(options.capture, max_size=SIZE)
    found = measure_steps(capture, options.rounds, options.threads, ConsoleReporter(sys.stderr))
    return write_steps(options.out, capture, found)


PART = Part("step", "how long a whole training step takes, alone and beside other work", _add_arguments, _measure)
