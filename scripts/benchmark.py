"""Measures the product's own code and writes tables: python scripts/benchmark.py PART --out DIR [options]."""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

os.environ.setdefault("OMP_WAIT_POLICY", "passive")  # before torch is loaded: as in the runs that are measured
sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "core"))
import bootstrap

bootstrap.load(modules=("torch", "warp", "OpenImageIO", "pandas"))
from cvdgs.core.runtime.cli import OneLineParser, exit_code
from cvdgs.scripts.benchmarks import stale
from cvdgs.scripts.benchmarks.parts import MEASURING

PARTS = (*MEASURING, stale.PART)


def main(arguments: list[str]) -> int:
    """Run one part and return the exit code."""

    def work() -> None:
        options = build_parser().parse_args(arguments)
        options.out.mkdir(parents=True, exist_ok=True)
        print(options.measure(options))

    return exit_code("benchmark.py", work)


def build_parser() -> argparse.ArgumentParser:
    """The parser, with a subcommand for each part."""
    parser = OneLineParser(prog="benchmark.py", description=__doc__)
    subparsers = parser.add_subparsers(dest="part", required=True, metavar="PART")
    for part in PARTS:
        subparser = subparsers.add_parser(part.name, help=part.summary)
        subparser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for the tables")
        part.add_arguments(subparser)
        subparser.set_defaults(measure=part.run)
    return parser


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
