"""`benchmark.py modes`: the modes of a run side by side."""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

from ...core.capture import read_capture
from ...core.console import ConsoleReporter
from ...core.demo import SHOWROOM
from ...core.evaluate.enhancers.methods import method_factory
from ...core.evaluate.enhancers.scores import ENHANCED_FOR
from ...core.evaluate.modes import PerViewLut, compare_modes, write_modes
from ...core.settings import Layer, Settings
from ...core.splats import raster
from .data import FOX
from .options import names
from .part import Part

PER_VIEW = "lut-per-view"  # a LUT of its own for each image


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("--capture", type=Path, action="append", help="beside the demo; may be given again (the evaluation data's fox)")
    add("--enhancers", type=names, default=(PER_VIEW, "cgan"), metavar="A,B", help=f"({PER_VIEW},cgan)")
    add("--max-size", type=int, default=320, metavar="PIXELS", help="longer side of the views (320)")
    add("--iterations", type=int, default=1000, metavar="N", help="of the geometry (1000)")


def _measure(options: argparse.Namespace) -> str:
    """Run every mode for a deutan on the demo and other captures; writes modes.csv and modes.md."""
    reporter = ConsoleReporter(sys.stderr)
    captures = options.capture if options.capture is not None else [FOX] if FOX.is_dir() else []
    raster.load("cpu", reporter)
    layer, rows = Layer("deutan", 1.0), []
    for folder in [SHOWROOM, *captures]:
        capture = read_capture(folder, max_size=options.max_size, reporter=reporter)
        for name in options.enhancers:
            make = PerViewLut if name == PER_VIEW else method_factory(name)
            enhancer = make(layer.cvd, layer.severity, ENHANCED_FOR)
            with tempfile.TemporaryDirectory() as scratch:
                settings = Settings(
                    str(folder), scratch, layers=(layer,), iterations=options.iterations, simulation=ENHANCED_FOR
                )
                rows += compare_modes(capture, settings, enhancer, name, Path(scratch), reporter)
    return write_modes(options.out, rows)


PART = Part("modes", "layers, joint and post: contrast, view consistency and time", _add_arguments, _measure)
