"""A plan as an Open Job Description bundle, for render farms that take such jobs. Standard library only.

    openjd run OUT/openjd/template.json

runs it here; a farm takes the folder OUT/openjd, in which the template and the plan lie. The format is the Job Template
of https://github.com/OpenJobDescription/openjd-specifications (version 2023-09, without extensions). There a job
consists of steps, a step runs one command for each value of its parameter, and steps depend on whole steps. So tasks
that wait for the same tasks and need the same of a machine become one step: a turntable's chunks of frames.

A step starts when those that it depends on have succeeded. Where an item fails, a farm therefore makes no page;
scripts/turntable.py with the same batch and folder does what is missing, the page included.
"""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from ..files.untrusted import replacing
from .task import PLAN_FILE, SCRIPT, Plan, Task, task_command, write_plan

FOLDER = "openjd"
TEMPLATE_FILE = "template.json"

# Limits of the specification without extensions.
_JOB_NAME_CHARACTERS = 128
_STEP_NAME_CHARACTERS = 64
_VALUES_OF_A_PARAMETER = 1024

_NOTICE_SECONDS = 10  # for a cancelled task to end its workers, which takes it little more than a second


def export_openjd(plan: Plan) -> Path:
    """Write the bundle of `plan` into its folder, in place of an earlier one.

    Returns:
        The template, which ``openjd run`` takes as it is.

    Raises:
        OSError: it cannot be written.
    """
    # A submitted job keeps the plan that it was made from, whatever is planned and done here in the meantime.
    template = write_plan(plan, FOLDER).with_name(TEMPLATE_FILE)
    _write_json(template, job_template(plan))
    return template


def _write_json(path: Path, document: Mapping[str, Any]) -> None:
    with replacing(path) as temporary:
        temporary.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")


def job_template(plan: Plan) -> dict[str, Any]:
    """The Job Template of `plan`."""
    steps = list(_steps(plan.tasks))
    names = {task.name: name for name, tasks in steps for task in tasks}
    return {
        "specificationVersion": "jobtemplate-2023-09",
        "name": f"cvdgs turntables {plan.out.name}"[:_JOB_NAME_CHARACTERS],
        "parameterDefinitions": [
            {
                "name": "Plan",
                "type": "PATH",
                "objectType": "FILE",
                "dataFlow": "IN",
                "default": PLAN_FILE,  # relative to the template
                "description": "The batch's plan, in the folder that all machines share.",
            },
            {
                "name": "Python",
                "type": "STRING",
                "default": sys.executable,
                "description": "A Python 3.11 or later on the machines that do the tasks.",
            },
            {
                "name": "Script",
                "type": "STRING",
                "default": str(SCRIPT),
                "description": "scripts/turntable.py of cvdgs on the machines that do the tasks.",
            },
        ],
        "steps": [_step(name, tasks, names) for name, tasks in steps],
    }


def _steps(tasks: Sequence[Task]) -> Iterator[tuple[str, list[Task]]]:
    """Names of steps and their tasks.

    Tasks of a step wait for the same tasks, so no chain of dependencies leads from a step back to itself.
    """
    alike: dict[tuple[Any, ...], list[Task]] = {}
    for task in tasks:
        needs = (task.cores, task.memory_mb, task.gpu)
        alike.setdefault((task.item, task.kind, frozenset(task.after), needs), []).append(task)
    number = 0
    for group in alike.values():
        for first in range(0, len(group), _VALUES_OF_A_PARAMETER):
            number += 1
            name = f"{number} {group[0].kind} {group[0].item}".rstrip()
            yield name[:_STEP_NAME_CHARACTERS], group[first : first + _VALUES_OF_A_PARAMETER]


def _step(name: str, tasks: Sequence[Task], step_names: Mapping[str, str]) -> dict[str, Any]:
    python, _, *options = task_command("{{Param.Python}}", Path("{{Param.Plan}}"), "{{Task.Param.Task}}")
    run = {
        "command": python,
        "args": ["{{Param.Script}}", *options],
        "cancelation": {"mode": "NOTIFY_THEN_TERMINATE", "notifyPeriodInSeconds": _NOTICE_SECONDS},
    }
    parameter = {"name": "Task", "type": "STRING", "range": [task.name for task in tasks]}
    step: dict[str, Any] = {
        "name": name,
        "parameterSpace": {"taskParameterDefinitions": [parameter]},
        "hostRequirements": {"amounts": list(_amounts(tasks[0]))},
        "script": {"actions": {"onRun": run}},
    }
    before = dict.fromkeys(step_names[earlier] for earlier in tasks[0].after)
    if before:
        step["dependencies"] = [{"dependsOn": earlier} for earlier in before]
    return step


def _amounts(task: Task) -> Iterator[dict[str, Any]]:
    """What the machine must have, in the units of section 3.3.1.1: cores, MiB and cards."""
    yield {"name": "amount.worker.vcpu", "min": task.cores}
    if task.memory_mb:
        yield {"name": "amount.worker.memory", "min": task.memory_mb}
    if task.gpu:
        yield {"name": "amount.worker.gpu", "min": task.gpu}


FLAMENCO_FOLDER = "flamenco"
JOB_TYPE = "cvdgs-turntables"
JOB_FILE = "job.json"

_SCRIPT_OF_THE_TYPE = Path(__file__).with_name("flamenco_job_type.js")
_PRIORITY = 50  # Flamenco's own default
_PLATFORMS = {"win32": "windows"}  # as Flamenco calls what Python calls otherwise


def export_flamenco(plan: Plan) -> Path:
    """Write the job type and the job of `plan` into its folder, in place of earlier ones.

    Returns:
        The folder with both.

    Raises:
        OSError: they cannot be written.
    """
    plan_file = write_plan(plan, FLAMENCO_FOLDER)  # of its own, as above
    folder = plan_file.parent
    shutil.copyfile(_SCRIPT_OF_THE_TYPE, folder / f"{JOB_TYPE}.js")
    _write_json(folder / JOB_FILE, submitted_job(plan, plan_file))
    return folder


def submitted_job(plan: Plan, plan_file: Path) -> dict[str, Any]:
    """The job as ``POST /api/v3/jobs`` takes it.

    Args:
        plan: the batch's.
        plan_file: where it is kept, under a path that the workers know or that a two-way variable of the Manager maps.
    """
    return {
        "name": f"turntables {plan.out.name}",
        "type": JOB_TYPE,
        "priority": _PRIORITY,
        "submitter_platform": _PLATFORMS.get(sys.platform, sys.platform),
        "settings": {
            "plan": str(plan_file.absolute()),
            "python": sys.executable,
            "script": str(SCRIPT),
            "tasks": json.dumps([_entry(task) for task in plan.tasks]),
        },
    }


def _entry(task: Task) -> dict[str, Any]:
    """What the job type has to know of a task."""
    return {"name": task.name, "kind": task.kind.value, "gpu": task.gpu, "after": list(task.after)}
