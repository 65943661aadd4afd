"""A batch on the console: the plan, progress, the summary, exit codes. Standard library only."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from ..errors import InputError
from ..runtime.process import Event, Workers
from ..runtime.progress import RunProgress, format_seconds
from ..runtime.resources import Resources
from ..runtime.supervisor import EXIT_DONE, BarDisplay, JsonDisplay, Listener, finish, in_console, lead_nowhere
from ..settings import AUTO, ESTIMATE
from .local_pool import alone, run_locally
from .model import Batch
from .progress import estimated_seconds, measured_pace
from .records import is_done
from .scheduler import STAGE, BatchOutcome, summary
from .task import Plan, Task, write_plan
from .toml_reader import UnusableFile

_CANCELLED = "cancelled; finished tasks are kept, and the same command continues from there"


def run_in_console(plan: Plan, machine: Resources, *, cluster: str | None = None, json_events: bool) -> int:
    """Do `plan` with progress on the console; returns the exit code of the contract.

    Args:
        machine: this one, as far as the batch may use it.
        cluster: address of a Dask scheduler that does the tasks instead.
        json_events: write the events to stdout as JSON lines instead of a progress bar on stderr.
    """
    outcomes: list[BatchOutcome] = []

    def work(listen: Listener) -> Event:
        try:
            with alone(plan):
                write_plan(plan)
                outcomes.append(_run_on(cluster, plan, listen) if cluster else run_locally(plan, machine, listen))
        except OSError as error:
            raise _unwritable(plan, error) from None
        return outcomes[0].to_event()

    code = in_console(work, start_display(STAGE, json_events=json_events), cancelled=lambda: _CANCELLED)
    return outcomes[0].exit_code if code == EXIT_DONE else code


def start_display(stage: str, *, json_events: bool) -> Listener:
    """Shows events of `stage`: as JSON lines on stdout, or as a progress bar on stderr."""
    if json_events:
        return JsonDisplay(sys.stdout)
    return BarDisplay(sys.stderr, "turntable.py", RunProgress((stage,), expected={stage: 1.0}), summary)


def _run_on(cluster: str, plan: Plan, listen: Listener) -> BatchOutcome:
    from .dask import run_on_cluster  # Dask is there where the extra "farm" was asked for

    return run_on_cluster(plan, cluster, listen)


def export(plan: Plan, farm: str, *, json_events: bool) -> int:
    """Write `plan` for a render farm, "openjd" or "flamenco", and say where; returns the exit code.

    Args:
        json_events: say it as an event.

    Raises:
        InputError: it cannot be written, or the answer cannot.
    """
    from .export import export_flamenco, export_openjd

    try:
        job = {"openjd": export_openjd, "flamenco": export_flamenco}[farm](plan)
    except OSError as error:
        raise _unwritable(plan, error) from None
    event = {"event": "result", "out": str(plan.out), "job": str(job)}
    print_answer(json.dumps(event) if json_events else str(job))
    return EXIT_DONE


def print_plan(plan: Plan, machine: Resources, *, json_events: bool) -> None:
    """Print the tasks and how long they may take on `machine`.

    Raises:
        InputError: the disk that stdout leads to is full.
    """
    print_answer("\n".join(_plan_lines(plan, machine, json_events=json_events)))


def print_answer(text: str) -> None:
    """Print on stdout what was asked for.

    Raises:
        InputError: the disk that stdout leads to is full.
    """
    try:
        print(text, flush=True)
    except OSError as error:
        lead_nowhere(sys.stdout)
        if not isinstance(error, BrokenPipeError):  # whoever reads the beginning alone (``| head``) has had it
            what = f"cannot be written ({error.strerror})"
            raise InputError(what, where="stdout", remedy="free space, or choose another file") from None


def _plan_lines(plan: Plan, machine: Resources, *, json_events: bool) -> Iterator[str]:
    done = done_tasks(plan)
    pace = measured_pace(plan.tasks, plan.out)
    seconds = estimated_seconds(plan, machine, pace, done)
    if json_events:
        tasks = [{**task.to_dict(), "done": task.name in done} for task in plan.tasks]
        yield json.dumps({"event": "result", "out": str(plan.out), "seconds": round(seconds, 1), "tasks": tasks})
        return
    width = max((len(task.name) for task in plan.tasks), default=0)
    for task in plan.tasks:
        estimate = task.seconds * pace.get(task.kind, 1.0)
        state = "done" if task.name in done else format_seconds(estimate).rjust(7)
        yield f"{task.name:<{width}}  {task.kind:<6}  {state:>7}  {_described_needs(task)}".rstrip()
    to_do = len(plan.tasks) - len(done)
    has = f"{machine.cores} cores, {machine.memory_mb} MiB" + (f", {machine.gpus} GPUs" if machine.gpus else "")
    yield f"{to_do} of {len(plan.tasks)} tasks to do, about {format_seconds(seconds)} on this machine ({has})"


def done_tasks(plan: Plan) -> set[str]:
    """Names of the tasks that need not be done again: those that are done, as is everything before them."""
    done: set[str] = set()
    for task in plan.tasks:
        if done.issuperset(task.after) and is_done(task, plan.out):
            done.add(task.name)
    return done


def _described_needs(task: Task) -> str:
    needs: Sequence[str] = [f"{task.cores} core" + ("s" if task.cores > 1 else ""), f"{task.memory_mb} MiB"]
    return ", ".join([*needs, *([f"{task.gpu} GPU"] if task.gpu else [])])


def _unwritable(plan: Plan, error: OSError) -> InputError:
    remedy = "free space or choose another folder with --out"
    return InputError(f"cannot be written to ({error.strerror})", where=plan.out, remedy=remedy)


CHECK_STAGE = "check"


def check_captures(batch: Batch, path: Path, listen: Listener) -> None:
    """Make sure that every capture of `batch`, which the file `path` describes, can be read.

    Raises:
        UnusableFile: with what is wrong with each of them, photographs' pixels aside.
        InputError: there is no Python that could train.
        WorkerDefect: the worker failed.
    """
    places = [place for place, item in enumerate(batch.items) if item.capture is not None]
    if not places:
        return
    items = [batch.items[place] for place in places]
    captures = [{"capture": str(item.capture), "cameras": _cameras_of(item.train)} for item in items]
    message = f"checking {len(captures)} capture{'s' if len(captures) > 1 else ''}"
    listen({"event": "status", "stage": CHECK_STAGE, "message": message})
    request = {"job": "inspect-all", "captures": captures}
    refusals = finish(Workers().start(request, _log), listen)["refusals"]
    found = zip(places, refusals, strict=True)
    problems = [f"items[{place + 1}].capture: {refusal}" for place, refusal in found if refusal]
    if problems:
        raise UnusableFile(path, problems)


def _cameras_of(train: Mapping[str, Any]) -> str:
    return ESTIMATE if train.get("sfm") else str(train.get("cameras", AUTO))


def _log(line: str) -> None:
    print(line, file=sys.stderr)
