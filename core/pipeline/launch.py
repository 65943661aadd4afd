"""A run on the console: workers, progress, results put in place. Standard library only."""

from __future__ import annotations

import json
import os
import shutil
import sys
from collections.abc import Collection
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from ..doctor.checks import require_blender
from ..errors import InputError
from ..rendering import turntables
from ..runs.folder import RunFolder, files_of_a_run
from ..runs.layout import BLEND_FILE, CAPTURE_FOLDER, LOG_FILE, REPORT_PAGE
from ..runs.report import latest_seconds, write_report
from ..runtime.process import Event, Workers, blender_command
from ..runtime.progress import CAMERAS, STARTING, Clock, RunProgress, format_seconds
from ..runtime.supervisor import CANCELLED, BarDisplay, JsonDisplay, Listener, Log, all_or_nothing, finish, in_console
from ..settings import Settings
from .continuation import CHECKPOINT_SECONDS, CheckpointRequest, checkpoint_folder, goes_on, resumption


def run_in_console(settings: Settings, *, json_events: bool, given: Collection[str] | None = None) -> int:
    """Run `settings` with progress on the console; returns the exit code of the contract.

    Args:
        json_events: write the events to stdout as JSON lines instead of a progress bar on stderr.
        given: as for `run`.
    """

    def work(listen: Listener) -> Event:
        return {"out": settings.out, "report": run(settings, listen, given=given)}

    def cancelled() -> str:
        return "cancelled; the same with --resume goes on from here" if goes_on(settings, given) else CANCELLED

    try:
        expected = resumption(settings, given).settings
    except InputError:  # `run` is refused for it
        expected = settings
    bar = BarDisplay(sys.stderr, "run.py", RunProgress(stages_of(expected)), _summary)
    return in_console(work, JsonDisplay(sys.stdout) if json_events else bar, cancelled=cancelled)


def stages_of(settings: Settings) -> tuple[str, ...]:
    """The stages that a run with `settings` reports, in order."""
    return (
        STARTING,
        "capture",
        *(() if settings.resume else (CAMERAS,)),
        "enhance",
        *(() if settings.resume else ("geometry",)),
        "layers",
        "evaluate",
        *(("blender",) if settings.blend else ()),
        *((turntables.STAGE,) if settings.turntable else ()),
    )


def run(
    settings: Settings,
    listen: Listener,
    workers: Workers | None = None,
    *,
    given: Collection[str] | None = None,
    previews: bool = False,
    checkpoint_seconds: float = CHECKPOINT_SECONDS,
) -> dict[str, Any]:
    """Run the whole job and put its results into ``settings.out``; returns the report.

    Args:
        listen: receives every event of the workers.
        workers: does the work; None takes the interpreter that `runtime.process.find_python` finds.
        given: names of the options that were given, for ``resume``; see `continuation.resumption`.
        previews: whether `listen` receives pictures of the run's progress.
        checkpoint_seconds: between two checkpoints of the geometry.

    Raises:
        InputError: unusable input or output; nothing was written.
        Cancelled: nothing was written but a checkpoint, if there was much to keep.
        WorkerDefect: a worker failed; its log is kept in the output folder, and a checkpoint likewise.
    """
    clock = Clock()
    listen({"event": "status", "stage": "start", "message": "starting"})
    workers = workers or Workers()
    workers.require_python()  # before a folder is made
    folder = RunFolder(settings.out)
    with all_or_nothing(folder, settings.out, LOG_FILE), ExitStack() as stack:
        _refuse_to_replace_the_capture(settings)
        resumed = resumption(settings, given)
        settings = resumed.settings
        if settings.blend:
            require_blender()  # before minutes of work that would be lost without it
        if settings.resume:
            folder.carry_over()
        log_file = stack.enter_context(open(folder.staging / LOG_FILE, "a", encoding="utf-8"))
        log = Log(log_file, listen)
        if folder.mended:
            log.event({"event": "warning", "name": "interrupted-run", "message": folder.mended})
        if resumed.note:
            log.event({"event": "warning", "name": "checkpoint", "message": resumed.note})
        log.line("settings " + json.dumps(settings.to_dict()))
        request = {"job": "run", "settings": settings.to_dict(), "folder": str(folder.staging), "previews": previews}
        checkpoints = checkpoint_folder(folder.out)
        if not settings.resume:
            kept = CheckpointRequest(str(checkpoints), resumed.continues, checkpoint_seconds)
            request["checkpoint"] = kept.to_dict()
        report = finish(workers.start(request, log.line), log.event)["report"]
        seconds = latest_seconds(report)
        if settings.blend:
            # A held-out view from the middle: its still can be compared with renders/.
            shown = report["views_shown"]
            arguments = [str(folder.staging), f"--view={shown[len(shown) // 2]}"]  # it may begin with a dash
            with clock.measure("blender"):
                blender = finish(workers.start_command(blender_command(arguments), None, log.line), log.event)
            blender.pop("event")
            report["blender"] = blender
        elif report.get("blender"):
            message = f"{BLEND_FILE} lacks the new layers; the next run with --blend adds them"
            log.event({"event": "warning", "name": "old-scene", "message": message})
            report["warnings"].append({"name": "old-scene", "message": message})
        if settings.turntable:
            with clock.measure(turntables.STAGE):
                report[turntables.STAGE] = turntables.render_turntables(folder.staging, report, settings, workers, log)
        seconds.update(clock.seconds, total=clock.total)
        write_report(folder.staging, report)
        finish(workers.start_page({"job": "report-page", "folder": str(folder.staging)}, log.line), log.event)
    if not settings.resume:  # else the checkpoint there is of a training that this run has not replaced
        shutil.rmtree(checkpoints, ignore_errors=True)
    return report


def _refuse_to_replace_the_capture(settings: Settings) -> None:
    """A run in the place of the one whose pictures it is made from would leave nothing of these.

    The earlier run's own capture is no such picture: the next one keeps it likewise.
    """
    capture, out = (Path(os.path.realpath(path)) for path in (settings.capture, settings.out))
    for path in files_of_a_run(out):
        if path.name != CAPTURE_FOLDER and capture.is_relative_to(path):
            what, remedy = "is among what the new run would replace", "choose another folder with --out"
            raise InputError(what, where=settings.capture, remedy=remedy)


def _summary(result: Event) -> str:
    out, report = Path(result["out"]), result["report"]
    seconds, reconstruction = latest_seconds(report), report["reconstruction"]
    judged = "held-out" if report["capture"]["test"] else "training"
    psnr = "-" if reconstruction["psnr"] is None else f"{reconstruction['psnr']:.2f} dB on {judged} views"
    lines = [f"done in {format_seconds(seconds['total'] or 0.0)}: {report['gaussians']} Gaussians, {psnr}"]
    for name, layer in report["layers"].items():
        ccpr = layer["ccpr"]
        if ccpr["rendered"] is not None:
            kinds = (("photographs", "input"), ("scene", "unenhanced"), ("enhanced scene", "rendered"))
            values = ", ".join(f"{label} {ccpr[kind]:.3f}" for label, kind in kinds)
            lines.append(f"  {name}: contrast preserved (CCPR): {values}")
    lines.append(f"  open {out / REPORT_PAGE}" + (f" and {out / BLEND_FILE}" if report.get("blender") else ""))
    return "\n".join(lines)
