"""`benchmark.py budget`: how many Gaussians scenes need."""

from __future__ import annotations

import argparse
import sys

from ...core.console import ConsoleReporter
from ...core.errors import InputError
from ...core.evaluate.studies.budget import FEW_HALF_DOUBLINGS, HALF_DOUBLINGS, measure_budgets
from ...core.evaluate.studies.budget_page import write_budget
from .part import Part
from .study_options import add_study_arguments, chosen_sources, made_by, settled, work_folder

SIZE, ITERATIONS = 240, 1000


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add_study_arguments(parser, max_size=SIZE, iterations=ITERATIONS)


def _measure(options: argparse.Namespace) -> str:
    """Train captures with automatic and fixed numbers of Gaussians; writes budget.csv, budget.md and a chart."""
    options = settled(options)
    if options.seeds != 1:
        raise InputError("budgets are compared within one seed", where="--seeds", remedy="leave it out")
    runs = measure_budgets(
        chosen_sources(options),
        options.iterations,
        FEW_HALF_DOUBLINGS if options.quick else HALF_DOUBLINGS,
        work_folder(options),
        ConsoleReporter(sys.stderr),
        processes=options.processes,
        again=options.again,
    )
    return write_budget(options.out, runs, made_by(options))


PART = Part(
    "budget",
    "PSNR, consistency and contrast over the number of Gaussians, and where auto stops",
    _add_arguments,
    _measure,
)
