"""`benchmark.py enhancer`: enhancers on single images."""

from __future__ import annotations

import argparse
import sys
from typing import Any

from ...core.console import ConsoleReporter
from ...core.evaluate.enhancers.benchmark import EnhancerBenchmark
from .options import named_path, names, numbers
from .part import Part

ALL_ENHANCERS = ("none", "gain", "fidaner", "lut", "cgan")
QUICK: dict[str, Any] = {
    "types": ("protan", "deutan"),
    "severities": (1.0,),
    "size": 256,
    "plates": 10,
    "textiles": 6,
    "most_photographs": 6,
    "other_models": False,
    "trade_off": False,
}
"""What `--quick` measures: enough to steer a training by, in less than a minute without the LUT."""


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add, usual = parser.add_argument, EnhancerBenchmark(methods=())
    add(
        "--enhancers",
        type=names,
        default=ALL_ENHANCERS,
        metavar="A,B",
        help="names or weight files",
    )
    add(
        "--images",
        type=named_path,
        action="append",
        default=[],
        metavar="NAME=FOLDER",
        help="photographs, beside plates and textiles; may be given again",
    )
    add("--cvd", type=names, dest="types", metavar="A,B", help=f"types ({','.join(usual.types)})")
    add("--severity", type=numbers, dest="severities", metavar="A,B", help="severities (0.4,0.7,1)")
    add("--size", type=int, metavar="PIXELS", help=f"longer side of the images ({usual.size})")
    add("--plates", type=int, metavar="N", help=f"for each type ({usual.plates})")
    add("--textiles", type=int, metavar="N", help=f"in all ({usual.textiles})")
    add("--processes", type=int, default=1, metavar="N", help="that share the work (1)")
    add("--quick", action="store_true", help="fewer and smaller images, protan and deutan 1.0, Machado alone")


def _measure(options: argparse.Namespace) -> str:
    """Compare enhancers; writes enhancer.csv, enhancer.md, the trade-off and contact sheets."""
    asked = {name: getattr(options, name) for name in ("types", "severities", "size", "plates", "textiles")}
    asked = {name: value for name, value in asked.items() if value is not None}
    usual = QUICK if options.quick else {}
    benchmark = EnhancerBenchmark(
        options.enhancers, dict(options.images), processes=options.processes, **{**usual, **asked}
    )
    return benchmark.run(options.out, ConsoleReporter(sys.stderr))


PART = Part("enhancer", "enhancers compared on photographs, plates and textiles", _add_arguments, _measure)
