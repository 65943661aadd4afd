"""`benchmark.py trainer`: the trainer's tables."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from ...core.capture import read_capture
from ...core.console import ConsoleReporter
from ...core.demo import SHOWROOM
from ...core.errors import InputError
from ...core.evaluate.training import comparisons
from .options import names
from .part import Part

TABLES = ("time", "auto", "strategies", "seeds")
SIZE = 480  # pixels of the longer side


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("--of", type=names, default=TABLES, metavar="A,B", help=f"tables ({','.join(TABLES)})")
    add("--capture", type=Path, action="append", help="may be given again (the demo)")
    add("--max-size", type=int, default=SIZE, metavar="PIXELS", help=f"longer side of the views ({SIZE})")
    add("--iterations", type=int, default=5000, metavar="N", help="of automatic runs, beside a third of it (5000)")
    add("--strategy-iterations", type=int, default=2000, metavar="N", help="of the strategies and seeds (2000)")
    add("--rounds", type=int, default=3, help="repetitions of the time to a quality (3)")
    add("--seeds", type=int, default=5)
    add("--threads", type=int, default=2)


def _measure(options: argparse.Namespace) -> str:
    """Train captures in several ways; writes a table for each question. The first capture is timed and reseeded."""
    unknown = set(options.of) - set(TABLES)
    if unknown:
        raise InputError(f"no table '{min(unknown)}'", where="--of", remedy=f"use {', '.join(TABLES)}")
    reporter, out = ConsoleReporter(sys.stderr), options.out
    folders = options.capture or [SHOWROOM]
    captures = [read_capture(folder, max_size=options.max_size, reporter=reporter) for folder in folders]
    comparisons.warm_up()
    texts = []
    if "time" in options.of:
        found = comparisons.time_to_quality(captures[0], options.rounds, options.threads, reporter)
        texts.append(comparisons.write_time_to_quality(out, captures[0], found))
    if "auto" in options.of:
        steps = (options.iterations, options.iterations // 3)
        runs = [run for capture in captures for run in comparisons.automatic_runs(capture, steps, reporter)]
        texts.append(comparisons.write_automatic_runs(out, runs))
    if "strategies" in options.of:
        steps = options.strategy_iterations
        runs = [run for capture in captures for run in comparisons.compare_strategies(capture, steps, reporter)]
        texts.append(comparisons.write_strategies(out, runs))
    if "seeds" in options.of:
        seeds = comparisons.compare_seeds(captures[0], options.strategy_iterations, options.seeds, reporter)
        texts.append(comparisons.write_seeds(out, seeds))
    return "\n".join(texts)


PART = Part("trainer", "time to a quality, automatic decisions, strategies, seeds", _add_arguments, _measure)
