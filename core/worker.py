"""The worker process: one JSON request on stdin, events on stdout, an exit code of the contract.

    {"job": "inspect", "capture": "FOLDER"}              what the folder holds, without reading pixels
        also with "sfm": true; "thumbnails": {"folder": "DIR", "count": N, "size": PIXELS} for small pictures
    {"job": "inspect-all", "captures": [{"capture": "FOLDER", "sfm": false}, ...]}   what is wrong with each, or null
    {"job": "normalise", "capture": "FOLDER", "folder": "DIR"}   cameras, undistorted images, points, written into DIR
        also with "sfm": true
    {"job": "check", "device": "auto"}                   versions, device and speed; compiles the kernels
    {"job": "make-environment", "folder": "DIR"}         the worker's own environment; for any Python, whatever it has
    {"job": "run", "settings": {...}, "folder": "DIR"}   the whole pipeline up to Blender, written into DIR
        also with "previews": true for pictures of how far it is
    {"job": "enhance", "request": {...}, "folder": "DIR"}   photographs alone, recoloured into DIR
    {"job": "report-page", "folder": "DIR"}              report.html of the run in DIR
    {"job": "batch-page", "arguments": {...}, "folder": "DIR"}   the index page of the batch in DIR

Exit codes: 0 done, 2 unusable input, 130 cancelled, 1 a defect of ours (its traceback goes to stderr, so to the log).
"""

from __future__ import annotations

import os
import signal
import sys
import time
import traceback
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from types import MappingProxyType
from typing import Any

from .errors import Cancelled, InputError
from .files.untrusted import parse_json
from .photographs.front import EnhanceRequest
from .rendering.requests import PageArguments
from .runtime.devices import explain_fault
from .runtime.process import GRACE_SECONDS, follow_parent
from .runtime.protocol import JsonReporter, claim_stdout
from .runtime.supervisor import EXIT_CANCELLED, EXIT_DEFECT, EXIT_DONE, EXIT_INPUT
from .settings import Settings

# What a request must have besides its job, and what it may have.
_REQUESTS: Mapping[str, Mapping[str, type]] = {
    "inspect": {"capture": str},
    "inspect-all": {"captures": list},
    "normalise": {"capture": str, "folder": str},
    "check": {"device": str},
    "make-environment": {"folder": str},
    "run": {"settings": dict, "folder": str},
    "enhance": {"request": dict, "folder": str},
    "report-page": {"folder": str},
    "batch-page": {"arguments": dict, "folder": str},
}
_OPTIONAL: Mapping[str, type] = {"sfm": bool, "previews": bool, "thumbnails": dict, "packages": list}
_CAPTURE_ENTRY: Mapping[str, type] = {"capture": str, "sfm": bool}
_THUMBNAILS: Mapping[str, type] = {"folder": str, "count": int, "size": int}


def main() -> int:
    """Read the request, do the job, report; returns the exit code."""
    reporter = JsonReporter(claim_stdout())
    signal.signal(signal.SIGINT, _cancel)
    signal.signal(signal.SIGTERM, _cancel)
    follow_parent(_end_alone)
    try:
        result = _perform(parse_request(sys.stdin.readline()), reporter)
    except InputError as error:
        reporter.emit("error", kind="input", message=str(error))
        return EXIT_INPUT
    except Cancelled:
        return EXIT_CANCELLED
    except Exception as error:
        traceback.print_exc()
        explanation = explain_fault(error)
        if explanation:
            reporter.emit("error", kind="input", message=explanation)
            return EXIT_INPUT
        reporter.emit("error", kind="defect", message=f"{type(error).__name__}: {error}".splitlines()[0])
        return EXIT_DEFECT
    reporter.emit("result", **result)
    return EXIT_DONE


def parse_request(line: str) -> dict[str, Any]:
    """The request in `line`, of which everything that the job needs is there and of its type.

    Raises:
        InputError: it is none.
    """
    try:
        request = parse_json(line)
    except ValueError as error:
        raise _unusable(f"is not JSON ({error})") from None
    job = request.get("job") if isinstance(request, dict) else None
    if not isinstance(job, str) or job not in _REQUESTS:
        raise _unusable(f"is for an unknown job {str(job)[:40]!r}")
    _require_fields(request, _REQUESTS[job], _OPTIONAL)
    for entry in request.get("captures", ()):
        _require_fields(entry, _CAPTURE_ENTRY)
    if request.get("thumbnails") is not None:
        _require_fields(request["thumbnails"], _THUMBNAILS)
    return request


def _require_fields(
    values: Any, required: Mapping[str, type], optional: Mapping[str, type] = MappingProxyType({})
) -> None:
    if not isinstance(values, dict):
        raise _unusable("has something else where an object belongs")
    for name, kind in {**optional, **required}.items():
        value = values.get(name)
        if value is None and name not in required:
            continue
        if type(value) is not kind or (isinstance(value, str) and "\0" in value):
            raise _unusable(f"has no usable '{name}'")


def _unusable(what: str) -> InputError:
    return InputError(f"the request {what}", where="stdin", remedy="send what the head of core/worker.py shows")


def _perform(request: dict[str, Any], reporter: JsonReporter) -> dict[str, Any]:
    job = request.get("job")
    if job == "inspect":
        return _inspect(Path(request["capture"]), bool(request.get("sfm")), request.get("thumbnails"), reporter)
    if job == "inspect-all":
        return {"refusals": _inspect_all(request["captures"], reporter)}
    if job == "normalise":
        return _normalise(Path(request["capture"]), Path(request["folder"]), bool(request.get("sfm")), reporter)
    if job == "check":
        reporter.status("check", "loading")
        from .pipeline.device import check_machine

        return {"machine": check_machine(str(request["device"]), reporter)}
    if job == "make-environment":
        from .runtime.environment import make_environment

        return {"python": str(make_environment(Path(request["folder"]), reporter, request.get("packages")))}
    if job == "run":
        settings = Settings.from_dict(request["settings"])
        reporter.status("start", "loading")
        from .pipeline.run import run

        previews = bool(request.get("previews"))
        return {"report": run(settings, Path(request["folder"]), reporter, previews=previews)}
    if job == "enhance":
        enhance_request = EnhanceRequest.from_dict(request["request"])
        reporter.status("start", "loading")
        from .photographs.job import enhance_folder

        return {"summary": enhance_folder(enhance_request, Path(request["folder"]), reporter)}
    if job == "report-page":
        from .runs.report_page import write_report_page

        write_report_page(Path(request["folder"]))
        return {}
    if job == "batch-page":
        from .batch.page_markup import write_batch_page

        write_batch_page(PageArguments.from_dict(request["arguments"]), Path(request["folder"]))
        return {}
    raise AssertionError(f"a job that parse_request knows and nobody does: {job}")


def _inspect(capture: Path, sfm: bool, thumbnails: dict[str, Any] | None, reporter: JsonReporter) -> dict[str, Any]:
    from .capture.reader import inspect_capture, write_thumbnails

    summary = asdict(inspect_capture(capture, sfm=sfm, reporter=reporter))
    summary["source"] = str(summary["source"])
    if thumbnails is None:
        return {"summary": summary}
    count, size = thumbnails["count"], thumbnails["size"]
    paths = write_thumbnails(capture, Path(thumbnails["folder"]), count=count, size=size, sfm=sfm)
    return {"summary": summary, "thumbnails": [str(path) for path in paths]}


def _inspect_all(captures: list[dict[str, Any]], reporter: JsonReporter) -> list[str | None]:
    from .capture.reader import inspect_capture

    refusals: list[str | None] = []
    for entry in captures:
        reporter.progress("check", len(refusals) / len(captures), entry["capture"])
        try:
            inspect_capture(entry["capture"], sfm=bool(entry["sfm"]), reporter=reporter)
        except InputError as error:
            refusals.append(str(error))
        else:
            refusals.append(None)
    return refusals


def _normalise(source: Path, folder: Path, sfm: bool, reporter: JsonReporter) -> dict[str, Any]:
    reporter.status("capture", "loading")
    from .capture.normalised import write_capture
    from .capture.reader import read_capture

    capture = read_capture(source, max_size=None, sfm=sfm, reporter=reporter)
    reporter.status("capture", f"writing {len(capture.views)} photographs")
    write_capture(capture, folder)
    return {"views": len(capture.views), "points": len(capture.points)}


def _cancel(*_: object) -> None:
    raise Cancelled


def _end_alone() -> None:
    """End as if cancelled, because nobody listens any more; at once where a long call into C++ does not let that be."""
    os.kill(os.getpid(), signal.SIGINT)  # pycolmap takes SIGTERM for itself when it is imported
    time.sleep(GRACE_SECONDS)
    os._exit(EXIT_CANCELLED)
