"""`benchmark.py table`: the main table, types and severities, and the frames of Hu and Xiao (2026)."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from ...core.console import ConsoleReporter
from ...core.evaluate.studies.jobs import run_jobs
from ...core.evaluate.studies.protocol import (
    ENHANCERS,
    filter_frames,
    scenes_of,
    sequences_of,
    summarise,
    write_frames,
)
from ...core.evaluate.studies.recipe import DEUTAN
from ...core.evaluate.studies.scenes import SHOWROOMS
from ...core.evaluate.studies.severities import OBSERVERS, severity_jobs, write_severities
from ...core.evaluate.studies.table import QUICK_ROWS, ROWS, table_jobs, write_table
from ...core.settings import Layer
from .part import Part
from .study_options import add_study_arguments, chosen_sources, made_by, settled, work_folder, write_text

SIZE, ITERATIONS, SEEDS = 240, 800, 3
QUICK_OBSERVERS = (Layer("deutan", 1.0), Layer("deutan", 0.4))


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add_study_arguments(parser, max_size=SIZE, iterations=ITERATIONS, seeds=SEEDS)
    parser.add_argument(
        "--mipnerf360",
        type=Path,
        metavar="DIR",
        help="a scene with images_4/ and sparse/0/, or a folder of such: hard frames, sequences, easy frames apart",
    )


def _measure(options: argparse.Namespace) -> str:
    """Compare modes and enhancers, then observers, then frames; writes .csv and .md of table, severities and frames."""
    options = settled(options)
    reporter, work = ConsoleReporter(sys.stderr), work_folder(options)
    rows, observers = (QUICK_ROWS, QUICK_OBSERVERS) if options.quick else (ROWS, OBSERVERS)
    sources = chosen_sources(options)
    synthetic = [source for source in sources if source.name in SHOWROOMS]
    scenes = scenes_of(options.mipnerf360, options.max_size) if options.mipnerf360 else []
    filtered = [] if options.quick else sources
    frames = {
        source: filter_frames(source, ENHANCERS, DEUTAN, work / "frames", reporter) for source in [*filtered, *scenes]
    }
    sequences = [run for scene in scenes for run in sequences_of(scene, next(iter(frames[scene].values())))]
    compared = table_jobs([*sources, *sequences], options.iterations, options.seeds, rows)
    observed = severity_jobs(synthetic or sources, options.iterations, observers)
    run_jobs([*compared, *observed], work, reporter, processes=options.processes, again=options.again)
    trials, seen = (run_jobs(jobs, work, reporter, processes=options.processes) for jobs in (compared, observed))
    summaries = [
        summarise(source.name, enhancer, found) for source in frames for enhancer, found in frames[source].items()
    ]
    texts = {
        "table": write_table(options.out, trials, [source.name for source in synthetic], made_by(options), rows),
        "severities": write_severities(options.out, seen, made_by(options, seeds=1), observers),
    }
    if summaries:
        texts["frames"] = write_frames(options.out, summaries, made_by(options, trained=False))
    return "\n".join(write_text(options.out / f"{name}.md", lines) for name, lines in texts.items())


PART = Part(
    "table", "modes, enhancers and controls on several captures; types and severities", _add_arguments, _measure
)
