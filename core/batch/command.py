"""The command line that does a task, the same for every engine. Standard library only."""

from __future__ import annotations

from ..job import ROOT

SCRIPT = ROOT / "scripts" / "turntable.py"


def task_arguments(plan: str, task: str) -> list[str]:
    """What `SCRIPT` is told to do one task.

    Args:
        plan: the plan's file, as the machine that does the task sees it, or an engine's placeholder for that.
        task: the task's name, or an engine's placeholder for that.
    """
    return ["--plan", plan, "--task", task]
