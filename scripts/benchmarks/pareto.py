"""`benchmark.py pareto`: speed against accuracy."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from ...core.console import ConsoleReporter
from ...core.errors import InputError
from ...core.evaluate.studies import peers
from ...core.evaluate.studies.pareto import (
    Default,
    ParetoPoint,
    Variant,
    few_variants,
    measure_variants,
    variants,
    with_fronts,
)
from ...core.evaluate.studies.pareto_page import write_pareto
from ...core.evaluate.studies.scenes import DEMO
from ...core.evaluate.studies.subject import CaptureFolder
from ...core.settings import Settings
from ...cvdgs_addon.quality import QUALITIES
from .options import names
from .part import Part
from .study_options import add_study_arguments, chosen_sources, settled, shown_command, work_folder

SIZE, BASE_STEPS = 480, 600
_UNLIMITED = 640  # of a run whose size is automatic, on the processor
DEFAULTS = {
    **{quality.label.lower(): (quality.iterations, quality.max_size) for quality in QUALITIES},
    "run.py": (Settings.iterations, _UNLIMITED),
}
_NO_DEFAULTS = ("none",)


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    # Times are those of runs that have the machine to themselves.
    add_study_arguments(parser, captures=(DEMO,), max_size=SIZE, iterations=BASE_STEPS, processes=1)
    add, usual = parser.add_argument, tuple(quality.label.lower() for quality in QUALITIES)
    add(
        "--defaults",
        type=names,
        default=usual,
        metavar="A,B",
        help=f"of {', '.join(DEFAULTS)}, none ({','.join(usual)})",
    )
    add("--opensplat", type=Path, metavar="FILE", help="OpenSplat's executable, a peer; minutes for each capture")


def _measure(options: argparse.Namespace) -> str:
    """Try recipes of many lengths and sizes on captures; writes pareto.csv, pareto.md and charts."""
    options = settled(options)
    reporter, work = ConsoleReporter(sys.stderr), work_folder(options)
    points: list[ParetoPoint] = []
    for source in chosen_sources(options):
        tried = [variant for seed in range(options.seeds) for variant in _variants(options, seed)]
        mine = measure_variants(source, tried, work, reporter, processes=options.processes, again=options.again)
        points += with_fronts([*mine, *_measure_peers(source, options, reporter)])
    size = "the judged size" if options.quick else "two thirds the judged size"
    base = f"{options.iterations:,} steps on photographs of {size}"
    return write_pareto(options.out, points, [f"By `{shown_command(options)}`."], base=base, size=options.max_size)


def _variants(options: argparse.Namespace, seed: int) -> list[Variant]:
    chosen = few_variants if options.quick else variants
    return chosen(options.max_size, options.iterations, _defaults(options.defaults), seed)


def _defaults(chosen: Sequence[str]) -> list[Default]:
    if tuple(chosen) == _NO_DEFAULTS:
        return []
    unknown = set(chosen) - set(DEFAULTS)
    if unknown:
        raise InputError(f"no default '{min(unknown)}'", where="--defaults", remedy=f"use {', '.join(DEFAULTS)}, none")
    return [Default(name, *DEFAULTS[name]) for name in chosen]


def _measure_peers(source: CaptureFolder, options: argparse.Namespace, reporter: ConsoleReporter) -> list[ParetoPoint]:
    """Of the programs that were named; not when it has to be quick."""
    if options.quick or not options.opensplat:
        return []
    found = peers.train_opensplat(options.opensplat, source.load(), reporter)
    return [ParetoPoint.of_peer(source.name, options.max_size, peer) for peer in found]


PART = Part(
    "pareto", "speed against accuracy: a chart with its Pareto front, and other programs", _add_arguments, _measure
)
