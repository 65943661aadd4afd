"""Turntables of a whole collection: captures or finished runs, each in several layers, from several cameras.

    python scripts/turntable.py BATCH.toml --out DIR [options]
    blender -b -P scripts/turntable.py -- BATCH.toml --out DIR [options]

For example: python scripts/turntable.py --example batch.toml, then python scripts/turntable.py batch.toml --out show

Run again with the same folder, it does what is missing or has changed. DIR/index.html shows the result, DIR/.batch has
a log of every task. Exit codes: 0 all done, 2 unusable batch file or arguments, 3 something has failed (the summary
says what), 130 cancelled, 1 a defect of ours. Needs the standard library only (see core/batch).
"""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
from collections.abc import Iterable
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "core"))
import bootstrap

bootstrap.load()
from cvdgs.core.batch.batch_file import read_batch
from cvdgs.core.batch.console import CHECK_STAGE as INSPECTION
from cvdgs.core.batch.console import check_captures, export, print_answer, print_plan, run_in_console, start_display
from cvdgs.core.batch.example import write_example
from cvdgs.core.batch.plan import make_plan
from cvdgs.core.batch.task import Plan
from cvdgs.core.batch.task_process import run_task_in_console
from cvdgs.core.batch.toml_reader import UnusableFile
from cvdgs.core.errors import Cancelled, InputError, one_line
from cvdgs.core.runtime.cli import OneLineParser, script_arguments
from cvdgs.core.runtime.resources import Resources, this_machine
from cvdgs.core.runtime.supervisor import (
    CANCELLED,
    EXIT_CANCELLED,
    EXIT_DEFECT,
    EXIT_DONE,
    EXIT_INPUT,
    JsonDisplay,
    Listener,
    WorkerDefect,
    cancelled_by_signals,
)

FARMS = ("openjd", "flamenco")


def build_parser() -> argparse.ArgumentParser:
    """The options of docs/batches.md."""
    parser = OneLineParser(
        prog="turntable.py",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    add = parser.add_argument
    add("batch", nargs="?", metavar="BATCH.toml", help="what to render; core/batch/batch_file.py describes the format")
    add("--out", metavar="DIR", help="folder for the results; finished tasks in it are kept")
    add("--dry-run", action="store_true", help="print the tasks and the estimated time; write nothing")
    add("--example", metavar="FILE", help="write a small batch file for the demo capture, and exit")
    add("--json", action="store_true", help="events on stdout, one JSON object per line, instead of a progress bar")
    add("--cores", type=int, metavar="N", help="processor cores that the tasks may use together (all)")
    add("--memory", type=int, metavar="MB", help="main memory that the tasks may use together (all)")
    add("--gpus", type=int, metavar="N", help="graphics cards for training (all)")
    add("--cluster", metavar="tcp://HOST:PORT", help="do the tasks on this Dask cluster; DIR is a shared folder")
    add("--export", choices=FARMS, help="write the plan for a render farm into DIR instead of doing it")
    one = parser.add_argument_group("do one task of a plan, as every engine does")
    one.add_argument("--plan", metavar="FILE", help="DIR/.batch/plan.json")
    one.add_argument("--task", metavar="NAME", help="the task to do")
    one.add_argument("--parent", type=int, metavar="PID", help="end the task when this process ends")
    return parser


def main(arguments: list[str]) -> int:
    """Parse, run, and return the exit code of the contract."""
    as_json = "--json" in arguments
    try:
        options = build_parser().parse_args(arguments)
        if options.plan or options.task:
            _require(options.plan and options.task, "--plan and --task belong together")
            plan_file = Path(options.plan)
            return run_task_in_console(plan_file, options.task, json_events=as_json, parent=options.parent)
        if options.example:
            print_answer(str(write_example(Path(options.example))))
            return EXIT_DONE
        _require(options.batch and options.out, "a batch file and --out are needed")
        _require(not (options.cluster and options.export), "--cluster does what --export only writes: give one")
        return run_batch(options)
    except InputError as error:
        lines = error.lines() if isinstance(error, UnusableFile) else [str(error)]
        complain("input", lines, as_json=as_json)
        return EXIT_INPUT
    except WorkerDefect as error:
        complain("defect", [one_line(str(error))], as_json=as_json)
        return EXIT_DEFECT
    except (Cancelled, KeyboardInterrupt):
        complain("cancelled", [CANCELLED], as_json=as_json)
        return EXIT_CANCELLED


def run_batch(options: argparse.Namespace) -> int:
    """Plan a batch, and print, export or do it; returns the exit code.

    Raises:
        InputError: the batch file or an argument is unusable; nothing was written.
    """
    machine = _machine(options)
    batch_file = Path(options.batch)
    batch = read_batch(batch_file)
    with cancelled_by_signals():
        check_captures(batch, batch_file, _inspection_display(options))
    out = Path(options.out).absolute()
    plan: Plan = make_plan(batch, out, machine.gpus)
    _refuse_inside(plan, [item.source for item in batch.items])
    if options.dry_run:
        print_plan(plan, machine, json_events=options.json)
        return EXIT_DONE
    if options.export:
        return export(plan, options.export, json_events=options.json)
    return run_in_console(plan, machine, cluster=options.cluster, json_events=options.json)


def complain(kind: str, lines: Iterable[str], *, as_json: bool) -> None:
    """Say why the batch was not begun: several lines for what is wrong in several places of a file."""
    for line in lines:
        if as_json:
            with contextlib.suppress(Cancelled):  # nobody reads it
                JsonDisplay(sys.stdout)({"event": "error", "kind": kind, "message": line})
        else:
            print(f"turntable.py: {line}", file=sys.stderr)


def _machine(options: argparse.Namespace) -> Resources:
    for name, low in (("cores", 1), ("memory", 1), ("gpus", 0)):
        value = getattr(options, name)
        if value is not None and value < low:
            raise InputError(f"{value} is too small", where=f"--{name}", remedy=f"give {low} or more")
    return this_machine(options.cores, options.memory, options.gpus)


def _inspection_display(options: argparse.Namespace) -> Listener:
    """Progress while captures are looked at; none where stdout has the answer, which a bar would get into."""
    if (options.dry_run or options.export) and not options.json:
        return lambda _: None
    return start_display(INSPECTION, json_events=options.json)


def _refuse_inside(plan: Plan, sources: list[Path]) -> None:
    """Results inside of what they are made from would make that something else."""
    names = {os.path.realpath(source): source for source in sources}
    written = {plan.out, *(plan.out / Path(output).parent for task in plan.tasks for output in task.outputs)}
    for folder in sorted(written):
        real = Path(os.path.realpath(folder))
        source = next((names[str(place)] for place in (real, *real.parents) if str(place) in names), None)
        if source is not None:
            what = f"results would lie in {source}, which an item is made from"
            remedy = "choose another folder, or call the item otherwise"
            raise InputError(what, where=f"--out {plan.out}", remedy=remedy)


def _require(condition: object, what: str) -> None:
    if not condition:
        raise InputError(what, remedy="see --help")


if __name__ == "__main__":
    code = main(script_arguments())
    sys.stdout.flush()
    sys.exit(code)
