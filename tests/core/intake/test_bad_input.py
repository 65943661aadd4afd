"""What nobody can use ends run.py in one line and exit code 2, leaves nothing, and takes bounded memory and time."""

from __future__ import annotations

import os
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from cvdgs.core.bootstrap import ROOT

from .films import wall, window, write_video
from .test_archive import write_zip
from .test_photographs import heic_with_size
from .test_video_files import big, encrypted, encrypted_by_another, sound_alone, still_as_video

pytestmark = [
    pytest.mark.skipif(sys.platform != "linux", reason="asks the system for the memory of a process's children"),
    pytest.mark.timeout(120),  # on a busy machine; alone it is two or three
]

WALL = wall()
MOST_MB = 1500  # a worker without a capture has 500
# Runs a command and prints the most memory in KiB that it or one of its workers had. A process inherits the peak of the
# one that starts it, so that must not be the tests' own, which may have had much.
MEASURED = """
import resource, subprocess, sys
code = subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL).returncode
print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)
sys.exit(code)
"""


def no_frame(path: Path) -> None:
    """A track whose only frame is cut off."""
    write_video(path, [window(WALL, 50)], container_options={"movflags": "faststart"})
    data = path.read_bytes()
    path.write_bytes(data[: data.index(b"mdat") + 4])


def cut_before_its_index(path: Path) -> None:
    data = write_video(path, [window(WALL, 50 + 4 * step) for step in range(20)]).read_bytes()
    path.write_bytes(data[: len(data) // 2])


def in_folder(folder: Path, name: str, make: Callable[[Path], object]) -> Path:
    """`folder` with what `make` writes to `name`, beside a photograph."""
    folder.mkdir()
    make(folder / name)
    Image.fromarray(window(WALL, 50)).save(folder / "a.jpg")
    return folder


def video_named_photograph(path: Path) -> None:
    write_video(path.with_suffix(".mp4"), [window(WALL, 50 + 4 * step) for step in range(20)]).rename(path)


def text(path: Path) -> None:
    path.write_text("not a picture")


def raw_of_an_unknown_camera(path: Path) -> None:
    Image.fromarray(window(WALL, 50)).save(path.with_suffix(".tif"))
    path.with_suffix(".tif").rename(path)


def masks_of_another_size(folder: Path) -> Path:
    for name in ("images", "masks"):
        (folder / name).mkdir(parents=True)
    for number in range(3):
        Image.fromarray(window(WALL, 50 + 20 * number)).save(folder / "images" / f"{number}.jpg")
        Image.fromarray(np.full((100, 100), 255, np.uint8)).save(folder / "masks" / f"{number}.png")
    return folder


def video(make: Callable[[Path], object]) -> Callable[[Path], Path]:
    def made(folder: Path) -> Path:
        make(folder / "x.mp4")
        return folder / "x.mp4"

    return made


def photograph(name: str, make: Callable[[Path], object]) -> Callable[[Path], Path]:
    return lambda folder: in_folder(folder / "photographs", name, make)


def archive(files: dict[str, bytes], compression: int = zipfile.ZIP_STORED) -> Callable[[Path], Path]:
    return lambda folder: write_zip(folder / "x.zip", files, compression)


INPUTS: dict[str, tuple[Callable[[Path], Path], str]] = {
    "zero frames": (video(no_frame), "no frames"),
    "cut": (video(cut_before_its_index), "cut short"),
    "sound": (video(sound_alone), "only sound"),
    "still": (video(still_as_video), "is a photograph, not a video"),
    "8K": (video(big), "7680 x 4320"),
    "encrypted": (video(encrypted), "encrypted"),
    "encrypted, codec hidden": (video(encrypted_by_another), "encrypted"),
    "text as video": (video(text), "not read"),
    "video as photograph": (photograph("1.jpg", video_named_photograph), "is a video with a photograph's name"),
    "text as photograph": (photograph("1.jpg", text), "1.jpg"),
    "HEIC of tiles": (photograph("1.heic", lambda path: heic_with_size(path, 60_000, 60_000)), "1.heic"),
    "unknown RAW": (photograph("1.nef", raw_of_an_unknown_camera), "convert it to DNG"),
    "masks": (lambda folder: masks_of_another_size(folder / "room"), "100 x 100"),
    "zip with ..": (archive({"../../x.jpg": b"x"}), "path"),
    "zip bomb": (archive({"x.png": bytes(300 << 20)}, zipfile.ZIP_DEFLATED), "photographs never do"),
}


@pytest.mark.parametrize("name", INPUTS)
def test_bad_input_is_one_line_and_exit_code_2_and_nothing_is_left(tmp_path: Path, name: str) -> None:
    make, words = INPUTS[name]
    options = () if name == "cut" else ("--no-blend",)  # Blender is looked for first, and leaves nothing either
    for folder in ("given", "made", "temporary"):
        (tmp_path / folder).mkdir()
    capture = make(tmp_path / "given")
    given = sorted(tmp_path.joinpath("given").rglob("*"))
    run = [sys.executable, ROOT / "scripts" / "run.py", capture, "--out", tmp_path / "made" / "out", *options]
    done = subprocess.run(
        [sys.executable, "-c", MEASURED, *run],
        env={**os.environ, "CVDGS_PYTHON": sys.executable, "TMPDIR": str(tmp_path / "temporary")},
        capture_output=True,
        text=True,
        check=False,
    )
    said = done.stderr
    assert done.returncode == 2, said
    assert int(done.stdout) < MOST_MB << 10
    reason = said.splitlines()[-1]
    assert words in reason
    assert reason.startswith("run.py: ")
    assert "Traceback" not in said
    assert not [line for line in said.splitlines() if line.startswith("run.py: ")][1:]
    assert not list((tmp_path / "made").iterdir())
    assert not list((tmp_path / "temporary").iterdir())
    assert sorted(tmp_path.joinpath("given").rglob("*")) == given
