"""The worker process: one JSON request on stdin, events on stdout, an exit code of the protocol.

    {"job": "inspect", "capture": "FOLDER"}              what the folder holds, without reading pixels
        also with "cameras": "auto|estimate|given|FILE"
        and "thumbnails": {"folder": "DIR", "count": N, "size": PIXELS} for small pictures
    {"job": "inspect-all", "captures": [{"capture": "FOLDER", "cameras": "auto"}, ...]}   what is wrong with each
    {"job": "normalise", "capture": "FOLDER", "folder": "DIR"}   cameras, undistorted images, points, written into DIR
        also with "cameras"
    {"job": "check", "device": "auto"}                   versions, device and speed; compiles the kernels
    {"job": "make-environment", "folder": "DIR"}         the worker's own environment; for any Python, whatever it has
    {"job": "run", "settings": {...}, "folder": "DIR"}   the whole pipeline up to Blender, written into DIR
        also with "previews": true for pictures of its progress
        and "checkpoint": {"folder": "DIR", "resume": false, "seconds": 120}, to go on from if it is broken off
    {"job": "enhance", "request": {...}, "folder": "DIR"}   photographs alone, recoloured into DIR
    {"job": "report-page", "folder": "DIR"}              report.html of the run in DIR
    {"job": "batch-page", "arguments": {...}, "folder": "DIR"}   the index page of the batch in DIR

Events and exit codes are those of `runtime.protocol`. A job imports what it needs when it begins.
"""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from types import MappingProxyType
from typing import Any

from .errors import Cancelled, InputError
from .files.untrusted import parse_json
from .pipeline.continuation import CheckpointRequest
from .rendering.requests import PageArguments
from .runtime.process import GRACE_SECONDS, follow_parent
from .runtime.protocol import EXIT_CANCELLED, JsonReporter, Reporter, claim_stdout, do_and_report
from .settings import AUTO, Settings

Request = dict[str, Any]


def main() -> int:
    """Read the request, do the job, report; returns the exit code."""
    reporter = JsonReporter(claim_stdout())
    signal.signal(signal.SIGINT, _cancel)
    signal.signal(signal.SIGTERM, _cancel)
    follow_parent(_end_alone)

    def work() -> Mapping[str, Any]:
        request = parse_request(sys.stdin.readline())
        do, _ = _JOBS[request["job"]]
        return do(request, reporter)

    return do_and_report(work, reporter)


def parse_request(line: str) -> Request:
    """The request in `line`, with everything that the job needs, each of its type.

    Raises:
        InputError: it is not a request.
    """
    try:
        request = parse_json(line)
    except ValueError as error:
        raise _unusable(f"is not JSON ({error})") from None
    job = request.get("job") if isinstance(request, dict) else None
    if not isinstance(job, str) or job not in _JOBS:
        raise _unusable(f"is for an unknown job {str(job)[:40]!r}")
    _require_fields(request, _JOBS[job][1], _OPTIONAL)
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
    return InputError(f"the request {what}", where="stdin", remedy="send one of the requests listed in core/worker.py")


def _inspect(request: Request, reporter: Reporter) -> Mapping[str, Any]:
    from .capture.reader import inspect_capture, write_thumbnails

    capture, cameras, thumbnails = Path(request["capture"]), _cameras(request), request.get("thumbnails")
    summary = asdict(inspect_capture(capture, cameras=cameras, reporter=reporter))
    summary["source"] = str(summary["source"])
    if thumbnails is None:
        return {"summary": summary}
    count, size = thumbnails["count"], thumbnails["size"]
    paths = write_thumbnails(capture, Path(thumbnails["folder"]), count=count, size=size, cameras=cameras)
    return {"summary": summary, "thumbnails": [str(path) for path in paths]}


def _cameras(request: Request) -> str:
    return request.get("cameras") or AUTO


def _inspect_all(request: Request, reporter: Reporter) -> Mapping[str, Any]:
    from .capture.reader import inspect_capture

    refusals: list[str | None] = []
    for entry in request["captures"]:
        reporter.progress("check", len(refusals) / len(request["captures"]), entry["capture"])
        try:
            inspect_capture(entry["capture"], cameras=entry["cameras"], reporter=reporter)
            refusals.append(None)
        except InputError as error:
            refusals.append(str(error))
    return {"refusals": refusals}


def _normalise(request: Request, reporter: Reporter) -> Mapping[str, Any]:
    reporter.status("capture", "loading")
    from .capture.normalised import write_capture
    from .capture.reader import read_capture

    capture = read_capture(request["capture"], max_size=None, cameras=_cameras(request), reporter=reporter)
    reporter.status("capture", f"writing {len(capture.views)} photographs")
    write_capture(capture, Path(request["folder"]))
    return {"views": len(capture.views), "points": len(capture.points)}


def _check(request: Request, reporter: Reporter) -> Mapping[str, Any]:
    reporter.status("check", "loading")
    from .pipeline.device import check_machine

    return {"machine": check_machine(str(request["device"]), reporter)}


def _make_environment(request: Request, reporter: Reporter) -> Mapping[str, Any]:
    from .runtime.environment import make_environment

    return {"python": str(make_environment(Path(request["folder"]), reporter, request.get("packages")))}


def _run(request: Request, reporter: Reporter) -> Mapping[str, Any]:
    settings = Settings.from_dict(request["settings"])
    reporter.status("start", "loading")
    from .pipeline.run import run

    asked = request.get("checkpoint")
    checkpoint = None if asked is None else CheckpointRequest.from_dict(asked)
    previews = bool(request.get("previews"))
    return {"report": run(settings, Path(request["folder"]), reporter, previews=previews, checkpoint=checkpoint)}


def _enhance(request: Request, reporter: Reporter) -> Mapping[str, Any]:
    from .photographs.front import EnhanceRequest

    enhance_request = EnhanceRequest.from_dict(request["request"])
    reporter.status("start", "loading")
    from .photographs.job import enhance_folder

    return {"summary": enhance_folder(enhance_request, Path(request["folder"]), reporter)}


def _write_report_page(request: Request, reporter: Reporter) -> Mapping[str, Any]:
    from .runs.report_page import write_report_page
    from .splats.web.finished_run import is_finished_run, write_viewer

    folder = Path(request["folder"])
    try:
        if is_finished_run(folder):
            write_viewer(folder)  # the report shows it
    except InputError as error:  # no reason to lose a run
        reporter.warning("no-web-page", f"the scene has no page for browsers: {error}")
    write_report_page(folder)
    return {}


def _write_batch_page(request: Request, reporter: Reporter) -> Mapping[str, Any]:
    from .batch.page_markup import write_batch_page

    write_batch_page(PageArguments.from_dict(request["arguments"]), Path(request["folder"]))
    return {}


# What does a job, and what its request must have; below, what any request may have.
_JOBS: Mapping[str, tuple[Callable[[Request, Reporter], Mapping[str, Any]], Mapping[str, type]]] = {
    "inspect": (_inspect, {"capture": str}),
    "inspect-all": (_inspect_all, {"captures": list}),
    "normalise": (_normalise, {"capture": str, "folder": str}),
    "check": (_check, {"device": str}),
    "make-environment": (_make_environment, {"folder": str}),
    "run": (_run, {"settings": dict, "folder": str}),
    "enhance": (_enhance, {"request": dict, "folder": str}),
    "report-page": (_write_report_page, {"folder": str}),
    "batch-page": (_write_batch_page, {"arguments": dict, "folder": str}),
}
_OPTIONAL: Mapping[str, type] = {
    "cameras": str,
    "previews": bool,
    "thumbnails": dict,
    "packages": list,
    "checkpoint": dict,
}
_CAPTURE_ENTRY: Mapping[str, type] = {"capture": str, "cameras": str}
_THUMBNAILS: Mapping[str, type] = {"folder": str, "count": int, "size": int}


def _cancel(*_: object) -> None:
    raise Cancelled


def _end_alone() -> None:
    """End as if cancelled, because nobody is listening any more; at once if a long call into C++ blocks that."""
    os.kill(os.getpid(), signal.SIGINT)  # pycolmap takes SIGTERM for itself when it is imported
    time.sleep(GRACE_SECONDS)
    os._exit(EXIT_CANCELLED)
