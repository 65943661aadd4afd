"""A plan as a job of Flamenco, Blender's render farm, and the job type that it needs. Standard library only.

Flamenco turns a job into tasks by a script of its type (https://flamenco.blender.org/usage/job-types/). Ours is the
same for every batch, `flamenco_job_type.js`; what differs stands in the job's settings, as its API takes them (schemas
SubmittedJob and AvailableJobSetting of pkg/api/flamenco-openapi.yaml in Flamenco's sources). Workers run the tasks with
their command "exec" (internal/worker/command_exec.go), which they have from Flamenco 3.3 on:

    cp OUT/flamenco/cvdgs-turntables.js FLAMENCO/scripts/        # once, then restart the Manager
    curl -H "Content-Type: application/json" -d @OUT/flamenco/job.json http://MANAGER:8080/api/v3/jobs

A task starts when those that it waits for are completed. Where an item fails, Flamenco therefore makes no page;
scripts/turntable.py with the same batch and folder does what is missing, the page included.
"""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path
from typing import Any

from .task import PLAN_FILE, SCRIPT, Plan, Task, write_plan

FOLDER = "flamenco"
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
    folder = plan.out / FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(_SCRIPT_OF_THE_TYPE, folder / f"{JOB_TYPE}.js")
    # A submitted job keeps the plan that it was made from, whatever is planned in the meantime.
    shutil.copyfile(write_plan(plan), folder / PLAN_FILE)
    job = submitted_job(plan, folder / PLAN_FILE)
    (folder / JOB_FILE).write_text(json.dumps(job, indent=1) + "\n", encoding="utf-8")
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
