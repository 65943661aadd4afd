"""`benchmark.py table`: the main table, types and severities, and the seed's protocol."""

from __future__ import annotations

import argparse
import sys

from ...core.console import ConsoleReporter
from ...core.evaluate.evidence.jobs import run_jobs
from ...core.evaluate.evidence.scenes import SHOWROOMS
from ...core.evaluate.evidence.severities import OBSERVERS, severity_jobs, write_severities
from ...core.evaluate.evidence.table import QUICK_ROWS, ROWS, table_jobs, write_table
from ...core.settings import Layer
from .evidence import KNOWN, add_evidence_arguments, chosen_sources, made_by, settled, work_folder, write_text
from .part import Part

SIZE, ITERATIONS, SEEDS = 240, 800, 3
QUICK_OBSERVERS = (Layer("deutan", 1.0), Layer("deutan", 0.4))


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    captures = (*SHOWROOMS, *KNOWN)
    add_evidence_arguments(parser, captures=captures, max_size=SIZE, iterations=ITERATIONS, seeds=SEEDS)


def _measure(options: argparse.Namespace) -> str:
    """Compare modes and enhancers, then observers; writes table.csv, table.md, severities.csv and severities.md."""
    options = settled(options)
    reporter, work, heading = ConsoleReporter(sys.stderr), work_folder(options), made_by(options)
    rows, observers = (QUICK_ROWS, QUICK_OBSERVERS) if options.quick else (ROWS, OBSERVERS)
    sources = chosen_sources(options)
    synthetic = [source for source in sources if source.name not in KNOWN]
    compared = table_jobs(sources, options.iterations, options.seeds, rows)
    observed = severity_jobs(synthetic or sources, options.iterations, observers)
    run_jobs([*compared, *observed], work, reporter, processes=options.processes, again=options.again)
    trials, seen = (run_jobs(jobs, work, reporter, processes=options.processes) for jobs in (compared, observed))
    names = [source.name for source in synthetic]
    table = write_table(options.out, trials, names, heading, rows)
    severities = write_severities(options.out, seen, heading, observers)
    return write_text(options.out / "table.md", table) + "\n" + write_text(options.out / "severities.md", severities)


PART = Part(
    "table", "modes, enhancers and controls on several captures; types and severities", _add_arguments, _measure
)
