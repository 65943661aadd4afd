"""`benchmark.py all`: every study with its own defaults, and what has to hold in any case."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from ...core.console import ConsoleReporter
from ...core.demo import SHOWROOM
from ...core.evaluate.studies.claims import measure_claims, write_claims
from ...core.evaluate.studies.scenes import DEMO
from ...core.evaluate.studies.subject import CaptureFolder
from . import ablation, budget, figure, pareto, stress, table
from .part import Part
from .study_options import QUICK

STUDIES = tuple(module.PART for module in (table, pareto, budget, stress, ablation, figure))


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("--work", type=Path, metavar="DIR", help="for scenes, pictures and what lets a run go on (OUT/work)")
    add("--quick", action="store_true", help="the demo alone, small and short: whether it works at all")


def _measure(options: argparse.Namespace) -> str:
    """Measure everything; writes what the parts write, claims.csv and claims.md. Ends with 1 where a claim fails."""
    work = options.work or options.out / "work"
    texts = [part.measure(options_of(part, options, work)) for part in STUDIES]
    source = CaptureFolder(DEMO, SHOWROOM, QUICK["max_size"])
    claims = measure_claims(source, QUICK["iterations"], work, ConsoleReporter(sys.stderr))
    texts.append(write_claims(options.out, claims, ["By `python scripts/benchmark.py all`."]))
    failed = [claim.statement for claim in claims if not claim.holds]
    if failed:
        raise SystemExit(f"{texts[-1]}\nbenchmark.py: does not hold: {'; '.join(failed)}")
    return "\n".join(texts)


def options_of(part: Part, options: argparse.Namespace, work: Path) -> argparse.Namespace:
    """What a part is asked for: its own defaults, in these places."""
    parser = argparse.ArgumentParser()
    part.add_arguments(parser)
    arguments = ["--work", str(work), *(["--quick"] if options.quick else [])]
    return argparse.Namespace(**vars(parser.parse_args(arguments)), out=options.out, part=part.name)


PART = Part("all", "every study, and what has to hold of it", _add_arguments, _measure)
