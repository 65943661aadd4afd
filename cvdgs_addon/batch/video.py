"""MP4 files of pictures, side by side where they are several, through Blender's sequencer and its FFmpeg."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any, Self

import bpy

from ...core.errors import InputError
from ...core.files.untrusted import replacing
from ...core.rendering.requests import VideoArguments
from ...core.runs.layout import picture_name
from ...core.runtime.protocol import Reporter
from ..scene.remembered_settings import Setting, set_settings
from ..scene.render_settings import Display, display_settings, literal_path
from .lettering import Label, add_text_strip, fitting_size
from .pixels import picture_size

STAGE = "video"

_GAP = 8  # pixels between pictures side by side, and beside a caption
_CAPTION = 0.05  # size of type of a caption at most, in heights of the pictures
_BAND = 2.0  # height of the band above the pictures, in sizes of type
_INK = 0.85  # sRGB value of captions, on black
_KEYFRAME_INTERVAL = 12  # pictures; players jump to any place of a video of that kind at once


class Quality(Enum):
    """How close a video comes to its pictures: Blender's names of H.264's rate factors."""

    SHOWN = "HIGH"
    """Rate factor 20: a video that is shown and kept."""
    SMALL = "MEDIUM"
    """Rate factor 23: a video within a page."""


@dataclass(frozen=True)
class Column:
    """A sequence of pictures in a video, beside others.

    Attributes:
        pictures: their files, in order.
        caption: what stands above them; "" for nothing.
    """

    pictures: Sequence[Path]
    caption: str = ""


def make_video(arguments: VideoArguments, out: Path, *, reporter: Reporter) -> dict[str, Any]:
    """Make the video of a task; replaces the file that is open.

    Raises:
        InputError: a picture is missing, or they differ in size.
        OSError: the video cannot be written.
        RuntimeError: Blender could not write it.
    """
    names = [picture_name(number) for number in range(1, arguments.frames + 1)]
    columns = [
        Column([out / folder / name for name in names], caption)
        for folder, caption in zip(arguments.sequences, arguments.captions, strict=True)
    ]
    encode(columns, arguments.frames_per_second, out / arguments.file, Quality.SHOWN, reporter)
    return {"frames": arguments.frames}


def encode(columns: Sequence[Column], frames_per_second: int, file: Path, quality: Quality, reporter: Reporter) -> None:
    """Write sequences of pictures side by side, from left to right, as an MP4; arguments and errors as `make_video`."""
    for path in (path for column in columns for path in column.pictures):
        if not path.is_file():
            raise InputError("no such picture", where=path, remedy="run the batch again")
    layout = _Layout.of(columns)
    bpy.ops.wm.read_homefile(use_empty=True)
    scene = bpy.context.scene
    file.parent.mkdir(parents=True, exist_ok=True)
    frames = len(columns[0].pictures)
    with replacing(file) as temporary:
        set_settings(scene, _settings(layout.size, frames_per_second, frames, quality, temporary))
        scene.sequence_editor_create()
        for channel, place in enumerate(layout.places, start=1):
            _add_pictures(scene, place, channel, layout.size)
        for channel, label in enumerate(layout.labels, start=1 + len(layout.places)):
            add_text_strip(scene, label, channel, frames, layout.size)
        with _progress(frames, reporter):
            bpy.ops.render.render(animation=True, scene=scene.name)


@dataclass(frozen=True)
class _Place:
    """Where pictures of a size (width and height) are in the video, in pixels from its upper left corner."""

    pictures: Sequence[Path]
    size: tuple[int, int]
    left: int
    top: int


@dataclass(frozen=True)
class _Layout:
    """What is where in a video of a size (width and height) in pixels."""

    size: tuple[int, int]
    places: tuple[_Place, ...]
    labels: tuple[Label, ...]

    @classmethod
    def of(cls, columns: Sequence[Column]) -> Self:
        """The pictures beside each other, below a band for the captions where there are some."""
        sizes = [picture_size(column.pictures[0]) for column in columns]
        captions = {place: column.caption for place, column in enumerate(columns) if column.caption}
        type_size = min((_caption_size(text, *sizes[place]) for place, text in captions.items()), default=0.0)
        band = 2 * round(type_size * _BAND / 2.0)
        lefts = [sum(width + _GAP for width, _ in sizes[:place]) for place in range(len(sizes))]
        width, height = lefts[-1] + sizes[-1][0], band + max(height for _, height in sizes)
        labels = (Label(text, lefts[place] + _GAP, band / 2.0, type_size, _INK) for place, text in captions.items())
        places = (
            _Place(column.pictures, size, left, band) for column, size, left in zip(columns, sizes, lefts, strict=True)
        )
        # H.264 stores colours at half the resolution, so it wants even sizes.
        return cls((width + width % 2, height + height % 2), tuple(places), tuple(labels))


def _caption_size(text: str, width: int, height: int) -> float:
    """Size of type at which a caption fits above pictures of that size."""
    return min(fitting_size(text, width - 2 * _GAP), _CAPTION * height)


def _add_pictures(scene: bpy.types.Scene, place: _Place, channel: int, size: tuple[int, int]) -> None:
    """Show the pictures of `place` in a channel of the sequencer of a video of `size`."""
    first, *others = place.pictures
    strips = scene.sequence_editor.strips
    strip = strips.new_image(f"Sequence {channel}", str(first), channel, 1, fit_method="ORIGINAL")
    for path in others:
        strip.elements.append(path.name)
    # Blender 5.2 has a new name for it, and warns of the old one.
    setattr(strip, "duration" if hasattr(strip, "duration") else "frame_final_duration", len(place.pictures))
    # From the middle of the video to that of the picture; upwards is positive.
    strip.transform.offset_x = place.left + (place.size[0] - size[0]) / 2.0
    strip.transform.offset_y = (size[1] - place.size[1]) / 2.0 - place.top


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
        "render.filepath": literal_path(file),
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
