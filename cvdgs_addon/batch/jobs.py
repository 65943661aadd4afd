"""The jobs of the process that makes pictures (see `worker`), by name."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import bpy

from ...core.errors import InputError
from ...core.files.untrusted import partial_file
from ...core.rendering.requests import FramesArguments, SheetArguments, VideoArguments
from ...core.runtime.protocol import Reporter
from ..scene.remembered_settings import set_settings
from ..scene.render_settings import Engine, engine_settings, png_settings
from ..scene.stills import is_full, render_picture
from . import contact_sheet, frames, previews, video

_TRIAL_SIZE = 16  # pixels


def perform(request: dict[str, Any], reporter: Reporter) -> dict[str, Any]:
    """Do what `request` asks for; returns the fields of the result.

    Raises:
        InputError: unusable input, or a folder that cannot be written to.
    """
    try:
        return _perform(request, reporter)
    except OSError as error:
        what, remedy = error.strerror or str(error), "free space or check the permissions"
        raise InputError(what, where=error.filename or "", remedy=remedy) from error
    except RuntimeError as error:  # what bpy's operators raise, whatever the reason
        out = Path(request.get("out", "."))
        if not is_full(out):
            raise
        raise InputError("the disk is full", where=out, remedy="free space, then run the batch again") from error


def half_made(request: dict[str, Any]) -> list[Path]:
    """What the job may have left when it is cut short."""
    job = request["job"]
    if job == "try-eevee":
        return []
    out, arguments = Path(request["out"]), request["arguments"]
    if job == "frames":
        return frames.half_made(FramesArguments.from_dict(arguments), out)
    if job == "previews":
        return previews.half_made(arguments, out)
    return [partial_file(out / arguments["file"])]


def _perform(request: dict[str, Any], reporter: Reporter) -> dict[str, Any]:
    job = request.get("job")
    if job == "try-eevee":
        return _try_eevee()
    out, arguments = Path(request["out"]), request["arguments"]
    if job == "frames":
        asked = FramesArguments.from_dict(arguments)
        return frames.render_frames(asked, out, threads=int(request["threads"]), reporter=reporter)
    if job == "video":
        return video.make_video(VideoArguments.from_dict(arguments), out, reporter=reporter)
    if job == "sheet":
        return contact_sheet.make_sheet(SheetArguments.from_dict(arguments), out, reporter=reporter)
    if job == "previews":
        return previews.make_previews(arguments, out, reporter=reporter)
    raise InputError(f"unknown job '{job}'", remedy="update the program that sends it")


def _try_eevee() -> dict[str, Any]:
    """Render a small picture with EEVEE; without OpenGL, Blender aborts."""
    scene = bpy.context.scene
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.collection.objects.link(camera)
    scene.camera = camera
    set_settings(scene, {**engine_settings(Engine.EEVEE), **png_settings()})
    scene.render.resolution_x = scene.render.resolution_y = _TRIAL_SIZE
    with tempfile.TemporaryDirectory() as folder:
        render_picture(scene, Path(folder) / "trial.png")
    return {}
