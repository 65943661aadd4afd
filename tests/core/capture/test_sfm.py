"""Cameras of photographs that have none. (The success on real photographs is in test_evaluation_data.)"""

from __future__ import annotations

import errno
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pillow_heif
import pycolmap
import pytest
from PIL import Image
from PIL.TiffImagePlugin import IFDRational

from cvdgs.core.capture import sfm
from cvdgs.core.capture.images import read_pixels
from cvdgs.core.capture.material import find_material, make_photographs
from cvdgs.core.capture.reader import read_capture
from cvdgs.core.capture.sfm import estimate_cameras, number_cameras
from cvdgs.core.capture.sfm_verdict import Frame
from cvdgs.core.demo import SHOWROOM
from cvdgs.core.errors import Cancelled, InputError
from cvdgs.core.runtime.progress import CAMERAS
from cvdgs.core.runtime.protocol import Reporter

from ..intake.dng import RATIONAL, SHORT, write_dng
from .make_captures import save


def save_noise(folder: Path, count: int, size: int) -> None:
    """Photographs of nothing in common, full of features."""
    generator = np.random.default_rng(0)
    for index in range(count):
        coarse = generator.integers(0, 256, (size // 4, size // 4, 3)).astype(np.uint8)
        save(folder / f"{index}.png", coarse.repeat(4, axis=0).repeat(4, axis=1))


@pytest.fixture
def temporary(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where temporary files of this test lie, and no others."""
    folder = tmp_path_factory.mktemp("temporary")
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    return folder


def test_photographs_that_do_not_overlap_are_refused_and_nothing_is_left(tmp_path: Path, temporary: Path) -> None:
    save_noise(tmp_path, 3, 128)
    with pytest.raises(InputError, match="no cameras could be estimated"):
        read_capture(tmp_path, max_size=None, cameras="estimate")
    assert not list(temporary.iterdir())
    assert len(list(tmp_path.iterdir())) == 3


@pytest.mark.parametrize("size", [None, 320])
def test_progress_is_reported_step_by_step(tmp_path: Path, size: int | None) -> None:
    class Recorder(Reporter):
        def __init__(self) -> None:
            self.said: list[str] = []

        def status(self, stage: str, message: str) -> None:
            if stage == CAMERAS:
                self.said.append(message)

        def progress(self, stage: str, fraction: float, message: str = "") -> None:
            assert 0.0 <= fraction <= 1.0

    save_noise(tmp_path, 2, 128)
    recorder = Recorder()
    with pytest.raises(InputError):
        read_capture(tmp_path, max_size=size, cameras="estimate", reporter=recorder)
    steps = [
        "finding features in 2 photographs",
        "matching up to 1 pairs of photographs",
        "estimating the cameras of 2 photographs",
    ]
    again = [f"{step}, with more effort" for step in steps]
    reading = "reading 2 photographs"
    tried = [reading, *steps, *again]
    assert recorder.said == (tried if size is None else [reading, *steps, reading, *again, *again])


def test_frames_without_exif_share_a_camera_whose_focal_length_is_found_every_time_the_same(
    tmp_path: Path,
) -> None:
    # The demo's arc is a motion in which two focal lengths could not be told apart.
    showroom = SHOWROOM / "images"
    for path in sorted(showroom.iterdir())[::4]:
        shutil.copy(path, tmp_path)
    capture = read_capture(tmp_path, max_size=None, cameras="estimate")
    assert len(capture.views) == 10
    assert len({view.camera for view in capture.views}) == 1
    camera = capture.views[0].camera
    assert camera.fx == pytest.approx(480.0, rel=0.03)
    assert camera.fy == pytest.approx(camera.fx, rel=1e-6)
    again = read_capture(tmp_path, max_size=None, cameras="estimate")
    assert again.points.tobytes() == capture.points.tobytes()
    for view, other in zip(capture.views, again.views, strict=True):
        assert other.camera == view.camera
        assert other.world_to_camera.tobytes() == view.world_to_camera.tobytes()


@pytest.mark.parametrize("orientation", [3, 6, 8])
def test_photographs_of_a_telephone_held_upright_are_upright(tmp_path: Path, orientation: int) -> None:
    turns = {3: 2, 6: 1, 8: 3}[orientation]  # counter-clockwise quarters, which the orientation takes back
    for path in sorted((SHOWROOM / "images").iterdir())[::4]:
        stored = np.rot90(read_pixels(path)[0], turns)
        save(tmp_path / path.name, np.ascontiguousarray(stored), Orientation=orientation)
    capture = read_capture(tmp_path, max_size=None, cameras="estimate")
    assert {warning.name for warning in capture.warnings} >= {"exif-rotated"}
    for view in capture.views:
        assert (view.camera.width, view.camera.height) == (480, 360)
        assert view.image.shape == (360, 480, 3)
        # Undistortion moves edges, but leaves what is above and what is below; half a turn makes a difference of 30.
        photograph, _ = read_pixels(SHOWROOM / "images" / view.source.name)
        shown, expected = (image.reshape(6, 60, 8, 60, 3).mean(axis=(1, 3)) for image in (view.image, photograph))
        assert np.abs(shown - expected).mean() < 20.0
        in_camera = capture.points @ view.world_to_camera[:3, :3].T + view.world_to_camera[:3, 3]
        ahead = in_camera[in_camera[:, 2] > 0.0]
        x = view.camera.fx * ahead[:, 0] / ahead[:, 2] + view.camera.cx
        y = view.camera.fy * ahead[:, 1] / ahead[:, 2] + view.camera.cy
        seen = (x > 0.0) & (x < 480.0) & (y > 0.0) & (y < 360.0)
        # A place has one colour in all photographs, so the points' colours are the photograph's where they fall.
        colors = view.image[y[seen].astype(int), x[seen].astype(int)].astype(float)
        assert np.median(np.abs(colors - capture.point_colors[in_camera[:, 2] > 0.0][seen])) < 22.0


def test_photographs_are_numbered_by_camera_and_a_video_has_one(tmp_path: Path) -> None:
    def take(name: str, size: int, **exif: str) -> None:
        save(tmp_path / name, np.zeros((size, 20, 3), np.uint8), **exif)

    take("a.jpg", 20)
    take("b.jpg", 30)
    take("c.jpg", 20, Model="a telephone")
    take("d.jpg", 20)
    take("e.jpg", 20)
    frames = {"e.jpg": Frame(0.0, "walk.mp4")}
    assert number_cameras(tmp_path, ["a.jpg", "b.jpg", "c.jpg", "d.jpg", "e.jpg"], frames) == [0, 1, 2, 0, 3]


@pytest.mark.parametrize("ending", ["jpg", "webp", "heic", "dng"])
def test_zoomed_photographs_have_a_camera_of_their_own(
    tmp_path: Path, tmp_path_factory: pytest.TempPathFactory, ending: str
) -> None:
    def take(number: int, equivalent: int = 0, zoom: float = 0.0) -> str:
        pixels = np.full((64, 96, 3), 90 + number, np.uint8)
        tags = Image.Exif()
        tags[0x010F], tags[0x0110] = "Acme", "Acme One"
        further = tags.get_ifd(0x8769)
        further[0x920A], further[0xA405] = IFDRational(57, 10), equivalent
        further[0xA404] = IFDRational(round(zoom * 1000), 1000)
        path = tmp_path / f"{number}.{ending}"
        if ending == "dng":
            focal, ratio = [57, 10], [round(zoom * 1000), 1000]
            exif = [(0x920A, RATIONAL, focal), (0xA404, RATIONAL, ratio), (0xA405, SHORT, [equivalent])]
            write_dng(path, pixels / 255.0, exif=exif)
        elif ending == "heic":
            pillow_heif.from_pillow(Image.fromarray(pixels)).save(path, exif=tags.tobytes())
        else:
            Image.fromarray(pixels).save(path, exif=tags)
        return path.name

    lenses = ((24, 0.0), (48, 0.0), (24, 1.0), (24, 2.0), (24, 1.001), (0, 2.0), (48, 0.0))
    names = [take(number, *lens) for number, lens in enumerate(lenses)]
    assert number_cameras(tmp_path, names, {}) == [0, 1, 0, 2, 0, 3, 1]
    made = make_photographs(find_material(tmp_path), tmp_path_factory.mktemp("made"), Reporter())
    assert number_cameras(made.folder, made.names, {}) == [0, 1, 0, 2, 0, 3, 1], "as estimation has them"
    if ending in ("heic", "dng"):  # the converted ones; pycolmap reads no WebP
        told = pycolmap.infer_camera_from_image(made.folder / made.names[0], pycolmap.ImageReaderOptions())
        assert told.has_prior_focal_length


def test_names_may_hold_spaces_and_lie_in_folders(tmp_path: Path) -> None:
    for number, path in enumerate(sorted((SHOWROOM / "images").iterdir())[::4]):
        target = tmp_path / f"shelf {number % 2}" / f"photo {number} é.png"
        target.parent.mkdir(exist_ok=True)
        shutil.copy(path, target)
    capture = read_capture(tmp_path, max_size=160, cameras="estimate")
    assert len(capture.views) == 10
    assert capture.estimate is not None
    assert (capture.estimate.photographs, capture.estimate.placed, capture.estimate.sheet) == (10, 10, None)


@pytest.mark.slow
def test_progress_goes_on_from_step_to_step_and_the_time_is_forecast(tmp_path: Path) -> None:
    class Recorder(Reporter):
        def __init__(self) -> None:
            self.fractions: list[float] = []
            self.said: list[str] = []
            self.seconds: dict[str, float] = {}

        def progress(self, stage: str, fraction: float, message: str = "") -> None:
            if stage == CAMERAS:
                self.fractions.append(fraction)
                self.said.append(message)

        def forecast(self, seconds: Mapping[str, float]) -> None:
            self.seconds |= seconds

    for path in sorted((SHOWROOM / "images").iterdir())[::2]:
        shutil.copy(path, tmp_path)
    recorder = Recorder()
    read_capture(tmp_path, max_size=None, cameras="estimate", reporter=recorder)
    assert recorder.fractions == sorted(recorder.fractions)
    assert recorder.fractions[-1] == pytest.approx(1.0)
    assert "100 of 190 pairs matched" in recorder.said
    assert len({said for said in recorder.said if said.endswith("of the photographs placed")}) >= 3
    assert set(recorder.seconds) == {CAMERAS}
    assert recorder.seconds[CAMERAS] > 1.0


def test_a_photograph_that_is_cut_is_named_and_refused(tmp_path: Path) -> None:
    save_noise(tmp_path, 3, 128)
    whole = (tmp_path / "1.png").read_bytes()
    (tmp_path / "1.png").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputError, match=r"1\.png"):
        read_capture(tmp_path, max_size=None, cameras="estimate")


def test_a_folder_that_cannot_be_written_to_is_a_fault_of_the_machine(tmp_path: Path) -> None:
    save_noise(tmp_path, 2, 128)
    with pytest.raises(InputError, match=r"gone.*: No such file or directory - free space or check the permissions"):
        estimate_cameras(tmp_path, ["0.png", "1.png"], tmp_path / "gone", Reporter())


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such signals")
@pytest.mark.parametrize(
    ("ended_by", "free", "error", "complaint"),
    [
        (signal.SIGKILL, 1 << 30, InputError, "killed during its start, most likely because .* memory .* run again"),
        (signal.SIGABRT, 4096, OSError, os.strerror(errno.ENOSPC)),
        (signal.SIGABRT, 1 << 30, RuntimeError, "ended unexpectedly during its start"),
    ],
)
def test_an_estimation_that_the_machine_ended_is_told_from_a_defect(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    ended_by: signal.Signals,
    free: int,
    error: type[Exception],
    complaint: str,
) -> None:
    save_noise(tmp_path, 2, 128)
    program = f"import os; os.kill(os.getpid(), {int(ended_by)})"
    process = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, encoding="utf-8")
    monkeypatch.setattr(sfm, "_start", lambda job: process)
    monkeypatch.setattr(shutil, "disk_usage", lambda path: SimpleNamespace(free=free))
    with pytest.raises(error, match=complaint):
        estimate_cameras(tmp_path, ["0.png", "1.png"], tmp_path, Reporter())


@pytest.mark.slow
def test_dark_blurred_frames_are_placed_by_the_features_that_even_contrast_shows(tmp_path: Path) -> None:
    generator = np.random.default_rng(0)
    for path in sorted((SHOWROOM / "images").iterdir())[::2]:
        light = read_pixels(path)[0].astype(np.float32)
        blurred = (np.roll(light, 1, 0) + np.roll(light, -1, 0) + np.roll(light, 1, 1) + np.roll(light, -1, 1)) / 4
        dark = 0.1 * blurred + generator.normal(0.0, 0.7, light.shape)
        save(tmp_path / path.name, np.clip(dark, 0, 255).astype(np.uint8))
    capture = read_capture(tmp_path, max_size=None, cameras="estimate")
    assert len(capture.views) >= 16
    assert capture.views[0].camera.fx == pytest.approx(480.0, rel=0.03)


@pytest.mark.slow
def test_strays_are_left_out_shown_and_named(tmp_path: Path) -> None:
    for path in sorted((SHOWROOM / "images").iterdir())[::4]:
        shutil.copy(path, tmp_path)
    generator = np.random.default_rng(0)
    for name in ("z1.png", "z2.png"):
        save(tmp_path / name, generator.integers(0, 256, (90, 120, 3)).astype(np.uint8).repeat(4, 0).repeat(4, 1))
    capture = read_capture(tmp_path, max_size=160, cameras="estimate")
    assert len(capture.views) == 10
    (warning,) = (warning for warning in capture.warnings if warning.name == "not-placed")
    assert "10 of 12 photographs could be connected" in warning.message
    assert "z1.png" in warning.message
    assert capture.estimate is not None
    assert capture.estimate.sheet is not None
    vermilion = (capture.estimate.sheet == (213, 94, 0)).all(axis=2)
    assert vermilion.any()
    assert not vermilion[: len(vermilion) // 2].any()


def test_cancelling_stops_at_the_next_picture_and_leaves_nothing(tmp_path: Path, temporary: Path) -> None:
    class Impatient(Reporter):
        asked = 0

        def progress(self, stage: str, fraction: float, message: str = "") -> None:
            if stage == CAMERAS:
                self.asked += 1
                raise Cancelled

    save_noise(tmp_path, 12, 1000)
    reporter = Impatient()
    with pytest.raises(Cancelled):
        read_capture(tmp_path, max_size=None, cameras="estimate", reporter=reporter)
    assert reporter.asked == 1
    assert not list(temporary.iterdir())
