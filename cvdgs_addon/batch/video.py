"""MP4 files of pictures, side by side where they are several, through Blender's sequencer and its FFmpeg."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from enum import Enum
from pathlib import Path
from typing import Any

import bpy

from ...core.batch.arguments import VideoArguments, picture_name
from ...core.errors import InputError
from ...core.events import Reporter
from ..scene.remembered_settings import Setting, set_settings
from ..scene.render_settings import Display, display_settings
from .pixels import picture_size

STAGE = "video"

_GAP = 8  # pixels between pictures side by side
_KEYFRAME_INTERVAL = 12  # pictures; players jump to any place of a video of that kind at once


class Quality(Enum):
    """How close a video comes to its pictures: Blender's names of H.264's rate factors."""

    SHOWN = "HIGH"
    """Rate factor 20: a video that is shown and kept."""
    SMALL = "MEDIUM"
    """Rate factor 23: a video within a page."""


def make_video(arguments: VideoArguments, out: Path, *, reporter: Reporter) -> dict[str, Any]:
    """Make the video of a task; replaces the file that is open.

    Raises:
        InputError: a picture is missing, or they differ in size.
        OSError: the video cannot be written.
        RuntimeError: Blender could not write it.
    """
    names = [picture_name(number) for number in range(1, arguments.frames + 1)]
    sequences = [[out / folder / name for name in names] for folder in arguments.sequences]
    encode(sequences, arguments.frames_per_second, out / arguments.file, Quality.SHOWN, reporter)
    return {"frames": arguments.frames}


def encode(
    sequences: Sequence[Sequence[Path]], frames_per_second: int, file: Path, quality: Quality, reporter: Reporter
) -> None:
    """Write sequences of pictures side by side, from left to right, as an MP4; arguments and errors as `make_video`."""
    for path in (path for sequence in sequences for path in sequence):
        if not path.is_file():
            raise InputError("no such picture", where=path, remedy="run the batch again")
    sizes = [picture_size(sequence[0]) for sequence in sequences]
    bpy.ops.wm.read_homefile(use_empty=True)
    scene = bpy.context.scene
    width = sum(size[0] for size in sizes) + _GAP * (len(sizes) - 1)
    height = max(size[1] for size in sizes)
    # H.264 stores colours at half the resolution, so it wants even sizes.
    size = (width + width % 2, height + height % 2)
    temporary = partial_video(file)
    file.parent.mkdir(parents=True, exist_ok=True)
    set_settings(scene, _settings(size, frames_per_second, len(sequences[0]), quality, temporary))
    left = 0
    strips = scene.sequence_editor_create().strips
    for channel, (sequence, (picture_width, picture_height)) in enumerate(zip(sequences, sizes, strict=True), start=1):
        strip = strips.new_image(f"Sequence {channel}", str(sequence[0]), channel, 1, fit_method="ORIGINAL")
        for path in sequence[1:]:
            strip.elements.append(path.name)
        strip.frame_final_duration = len(sequence)
        # From the middle of the video to that of the picture; upwards is positive.
        strip.transform.offset_x = left + (picture_width - size[0]) / 2.0
        strip.transform.offset_y = (size[1] - picture_height) / 2.0
        left += picture_width + _GAP
    try:
        with _progress(len(sequences[0]), reporter):
            bpy.ops.render.render(animation=True, scene=scene.name)
        os.replace(temporary, file)
    finally:
        temporary.unlink(missing_ok=True)


def partial_video(file: Path) -> Path:
    """Where the video `file` is made before it gets its name."""
    return file.with_name(f".{file.stem}.partial.mp4")


def _settings(
    size: tuple[int, int], frames_per_second: int, frames: int, quality: Quality, file: Path
) -> dict[str, Setting]:
    media: dict[str, Setting] = {"render.image_settings.media_type": "VIDEO"} if bpy.app.version >= (5, 0) else {}
    return {
        **display_settings(Display.SCENE_LINEAR),  # the sequencer decodes pictures; Standard encodes them again
        **media,
        "render.image_settings.file_format": "FFMPEG",
        "render.image_settings.color_mode": "RGB",
        "render.ffmpeg.format": "MPEG4",
        "render.ffmpeg.codec": "H264",
        "render.ffmpeg.constant_rate_factor": quality.value,
        "render.ffmpeg.ffmpeg_preset": "GOOD",
        "render.ffmpeg.gopsize": _KEYFRAME_INTERVAL,
        "render.ffmpeg.audio_codec": "NONE",
        "render.fps": frames_per_second,
        "render.fps_base": 1.0,
        "render.resolution_x": size[0],
        "render.resolution_y": size[1],
        "render.resolution_percentage": 100,
        "render.use_sequencer": True,
        "render.use_compositing": False,
        "render.use_file_extension": False,
        "render.filepath": str(file),
        "frame_start": 1,
        "frame_end": frames,
        "frame_step": 1,
    }


@contextmanager
def _progress(frames: int, reporter: Reporter) -> Iterator[None]:
    """Report each picture that Blender writes within the block."""

    def report(scene: bpy.types.Scene, *_: object) -> None:
        reporter.progress(STAGE, scene.frame_current / frames, f"picture {scene.frame_current} of {frames}")

    handlers = bpy.app.handlers.render_write
    handlers.append(report)
    try:
        yield
    finally:
        handlers.remove(report)
