"""The videos of a batch, read back through Blender."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest

from cvdgs.core.errors import InputError
from cvdgs.core.rendering.requests import VideoArguments
from cvdgs.core.runtime.protocol import Reporter
from cvdgs.cvdgs_addon.batch.pixels import Pixels, read_picture, write_picture
from cvdgs.cvdgs_addon.batch.video import make_video
from cvdgs.cvdgs_addon.scene.render_settings import Display, set_display, set_png

from .batches import SIZE, number_picture, sequence

CLOSE = 6.0  # levels of 255 on average: H.264 is not lossless
DARK, LIGHT = 60, 150  # levels: the ground of captions, and their ink


class Heard(Reporter):
    def __init__(self) -> None:
        self.fractions: list[float] = []

    def progress(self, stage: str, fraction: float, message: str = "") -> None:
        self.fractions.append(fraction)


def make(
    out: Path, *folders: str, frames: int = 5, captions: tuple[str, ...] | None = None, reporter: Reporter | None = None
) -> Path:
    arguments = VideoArguments(folders, frames, 12, "turn.mp4", captions or ("",) * len(folders))
    make_video(arguments, out, reporter=reporter or Reporter())
    return out / "turn.mp4"


def enlarged(picture: Pixels) -> Pixels:
    """As large as captions need to be legible."""
    return np.repeat(np.repeat(picture, 6, axis=0), 6, axis=1)


def frame_of(video: Path, number: int, scratch: Path) -> Pixels:
    """The picture that Blender's sequencer shows of a video at a frame."""
    bpy.ops.wm.read_homefile(use_empty=True)
    scene = bpy.context.scene
    set_display(scene, Display.SCENE_LINEAR)
    set_png(scene)
    strip = scene.sequence_editor_create().strips.new_movie("video", str(video), 1, 1, fit_method="ORIGINAL")
    element = strip.elements[0]
    scene.render.resolution_x, scene.render.resolution_y = element.orig_width, element.orig_height
    scene.render.engine = "CYCLES"  # with EEVEE, Blender aborts where there is no OpenGL
    scene.render.filepath = str(scratch / f"{number}.png")
    scene.frame_set(number)
    bpy.ops.render.render(write_still=True)
    return read_picture(scratch / f"{number}.png")


def assert_alike(shown: Pixels, expected: Pixels) -> None:
    assert shown.shape == expected.shape
    assert np.abs(shown.astype(int) - expected).mean() < CLOSE


def test_a_video_shows_its_pictures_in_order_at_its_pace(tmp_path):
    sequence(tmp_path / "a", 5)
    heard = Heard()
    video = make(tmp_path, "a", reporter=heard)
    clip = bpy.data.movieclips.load(str(video))
    assert (clip.frame_duration, clip.fps) == (5, 12.0)
    for number in (1, 4):
        assert_alike(frame_of(video, number, tmp_path), number_picture(number))
    assert heard.fractions == [0.2, 0.4, 0.6, 0.8, 1.0]
    assert sorted(path.name for path in tmp_path.iterdir() if path.suffix == ".mp4") == ["turn.mp4"]


def test_a_video_is_made_in_the_folder_of_exactly_that_name(tmp_path):
    out = tmp_path / "{wip}"
    sequence(out / "a", 2)
    assert make(out, "a", frames=2).is_file()
    assert [path.name for path in tmp_path.iterdir()] == ["{wip}"]


def test_sequences_stand_side_by_side(tmp_path):
    sequence(tmp_path / "a", 3, hue=0)
    sequence(tmp_path / "b", 3, hue=2)
    shown = frame_of(make(tmp_path, "a", "b", frames=3), 2, tmp_path)
    width, height = SIZE
    assert shown.shape[0] == height
    assert_alike(shown[:, :width], number_picture(2, 0))
    assert_alike(shown[:, -width:], number_picture(2, 2))


def test_captions_stand_above_the_pictures_that_they_are_of(tmp_path):
    for name, hue in (("a", 0), ("b", 2)):
        for number in (1, 2, 3):
            write_picture(tmp_path / name / f"{number:04d}.png", enlarged(number_picture(number, hue)))
    shown = frame_of(make(tmp_path, "a", "b", frames=3, captions=("", "as others see it")), 3, tmp_path)
    height, width = enlarged(number_picture(1)).shape[:2]
    band = shown.shape[0] - height
    assert band > 0
    left, right = shown[:band, :width], shown[:band, -width:]
    assert left.max() < DARK
    assert right.max() > LIGHT
    assert right[:, -1].max() < DARK  # the caption ends before the video does
    assert_alike(shown[band:, :width], enlarged(number_picture(3, 0)))
    assert_alike(shown[band:, -width:], enlarged(number_picture(3, 2)))


def test_pictures_of_odd_size_make_a_video_too(tmp_path):
    for number in (1, 2):
        write_picture(tmp_path / "a" / f"{number:04d}.png", number_picture(number)[1:, 1:])
    shown = frame_of(make(tmp_path, "a", frames=2), 1, tmp_path)
    assert shown.shape[:2] == (SIZE[1], SIZE[0])


def test_a_missing_picture_is_named_and_nothing_is_written(tmp_path):
    sequence(tmp_path / "a", 3)
    with pytest.raises(InputError, match=r"a/0004\.png: no such picture"):
        make(tmp_path, "a", frames=4)
    assert not list(tmp_path.glob("*.mp4"))


def test_an_empty_picture_is_refused(tmp_path):
    sequence(tmp_path / "a", 2)
    (tmp_path / "a" / "0001.png").write_bytes(b"")
    with pytest.raises(InputError, match="cannot be read as a picture"):
        make(tmp_path, "a", frames=2)
