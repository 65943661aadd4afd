"""Where methods fail as one condition at a time is made worse. Command: ``benchmark.py stress``."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from ....core.demo import SHOWROOM
from ....core.errors import InputError
from ....core.runtime.cli import ConsoleReporter
from ....core.settings import flag
from ..options import Part, add_trial_arguments, filled, leave_open, names, work_folder
from ..provenance import trained_product
from ..studies.captures import DEMO, CaptureFolder
from ..studies.recipe import PLAIN, Recipe
from .axes import AXES, HARMLESS, LEVELS, Axis
from .failure import MOST_LOST, MOST_RWE
from .heat_map import read_standings, write_heat_map
from .page import NAME, write_stress
from .plan import StressPlan, run_stress
from .real import FAR, LEAST_PSNR, real_captures, run_real, write_real
from .real import NAME as REAL_NAME

QUICK_AXES = ("views", "drift")
_OF_CONDITIONS = ("axes", "levels", "processes")  # options that captures of the real world have no use for
_SIZE, _ITERATIONS, _SEEDS = 128, 300, 3
_QUICK_SIZE, _QUICK_ITERATIONS, _QUICK_LEVEL = 80, 60, 3


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    known = ",".join(axis.name for axis in AXES)
    add("--axes", type=names, metavar="A,B", help=f"conditions to make worse ({known})")
    what = f"levels, the harmless one included; the worst are left out ({LEVELS})"
    add("--levels", type=int, default=LEVELS, metavar="N", help=what)
    add_trial_arguments(parser, max_size=_SIZE, iterations=_ITERATIONS, seeds=_SEEDS)
    add("--real", metavar="NAME=PATH,…", help="instead: what run.py makes of captures as people take them; NAME@N=PATH")
    add("--redraw", type=Path, nargs="+", metavar="CSV", help="only draw the picture of these stress.csv again")
    add("--quick", action="store_true", help="two axes, two levels, small and short: a smoke test")
    leave_open(parser, _OF_CONDITIONS)


def _measure(options: argparse.Namespace) -> str:
    """Try the methods on every level; writes stress.csv, stress.md, the charts and stress.html.

    With ``--real``: stress-real.csv and stress-real.md.
    """
    if options.redraw:
        return "\n".join(path.name for path in write_heat_map(options.out, read_standings(options.redraw)))
    reporter = ConsoleReporter(sys.stderr)
    if options.real:
        if given := [name for name in _OF_CONDITIONS if getattr(options, name) is not None]:
            remedy = "leave it out: captures are tried as they are, one after the other"
            raise InputError("it has no meaning with --real", where=flag(given[0]), remedy=remedy)
        captures, how = real_captures(options.real), (options.max_size, options.iterations)
        seeds = options.seeds
        found = run_real(captures, *how, work_folder(options), reporter, seeds=seeds, again=options.again)
        return write_real(options.out, found, *how, seeds)
    options = filled(options)
    plan = _plan(options)
    results = run_stress(plan, work_folder(options), reporter, processes=options.processes, again=options.again)
    return write_stress(options.out, plan, results, processes=options.processes)


def _plan(options: argparse.Namespace) -> StressPlan:
    if options.quick:
        base = CaptureFolder(DEMO, SHOWROOM, _QUICK_SIZE)
        return StressPlan(base, _axes(QUICK_AXES), (HARMLESS, _QUICK_LEVEL), (0,), _QUICK_ITERATIONS)
    if not 2 <= options.levels <= LEVELS:
        raise InputError(f"{options.levels} is out of range", where="--levels", remedy=f"give 2 to {LEVELS}")
    return StressPlan(
        CaptureFolder(DEMO, SHOWROOM, options.max_size),
        _axes(options.axes) if options.axes else AXES,
        tuple(range(options.levels)),
        tuple(range(options.seeds)),
        options.iterations,
    )


def _axes(wanted: tuple[str, ...]) -> tuple[Axis, ...]:
    known = {axis.name: axis for axis in AXES}
    unknown = sorted(set(wanted) - set(known))
    if unknown:
        raise InputError(f"unknown axis '{unknown[0]}'", where="--axes", remedy=f"use {', '.join(known)}")
    return tuple(known[name] for name in wanted)


PART = Part(
    "stress",
    "where methods fail: views, cameras, light, cloth, drift and more made worse",
    _add_arguments,
    _measure,
    pages=(f"{NAME}.md", f"{REAL_NAME}.md"),
    shaped_by=lambda: (*trained_product(), PLAIN, Recipe("any"), AXES, MOST_LOST, MOST_RWE, LEAST_PSNR, FAR),
)
