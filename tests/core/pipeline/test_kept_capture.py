"""Captures with estimated cameras that are kept for a run that goes on."""

import json
import zipfile
from pathlib import Path

import numpy as np
import pytest

from cvdgs.core.capture.model import Capture, CaptureWarning, Estimate, PinholeCamera, View
from cvdgs.core.capture.upright import UpDirection
from cvdgs.core.errors import InputError
from cvdgs.core.files.images import write_png
from cvdgs.core.pipeline.kept_capture import digest_of, from_state, to_state
from cvdgs.core.splats.training.checkpoints import Checkpoints

from ...few_views import write_few_views


def a_view(key: str, generator: np.random.Generator, **others) -> View:
    turn, _ = np.linalg.qr(generator.normal(size=(3, 3)))
    pose = np.eye(4)
    pose[:3, :3] = turn * np.sign(np.linalg.det(turn))
    pose[:3, 3] = generator.normal(size=3)
    image = generator.integers(0, 256, (6, 8, 3)).astype(np.uint8)
    return View(key, Path(f"{key}.jpg"), PinholeCamera(8, 6, 7.1, 7.2, 4.03, 2.9), pose, image, **others)


def a_capture(keys: tuple[str, ...] = ("a", "b")) -> Capture:
    generator = np.random.default_rng(0)
    whole = a_view(keys[0], generator)
    masked = a_view(
        keys[1],
        generator,
        time=1.25,
        mask=generator.random((6, 8)) > 0.5,
        alpha=generator.integers(0, 256, (6, 8)).astype(np.uint8),
        again=generator.integers(0, 256, (6, 8, 3)).astype(np.uint8),
    )
    return Capture(
        Path("film.mp4"),
        "sfm",
        (whole, masked),
        generator.normal(size=(5, 3)).astype(np.float32),
        generator.integers(0, 256, (5, 3)).astype(np.uint8),
        (CaptureWarning("video-cut", "it breaks off"),),
        Estimate(3, 2, (2,), (0.8123456789,), "global", generator.integers(0, 256, (4, 5, 3)).astype(np.uint8)),
        UpDirection(np.array([0.0, -1.0, 0.0]), "floor"),
        0.123,
    )


def kept(folder: Path, *, resume: bool) -> Checkpoints:
    return Checkpoints(folder, {}, resume=resume, warn=pytest.fail, every_seconds=1.0)


def kept_and_found(folder: Path, capture: Capture) -> Capture:
    kept(folder, resume=False).keep_capture(to_state(capture, capture.warnings), "of these")
    state = kept(folder, resume=True).kept_capture(lambda: "of these")
    assert state is not None
    return from_state(state, capture.source)


def same(first, second) -> bool:
    if isinstance(first, np.ndarray):
        return first.dtype == second.dtype and first.shape == second.shape and first.tobytes() == second.tobytes()
    if hasattr(first, "__dataclass_fields__"):
        return all(same(getattr(first, name), getattr(second, name)) for name in first.__dataclass_fields__)
    if isinstance(first, tuple):
        return len(first) == len(second) and all(map(same, first, second))
    return first == second


def test_a_kept_capture_comes_back_to_the_last_bit(tmp_path):
    capture = a_capture()
    assert same(kept_and_found(tmp_path / "kept", capture), capture)


def test_what_was_kept_of_other_photographs_is_not_taken(tmp_path):
    capture = a_capture()
    kept(tmp_path, resume=False).keep_capture(to_state(capture, ()), "of these")
    assert kept(tmp_path, resume=True).kept_capture(lambda: "of others") is None
    assert kept(tmp_path, resume=False).kept_capture(lambda: "of these") is None


@pytest.mark.parametrize("keys", [("../../a", "b"), ("a", "A"), ("a", "a/b")])
def test_a_kept_capture_whose_views_would_be_written_elsewhere_is_refused(tmp_path, keys):
    with pytest.raises(InputError, match="unusable names"):
        kept_and_found(tmp_path, a_capture(keys))


def test_a_kept_capture_that_is_cut_is_refused(tmp_path):
    kept(tmp_path, resume=False).keep_capture(to_state(a_capture(), ()), "of these")
    file = tmp_path / "capture.safetensors"
    file.write_bytes(file.read_bytes()[:-1])
    with pytest.raises(InputError, match="kept capture"):
        kept(tmp_path, resume=True).kept_capture(lambda: "of these")


@pytest.fixture
def photographs(tmp_path):
    for number in range(2):
        write_png(tmp_path / "images" / f"{number}.png", np.full((20, 20, 3), number, np.uint8))
    write_png(tmp_path / "masks" / "0.png", np.full((20, 20, 3), 255, np.uint8))
    return tmp_path


def test_another_file_another_name_and_another_size_are_another_capture(photographs):
    digests = [
        digest_of(photographs, "auto", 640, None),
        digest_of(photographs, "auto", 320, None),
        digest_of(photographs, "auto", 640, 0.15),
    ]
    assert digest_of(photographs, "auto", 640, None) == digests[0]
    write_png(photographs / "images" / "1.png", np.full((20, 20, 3), 9, np.uint8))
    digests.append(digest_of(photographs, "auto", 640, None))
    write_png(photographs / "masks" / "0.png", np.full((20, 20, 3), 254, np.uint8))
    digests.append(digest_of(photographs, "auto", 640, None))
    (photographs / "images" / "1.png").rename(photographs / "images" / "2.png")
    digests.append(digest_of(photographs, "auto", 640, None))
    write_png(photographs / "images_again" / "0.png", np.full((20, 20, 3), 1, np.uint8))
    digests.append(digest_of(photographs, "auto", 640, None))
    for name, frames in (("frames.json", []), ("images/frames.json", [{}])):
        (photographs / name).write_text(json.dumps({"frames": frames}))
        digests.append(digest_of(photographs, "auto", 640, None))
    assert len(set(digests)) == len(digests)


def test_cameras_that_were_estimated_for_an_archive_are_not_taken_for_its_own(tmp_path):
    with zipfile.ZipFile(tmp_path / "scene.zip", "w") as archive:
        archive.writestr("1.jpg", b"a photograph")
    digests = {digest_of(tmp_path / "scene.zip", cameras, 640, None) for cameras in ("auto", "estimate", "given")}
    assert len(digests) == 3


def test_where_cameras_are_given_nothing_was_kept(tmp_path):
    assert digest_of(write_few_views(tmp_path, 2, 0.1), "auto", 640, None) == ""
