"""`benchmark.py ablation`: what each part of the method contributes."""

from __future__ import annotations

import argparse
import sys

from ...core.console import ConsoleReporter
from ...core.evaluate.studies.ablation import ablation_jobs, write_ablation
from ...core.evaluate.studies.jobs import run_jobs
from .options import named_path
from .part import Part
from .study_options import add_study_arguments, chosen_sources, made_by, settled, work_folder, write_text

SIZE, ITERATIONS = 240, 600


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add_study_arguments(parser, max_size=SIZE, iterations=ITERATIONS)
    parser.add_argument(
        "--weights",
        type=named_path,
        action="append",
        metavar="NAME=FILE",
        help="a further network, with another norm for example; may be given again",
    )


def _measure(options: argparse.Namespace) -> str:
    """Leave out one part after the other; writes ablation.csv and ablation.md."""
    options = settled(options)
    weights = dict(options.weights or ())
    jobs = ablation_jobs(chosen_sources(options), options.iterations, options.seeds, weights)
    reporter = ConsoleReporter(sys.stderr)
    trials = run_jobs(jobs, work_folder(options), reporter, processes=options.processes, again=options.again)
    lines = write_ablation(options.out, trials, made_by(options), weights)
    return write_text(options.out / "ablation.md", lines)


PART = Part("ablation", "what each part of the method contributes", _add_arguments, _measure)
