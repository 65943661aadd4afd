"""Records of finished tasks: what each was made from and what it wrote. Standard library only.

    OUT/.batch/done/TASK.json    {"fingerprint": "...", "seconds": 12.3, "inputs": {...}, "outputs": {...}}

The fingerprint is that of the task's kind, its arguments and the product's version. Contents of inputs are compared by
their SHA-256, but read only where size or time of change differ from the record's, as version control does. The record
is written last, when the outputs are on the disk, so whatever happens before makes the task be done again.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ... import __version__
from ..capture.files import files_of_a_capture
from ..errors import InputError
from ..files.untrusted import is_file, read_json, replacing
from ..runs.report import CAMERAS
from .task import BATCH_FOLDER, Kind, Task

DONE_FOLDER = "done"
_FORMAT = 1
# Arguments that make no other result: a run with further layers stays the run that it is.
_INCIDENTAL = {Kind.TRAIN: ("layers",)}

Signatures = Mapping[str, tuple[Any, ...]]
"""By path: size in bytes, time of change in ns, and SHA-256 of a file; empty where nothing is.

Of a link its text alone, or its text and then all that of the regular file at its end.
"""


@dataclass(frozen=True)
class Record:
    """What is known of a task that was done.

    Attributes:
        fingerprint: of the task as it was then.
        seconds: that it took.
        inputs: signatures of the files.
        outputs: their sizes in bytes.
    """

    fingerprint: str
    seconds: float
    inputs: Signatures
    outputs: Mapping[str, int]


def record_path(task: Task, out: Path) -> Path:
    """Where the record of `task` is kept."""
    return out / BATCH_FOLDER / DONE_FOLDER / f"{task.name}.json"


def fingerprint(task: Task) -> str:
    """Hash of a task's arguments and of the version that does it, but not of the resources that it may use."""
    incidental = _INCIDENTAL.get(task.kind, ())
    arguments = {name: value for name, value in task.arguments.items() if name not in incidental}
    told = {"format": _FORMAT, "version": __version__, "kind": task.kind, "arguments": arguments}
    return hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()


def is_done(task: Task, out: Path) -> bool:
    """Whether `task` was done from these very inputs, and all that it left is there."""
    record = read_record(task, out)
    if record is None or record.fingerprint != fingerprint(task):
        return False
    return _outputs_fit(out, record) and _inputs_fit(task, out, record)


def read_record(task: Task, out: Path) -> Record | None:
    """The record of `task`; None if it is missing or damaged."""
    try:
        values = read_json(record_path(task, out))
        inputs = {path: tuple(signature) for path, signature in values["inputs"].items()}
        return Record(str(values["fingerprint"]), float(values["seconds"]), inputs, dict(values["outputs"]))
    except (InputError, ValueError, KeyError, TypeError, AttributeError, OverflowError):
        return None


def sign_inputs(task: Task, out: Path) -> dict[str, tuple[Any, ...]]:
    """The signatures of what `task` is made from, to be taken before it begins.

    Raises:
        InputError: an input is missing, and the task does not tolerate that.
        OSError: a file cannot be read.
    """
    signatures = {name: _signature(path) for name, path in _input_files(task, out).items()}
    missing = [name for name, signature in signatures.items() if not signature]
    if missing and not task.kind.tolerates_failures:
        raise InputError("no such file", where=missing[0], remedy="run the batch again, which makes it first")
    return signatures


def write_record(task: Task, out: Path, inputs: Signatures, seconds: float) -> None:
    """Record that `task` is done, after its outputs have reached the disk.

    Raises:
        FileNotFoundError: an output is missing.
        OSError: it cannot be written.
    """
    outputs = {}
    for path in task.output_paths(out):
        with open(path, "rb") as file:
            os.fsync(file.fileno())
            outputs[_name(path, out)] = os.fstat(file.fileno()).st_size
    record = {"fingerprint": fingerprint(task), "seconds": round(seconds, 2), "inputs": inputs, "outputs": outputs}
    path = record_path(task, out)
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path, contested=True) as temporary, open(temporary, "w", encoding="utf-8") as file:
        json.dump(record, file)
        file.flush()
        os.fsync(file.fileno())


def forget(task: Task, out: Path) -> None:
    """Delete the record of `task`, so that it will be done again."""
    record_path(task, out).unlink(missing_ok=True)


def _outputs_fit(out: Path, record: Record) -> bool:
    try:
        sizes = {name: (out / name).stat().st_size for name in record.outputs}
        # Somebody who measures a run in Blender has the scale written into its cameras.
        return all(sizes[name] == size or name.endswith(f"/{CAMERAS}") for name, size in record.outputs.items())
    except (OSError, ValueError):  # none is there, or none can be, because no file has such a name
        return False


def _inputs_fit(task: Task, out: Path, record: Record) -> bool:
    # What was signed and would not be now, as an earlier version did with hidden files, may be there as it was.
    files = {name: out / name for name in record.inputs} | _input_files(task, out)
    for name, path in files.items():
        known = record.inputs.get(name)
        if known is None:
            return False
        try:
            without_contents = known[:-1] if len(known) > 2 else known
            if _quick_signature(path) != without_contents and _signature(path)[-1:] != known[-1:]:
                return False
        except (OSError, ValueError):  # it cannot be read, or no file has such a name
            return False
    return True


def _input_files(task: Task, out: Path) -> dict[str, Path]:
    """Every file that `task` depends on, by its name in the record; of a capture's folder, what a run reads."""
    files: dict[str, Path] = {}  # cameras may lie in the folder of the photographs, or the other way round
    for path in task.input_paths(out):
        if path.is_dir():
            files.update((_name(file, out), file) for file in files_of_a_capture(path))
        else:
            files[_name(path, out)] = path
    return files


def _name(path: Path, out: Path) -> str:
    return path.relative_to(out).as_posix() if path.is_relative_to(out) else str(path)


def _quick_signature(path: Path) -> tuple[Any, ...]:
    """The signature without the contents."""
    try:
        text = (os.readlink(path),) if path.is_symlink() else ()
        if text and not is_file(path):
            return text
        status = path.stat()
    except FileNotFoundError:
        return ()
    return *text, status.st_size, status.st_mtime_ns


def _signature(path: Path) -> tuple[Any, ...]:
    quick = _quick_signature(path)
    if not is_file(path):
        return quick
    with open(path, "rb") as file:
        return *quick, hashlib.file_digest(file, "sha256").hexdigest()
