"""`benchmark.py drift`: the view consistency of enhanced photographs."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from ...core.capture import read_capture
from ...core.console import ConsoleReporter
from ...core.demo import SHOWROOM
from ...core.evaluate.drift import RECONSTRUCTION_STEPS, cached_matches, measure_drift, write_drift
from ...core.settings import Layer
from .options import names
from .part import Part


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("--capture", type=Path, action="append", help="beside the demo; may be given again")
    add("--enhancers", type=names, default=("none", "lut"), metavar="A,B", help="names or weight files (none,lut)")
    add("--cvd", type=names, default=("deutan",), metavar="A,B", help="types (deutan)")
    add("--severity", type=float, default=1.0, metavar="0..1")
    add("--max-size", type=int, default=480, metavar="PIXELS", help="longer side of the views (480)")
    add("--steps", type=int, default=RECONSTRUCTION_STEPS, help=f"of the reconstruction ({RECONSTRUCTION_STEPS})")


def _measure(options: argparse.Namespace) -> str:
    """Measure drift on the demo and other captures; writes drift.csv and drift.md, keeps correspondences as .npz."""
    reporter = ConsoleReporter(sys.stderr)
    observers = [Layer(cvd, options.severity) for cvd in options.cvd]
    rows = []
    for folder in [SHOWROOM, *(options.capture or [])]:
        capture = read_capture(folder, max_size=options.max_size, reporter=reporter)
        matches = cached_matches(options.out, capture, options.steps, reporter)
        rows += measure_drift(capture, matches, options.enhancers, observers, reporter)
    return write_drift(options.out, rows)


PART = Part("drift", "how much enhanced views contradict each other before reconstruction", _add_arguments, _measure)
