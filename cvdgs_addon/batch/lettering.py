"""Text on pictures and videos, through Blender's sequencer and in its own typeface."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import bpy

from ..scene.remembered_settings import Setting, set_settings
from ..scene.render_settings import Display, display_settings, png_settings
from ..scene.stills import render_picture
from .pixels import picture_size

_MOST_STRIPS = 100  # at a time; the sequencer has 128 channels
_ADVANCE = 0.62  # widths of a character of Blender's typeface, which has even ones, in sizes of type


@dataclass(frozen=True)
class Label:
    """A line of text.

    Attributes:
        text: without a line break.
        left, middle: where it begins, and the height of its middle, in pixels from the upper left corner.
        size: of the type, in pixels.
        grey: sRGB value from 0, black, to 1.
    """

    text: str
    left: float
    middle: float
    size: float
    grey: float = 0.1


def text_width(text: str, size: float) -> float:
    """Pixels that a line of type takes."""
    return len(text) * size * _ADVANCE


def fitting_size(text: str, width: float) -> float:
    """Size of type at which a line takes `width` pixels."""
    return width / text_width(text, 1.0)


def add_text_strip(
    scene: bpy.types.Scene, label: Label, channel: int, frames: int, size: tuple[int, int]
) -> bpy.types.Strip:
    """Show `label` on pictures of `size` (width and height) from the first frame on, in a channel of the sequencer."""
    duration = {"length": frames} if bpy.app.version >= (5, 0) else {"frame_end": 1 + frames}
    strip = scene.sequence_editor.strips.new_effect("Label", "TEXT", channel, 1, **duration)
    strip.text, strip.font_size = label.text, label.size
    strip.color = (label.grey, label.grey, label.grey, 1.0)
    strip.use_shadow = False
    strip.anchor_x, strip.anchor_y, strip.alignment_x = "LEFT", "CENTER", "LEFT"
    strip.location = (label.left / size[0], 1.0 - label.middle / size[1])
    return strip


def add_labels(path: Path, labels: Sequence[Label]) -> None:
    """Write `labels` onto the PNG file `path`; replaces the file that is open in Blender."""
    for start in range(0, len(labels), _MOST_STRIPS):
        _add_labels(path, labels[start : start + _MOST_STRIPS])


def _add_labels(path: Path, labels: Sequence[Label]) -> None:
    width, height = picture_size(path)
    bpy.ops.wm.read_homefile(use_empty=True)
    scene = bpy.context.scene
    set_settings(scene, _settings(width, height))
    strips = scene.sequence_editor_create().strips
    strips.new_image("Picture", str(path), 1, 1, fit_method="ORIGINAL")
    for channel, label in enumerate(labels, start=2):
        add_text_strip(scene, label, channel, 1, (width, height))
    scene.frame_set(1)
    render_picture(scene, path)


def _settings(width: int, height: int) -> dict[str, Setting]:
    return {
        **display_settings(Display.SCENE_LINEAR),  # the sequencer decodes pictures; Standard encodes them again
        **png_settings(),
        "render.resolution_x": width,
        "render.resolution_y": height,
        "render.resolution_percentage": 100,
        "render.use_sequencer": True,
        "render.use_compositing": False,
    }
