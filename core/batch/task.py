"""What a batch consists of: tasks with their order, needs and files, and the plan that holds them, as JSON.

    python scripts/turntable.py --plan OUT/.batch/plan.json --task NAME

does one task, for the local pool as for every other engine. A task's `arguments` say what to do;
it is done by a function ``run(task: Task, out: Path, listen: Listener) -> None`` in the module of its kind (see
`run_task`), which

- writes its outputs under temporary names in the folder where they belong, and renames them when they are complete;
- reports its progress to `listen` with the events of ``core/runtime/protocol.py``;
- raises `InputError` for unusable input, `WorkerDefect` for a worker that failed, and lets `Cancelled` pass.

It need not check whether there is anything to do: `run_task` does, and records the outputs afterwards.

Paths in a task are relative to OUT, with forward slashes, so that machines may mount the shared folder anywhere;
captures and finished runs outside of OUT are absolute. Pictures of a sequence are written as ``{0001..0024}``.
Standard library only.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from enum import StrEnum
from pathlib import Path
from typing import Any

from ..bootstrap import ROOT
from ..errors import InputError
from ..files.untrusted import explained, read_json, replacing
from ..runtime.resources import Resources

SCRIPT = ROOT / "scripts" / "turntable.py"
BATCH_FOLDER = ".batch"
PLAN_FILE = "plan.json"
_FORMAT = 1
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")
_RANGE = re.compile(r"\{(\d{1,6})\.\.(\d{1,6})\}")
_PLAN_AGAIN = "run scripts/turntable.py on the batch file again"
_MAX_PLAN_BYTES = 256 << 20  # a hundred thousand tasks


class Kind(StrEnum):
    """What a task does."""

    TRAIN = "train"
    """Trains an item's Gaussians and its layers: a run."""
    LAYER = "layer"
    """Adds a layer to a run that does not have it."""
    FRAMES = "frames"
    """Renders some pictures of a turntable, and what observers see of them."""
    VIDEO = "video"
    """Makes an MP4 of sequences of pictures, side by side where they are several."""
    SHEET = "sheet"
    """Makes an item's contact sheet."""
    PAGE = "page"
    """Makes the page of the whole batch. It shows what is there, so it is made even where an item has failed."""

    @property
    def tolerates_failures(self) -> bool:
        """Whether such a task runs as soon as those before it have ended, however they did."""
        return self is Kind.PAGE


@dataclass(frozen=True)
class Task:
    """One piece of work.

    Attributes:
        name: unique in the plan, and fit for a file name.
        kind: what it does.
        after: names of the tasks that have to be done before.
        arguments: the fields of the dataclass of its kind in `rendering.requests`, ready for JSON.
        inputs: files and folders whose contents it depends on.
        outputs: files that it leaves.
        item: the batch's item that it belongs to; "" for the whole batch.
        seconds: estimate of the time it takes.
        cores: processor cores that it may keep busy.
        memory_mb: main memory that it may need, in MiB.
        gpu: graphics cards that it needs for itself.
    """

    name: str
    kind: Kind
    after: tuple[str, ...] = ()
    arguments: Mapping[str, Any] = field(default_factory=dict)
    inputs: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()
    item: str = ""
    seconds: float = 0.0
    cores: int = 1
    memory_mb: int = 0
    gpu: int = 0

    def __post_init__(self) -> None:
        if not _NAME.fullmatch(self.name):
            raise ValueError(f"'{self.name}' is not a valid task name")
        for path in (*self.outputs, *self._places()):
            parts = path.replace("\\", "/").split("/")
            if os.path.isabs(path) or ".." in parts or ":" in parts[0]:
                raise ValueError(f"the output {path} of '{self.name}' lies outside of the batch's folder")

    def _places(self) -> Iterator[str]:
        """Files and folders that the arguments name for what is made."""
        yield from (self.arguments[name] for name in ("file", "folder") if name in self.arguments)
        yield from self.arguments.get("simulated", {}).values()
        yield self.arguments.get("settings", {}).get("out", "")

    @property
    def resources(self) -> Resources:
        """What it may take of a machine."""
        return Resources(self.cores, self.memory_mb, self.gpu)

    def input_paths(self, out: Path) -> Iterator[Path]:
        """The inputs in the folder `out`, those of a sequence one by one."""
        return (out / name for path in self.inputs for name in expand(path))

    def output_paths(self, out: Path) -> Iterator[Path]:
        """The outputs in the folder `out`, those of a sequence one by one."""
        return (out / name for path in self.outputs for name in expand(path))

    def to_dict(self) -> dict[str, Any]:
        """A JSON-ready dictionary; `from_dict` reads it back."""
        return {**vars(self), "kind": self.kind.value}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Task:
        """The task of `to_dict`.

        Raises:
            ValueError, TypeError, KeyError: it is something else.
        """
        unknown = set(values) - {entry.name for entry in fields(cls)}
        if unknown:
            raise ValueError(f"unknown entries {', '.join(sorted(unknown))}")
        sequences = {name: tuple(values.get(name, ())) for name in ("after", "inputs", "outputs")}
        return cls(**{**values, **sequences, "kind": Kind(values["kind"])})


@dataclass(frozen=True)
class Plan:
    """The tasks of a batch.

    Attributes:
        out: the batch's folder.
        tasks: each after those that it depends on.
        retries: how often a failed task is tried again.
    """

    out: Path
    tasks: tuple[Task, ...]
    retries: int = 1

    def __post_init__(self) -> None:
        known: set[str] = set()
        for task in self.tasks:
            missing = [name for name in task.after if name not in known]
            if missing:
                raise ValueError(f"task '{task.name}' comes before {', '.join(missing)}")
            if task.name in known:
                raise ValueError(f"two tasks are called '{task.name}'")
            known.add(task.name)

    def task(self, name: str) -> Task:
        """The task called `name`.

        Raises:
            InputError: there is none.
        """
        for task in self.tasks:
            if task.name == name:
                return task
        raise InputError(f"no task is called '{name}'", where=plan_path(self.out), remedy=_PLAN_AGAIN)


def plan_path(out: Path) -> Path:
    """Where the plan of the batch in `out` is kept."""
    return out / BATCH_FOLDER / PLAN_FILE


def task_command(python: str, plan: Path, name: str) -> list[str]:
    """The command that does the task called `name`, with JSON events on its stdout; the same for every engine.

    Exit codes: 0 done, 2 unusable input, 130 cancelled, 1 a defect of ours.

    Args:
        python: the interpreter; 3.11 or later.
        plan: the file that `write_plan` wrote.
    """
    return [python, str(SCRIPT), "--plan", str(plan), "--task", name, "--json"]


def expand(path: str) -> Sequence[str]:
    """``a/{0008..0010}.png`` as ``a/0008.png``, ``a/0009.png``, ``a/0010.png``; any other path as it is."""
    found = _RANGE.search(path)
    if found is None or os.path.isabs(path):
        return (path,)
    first, last, digits = int(found[1]), int(found[2]), len(found[1])
    return [f"{path[: found.start()]}{n:0{digits}d}{path[found.end() :]}" for n in range(first, last + 1)]


def write_plan(plan: Plan, folder: str = BATCH_FOLDER) -> Path:
    """Write `plan` into a `folder` of its batch, whole or not at all; returns the file.

    Raises:
        OSError: it cannot be written.
    """
    path = plan.out / folder / PLAN_FILE
    path.parent.mkdir(parents=True, exist_ok=True)
    tasks = ",\n".join(json.dumps(task.to_dict()) for task in plan.tasks)  # a line each, for people
    text = f'{{"format": {_FORMAT}, "retries": {plan.retries}, "tasks": [\n{tasks}\n]}}\n'
    with replacing(path, contested=True) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return path


def read_plan(path: Path) -> Plan:
    """The plan in the file `path`; its folder is the one that the file lies in, wherever that is mounted.

    Raises:
        InputError: there is none, or it is damaged or of another version.
    """
    remedy = _PLAN_AGAIN
    try:
        values = read_json(path, most_bytes=_MAX_PLAN_BYTES, remedy=remedy)
        if values["format"] != _FORMAT:
            raise InputError(f"the plan was made by another version ({values['format']})", where=path, remedy=remedy)
        tasks = tuple(Task.from_dict(task) for task in values["tasks"])
        return Plan(path.absolute().parent.parent, tasks, int(values["retries"]))
    except (ValueError, TypeError, KeyError, AttributeError, OverflowError) as error:
        raise InputError(f"the plan is damaged{explained(error)}", where=path, remedy=remedy) from None
