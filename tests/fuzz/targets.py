"""What is fuzzed: a function for every reader that takes the bytes of a file and lets nothing but `InputError` out.

A target also checks what it was given: everything finite, every path inside the folder, every refusal one short line.
"""

from __future__ import annotations

import json
import os
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from functools import cache
from pathlib import Path

import numpy as np

from cvdgs.core.batch.batch_file import read_batch
from cvdgs.core.batch.records import is_done, record_path
from cvdgs.core.batch.task import read_plan
from cvdgs.core.batch.toml_reader import UnusableFile
from cvdgs.core.capture.colmap import find_colmap, read_colmap
from cvdgs.core.capture.images import MAX_SIDE, ImageHeader, read_header, read_pixels
from cvdgs.core.capture.masks import read_mask, resized_mask
from cvdgs.core.capture.points import read_point_cloud
from cvdgs.core.capture.sfm_verdict import read_frames
from cvdgs.core.capture.source import SourceModel
from cvdgs.core.capture.tags import find_tags
from cvdgs.core.capture.transforms import read_transforms
from cvdgs.core.color.profiles import DISPLAY_P3, can_convert, convert_to_srgb
from cvdgs.core.errors import MOST_CHARACTERS, InputError
from cvdgs.core.files.untrusted import parse_json
from cvdgs.core.intake.archive import unpack
from cvdgs.core.intake.selection import choose
from cvdgs.core.intake.video import extract, look_through
from cvdgs.core.photographs.front import EnhanceRequest
from cvdgs.core.runs.enhanced import enhanced_files
from cvdgs.core.runs.report import check_finished_run, check_report, report_or_nothing
from cvdgs.core.runtime.progress import RunProgress, format_seconds
from cvdgs.core.runtime.protocol import parse_event
from cvdgs.core.settings import Settings
from cvdgs.core.splats.io.files import read_gaussians
from cvdgs.core.splats.io.ply import read_floaters
from cvdgs.core.worker import parse_request

from . import examples

SECONDS = 5.0
"""Of processor time that reading one file of a fuzzer's size may take; more is a hang."""
_MOST_TAG_SIDE = 1600  # pixels
_ESCAPED_LENGTH = 10  # of a character's longest escape sequence: a backslash, U and eight digits


@dataclass(frozen=True)
class Target:
    """A reader.

    Attributes:
        name: for reports and folders of seeds.
        read: takes a file's content.
        examples: makes valid contents to begin with.
    """

    name: str
    read: Callable[[bytes], None]
    examples: Callable[[], Sequence[bytes]]

    def __call__(self, data: bytes) -> None:
        """Read `data`; an `InputError` is as good as success.

        Raises:
            AssertionError: it took too long, or the refusal is not one short line.
            Exception: whatever else the reader did not expect.
        """
        started = time.process_time()
        try:
            self.read(data)
        except InputError as error:
            _check_refusal(error)
        assert time.process_time() - started < SECONDS, "a hang"


def _check_refusal(error: InputError) -> None:
    for line in error.lines() if isinstance(error, UnusableFile) else [str(error)]:
        assert line.isprintable(), line
        assert 0 < len(line) <= _ESCAPED_LENGTH * MOST_CHARACTERS, line


@cache
def _folder() -> tempfile.TemporaryDirectory:
    """One for the process, in memory where the system offers that; removed when it ends."""
    in_memory = Path("/dev/shm")
    place = in_memory if os.access(in_memory, os.W_OK) else None
    return tempfile.TemporaryDirectory(prefix="cvdgs-fuzz-", dir=place)


def _file(name: str, data: bytes) -> Path:
    path = Path(_folder().name, name)
    try:
        path.write_bytes(data)
    except FileNotFoundError:  # at first; looking each time would take as long as some readers do
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    return path


@cache
def _capture(name: str) -> Path:
    """A folder with three photographs and points."""
    folder = _file(f"{name}/points.ply", examples.point_clouds()[0]).parent
    for image in examples.NAMES:
        _file(f"{name}/{image}", examples.picture(".png"))
    return folder


def _check_model(model: SourceModel, folder: Path) -> None:
    for view in model.views:
        assert view.path.resolve().is_relative_to(folder.resolve())
        assert view.path.is_file()
        assert np.isfinite(view.world_to_camera).all()
        assert np.isfinite(view.camera.params).all()
    assert model.points.shape == model.point_colors.shape
    assert all(warning.message.isprintable() for warning in model.warnings)


def _colmap(name: str, *, text: bool) -> Target:
    @cache
    def folder_with_model() -> Path:
        for other, content in examples.colmap_files(text=text).items():
            _file(f"colmap-{name}/sparse/{other}", content)
        return _capture(f"colmap-{name}")

    def read(data: bytes) -> None:
        folder = folder_with_model()
        _file(f"colmap-{name}/sparse/{name}", data)
        found = find_colmap(folder)
        assert found is not None
        _check_model(read_colmap(found), folder)

    return Target(f"colmap-{name}", read, lambda: [examples.colmap_files(text=text)[name]])


def _read_transforms(data: bytes) -> None:
    folder = _capture("transforms")
    _check_model(read_transforms(_file("transforms/transforms.json", data)), folder)


def _read_points(data: bytes) -> None:
    points, colors = read_point_cloud(_file("points.ply", data))
    assert points.shape == colors.shape


def _gaussians(suffix: str, make: Callable[[], list[bytes]]) -> Target:
    def read(data: bytes) -> None:
        read_back = read_gaussians(_file(f"splats{suffix}", data))
        for field in fields(read_back):
            assert np.isfinite(getattr(read_back, field.name)).all()

    return Target(f"gaussians{suffix}", read, make)


def _picture(suffix: str) -> Target:
    def read(data: bytes) -> None:
        path = _file(f"picture{suffix}", data)
        header = read_header(path, min_side=1)
        assert 1 <= max(header.upright_size) <= MAX_SIDE
        color, alpha = read_pixels(path, upright=True, min_side=1)
        assert color.shape == (*header.upright_size[::-1], 3)
        assert alpha is None or alpha.shape == color.shape[:2]

    return Target(f"image{suffix}", read, lambda: [examples.picture(suffix)])


def _photograph(suffix: str) -> Target:
    return Target(f"image{suffix}", _picture(suffix).read, lambda: examples.photographs(suffix))


def _read_mask(data: bytes) -> None:
    header = ImageHeader(examples.SIDE, 2 * examples.SIDE, orientation=6)
    for upright in (False, True):
        mask = read_mask(_file("mask.png", data), header, upright=upright)
        assert set(np.unique(mask)) <= {0, 255}
        assert (mask.shape[0] > mask.shape[1]) != upright
        assert resized_mask(mask, 8, 8).shape == (8, 8)


def _read_tags(data: bytes) -> None:
    path = _file("tags.ppm", data)
    header = read_header(path)
    if max(header.upright_size) > _MOST_TAG_SIDE:  # photographs are made smaller than that before
        return
    for tag in find_tags(read_pixels(path)[0]):
        assert np.isfinite(tag.corners).all()


def _read_frames(data: bytes) -> None:
    folder = _file("frames/frames.json", data).parent
    assert all(np.isfinite(frame.time) for frame in read_frames(folder).values())


def _read_video(data: bytes) -> None:
    look = look_through(_file("film.mp4", data))
    assert all(np.isfinite(frame.time) for frame in look.film.frames)
    (chosen,) = choose([look.film])
    extract(look, chosen[:3], Path(_folder().name, "frames"), look.white)


def _read_zip(data: bytes) -> None:
    with tempfile.TemporaryDirectory(dir=_folder().name) as inside:
        folder = Path(inside, "a", "b")
        folder.mkdir(parents=True)
        try:
            unpack(_file("capture.zip", data), folder)
        finally:
            assert os.listdir(inside) == ["a"]
            assert os.listdir(Path(inside, "a")) == ["b"]
            assert not any(path.is_symlink() for path in folder.rglob("*"))


def _read_profile(data: bytes) -> None:
    color = np.full((2, 2, 3), 100, np.uint8)
    assert convert_to_srgb(color, data) == can_convert(data)


def _read_network(data: bytes) -> None:
    from cvdgs.core.enhance.scene.storage import is_scene_network, load_network

    path = _file("network.safetensors", data)
    assert is_scene_network(path) in (True, False)
    fitted = load_network(path)
    assert all(np.isfinite(value.numpy()).all() for value in fitted.network.state_dict().values())
    assert np.isfinite([fitted.budget, fitted.change]).all()


def _read_floaters(data: bytes) -> None:
    scores = read_floaters(_file("floaters.ply", data))
    assert scores is None or ((scores >= 0.0) & (scores <= 1.0)).all()


def _read_weights(data: bytes) -> None:
    from cvdgs.core.enhance.gan.weights import load_generator

    load_generator(_file("weights.safetensors", data))


def _read_lut(data: bytes) -> None:
    from cvdgs.core.enhance.lut import ColorLut

    lut = ColorLut.load(_file("lut.safetensors", data))
    assert np.isfinite(lut(np.zeros((2, 2, 3), np.uint8))).all()


@cache
def _finished_run(name: str) -> Path:
    """A folder with the files of a finished run, as far as they are looked at."""
    for file in ("splats.ply", "splats.deutan-1.0.ply", "capture/transforms.json"):
        _file(f"{name}/{file}", b"")
    return _file(f"{name}/report.json", json.dumps(examples.report()).encode()).parent


def _read_batch(data: bytes) -> None:
    _finished_run("run")  # that the example names
    (Path(_folder().name) / "batch" / "capture").mkdir(parents=True, exist_ok=True)
    batch = read_batch(_file("batch/batch.toml", data))
    assert batch.items


def _read_request(data: bytes) -> None:
    request = parse_request(data.decode("utf-8", "replace"))
    if request["job"] == "run":
        Settings.from_dict(request["settings"])
    if request["job"] == "enhance":
        EnhanceRequest.from_dict(request["request"])


def _read_event(data: bytes) -> None:
    event = parse_event(data.decode("utf-8", "replace"))
    if event is None:
        return
    assert event["event"] == "result" or event.get("message", "").isprintable()
    progress = RunProgress(("geometry", "layers"))
    progress.update(event)
    assert 0.0 <= progress.fraction <= 1.0
    left = progress.seconds_left
    assert left is None or format_seconds(left)


def _read_report(data: bytes) -> None:
    folder = _finished_run("reported")
    (folder / "report.json").write_bytes(data)
    report_or_nothing(folder)
    check_finished_run(folder)


def _read_report_to_resume(data: bytes) -> None:
    try:
        report = parse_json(data.decode("utf-8", "replace"))
        check_report(report)
    except ValueError:
        return
    Settings.from_dict(report["settings"])


def _read_record(data: bytes) -> None:
    (task,) = read_plan(_file("show/.batch/plan.json", examples.plan())).tasks
    out = Path(_folder().name, "show")
    path = record_path(task, out)
    _file(path.relative_to(_folder().name).as_posix(), data)
    is_done(task, out)


def _read_metrics(data: bytes) -> None:
    folder = _file("enhanced/metrics.csv", data).parent
    for path in enhanced_files(folder):
        assert Path(os.path.realpath(path)).parent == folder.resolve()


def _read_plan(data: bytes) -> None:
    plan = read_plan(_file("show/.batch/plan.json", data))
    for task in plan.tasks:
        for path in task.output_paths(plan.out):
            assert Path(os.path.normpath(path)).is_relative_to(plan.out)


TARGETS: tuple[Target, ...] = (
    *(_colmap(f"{name}.bin", text=False) for name in ("cameras", "images", "points3D")),
    *(_colmap(f"{name}.txt", text=True) for name in ("cameras", "images", "points3D")),
    Target("transforms.json", _read_transforms, examples.transforms),
    Target("points.ply", _read_points, examples.point_clouds),
    _gaussians(".ply", examples.gaussian_plys),
    _gaussians(".spz", examples.spzs),
    _gaussians(".splat", examples.splats),
    _gaussians(".glb", examples.glbs),
    *(_picture(suffix) for suffix in (".png", ".jpg", ".tif", ".exr", ".webp", ".bmp", ".tga", ".hdr", ".ppm")),
    *(_photograph(suffix) for suffix in (".heic", ".avif", ".dng")),
    Target("mask.png", _read_mask, examples.masks),
    Target("tags.ppm", _read_tags, examples.tags),
    Target("frames.json", _read_frames, lambda: [examples.FRAMES]),
    Target("video.mp4", _read_video, examples.videos),
    Target("capture.zip", _read_zip, examples.archives),
    Target("profile.icc", _read_profile, lambda: [DISPLAY_P3]),
    Target("weights.safetensors", _read_weights, examples.weights),
    Target("lut.safetensors", _read_lut, examples.luts),
    Target("network.safetensors", _read_network, examples.networks),
    Target("floaters.ply", _read_floaters, examples.scored_plys),
    Target("batch.toml", _read_batch, lambda: [examples.BATCH]),
    Target("worker-request", _read_request, examples.requests),
    Target("worker-event", _read_event, examples.events),
    Target("report.json", _read_report, lambda: [json.dumps(examples.report()).encode()]),
    Target("report-to-resume", _read_report_to_resume, lambda: [json.dumps(examples.report()).encode()]),
    Target("plan.json", _read_plan, lambda: [examples.plan()]),
    Target("task-record", _read_record, lambda: [examples.record()]),
    Target("metrics.csv", _read_metrics, lambda: [examples.METRICS]),
)
