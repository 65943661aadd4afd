"""What is no file, what never ends, and what claims more than it holds: refused at once, within a stated memory."""

from __future__ import annotations

import gzip
import json
import os
import re
import struct
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cvdgs.core.batch.batch_file import read_batch
from cvdgs.core.batch.task import read_plan
from cvdgs.core.capture.images import read_header
from cvdgs.core.capture.points import read_point_cloud
from cvdgs.core.capture.reader import inspect_capture
from cvdgs.core.enhance.gan.weights import load_generator
from cvdgs.core.errors import InputError
from cvdgs.core.files.images import write_png
from cvdgs.core.files.untrusted import MAX_JSON_BYTES, opened, parse_json, partial_file, read_json, replacing
from cvdgs.core.runs.enhanced import enhanced_files
from cvdgs.core.runs.folder import RunFolder, remove_layer
from cvdgs.core.runs.report import read_report
from cvdgs.core.splats.io.files import read_gaussians
from cvdgs.core.splats.io.gltf import write_glb

from . import examples
from .targets import SECONDS

# Address space of a process that reads Gaussians, points and JSON: Python and numpy take half a gigabyte of it.
MEMORY_BYTES = 2 << 30


def _model(name: str) -> Callable[[Path], object]:
    """Reads a COLMAP capture in which `path` stands in the place of the file `name`."""

    def read(path: Path) -> object:
        folder = path.parent / "capture" / "sparse"
        folder.mkdir(parents=True)
        for other, content in examples.colmap_files(text=name.endswith(".txt")).items():
            if other != name:
                (folder / other).write_bytes(content)
        path.rename(folder / name)
        return inspect_capture(folder.parent)

    return read


READERS: dict[str, tuple[str, Callable[[Path], object]]] = {
    "gaussians": ("scene.ply", read_gaussians),
    "splat": ("scene.splat", read_gaussians),
    "points": ("points.ply", read_point_cloud),
    "image": ("photo.png", read_header),
    "transforms": ("transforms.json", lambda path: inspect_capture(path.parent)),
    "cameras": ("cameras.bin", _model("cameras.bin")),
    "points3D": ("points3D.txt", _model("points3D.txt")),
    "batch": ("batch.toml", read_batch),
    "plan": ("plan.json", read_plan),
    "report": ("report.json", lambda path: read_report(path.parent)),
    "weights": ("enhancer.safetensors", load_generator),
}
each_reader = pytest.mark.parametrize(("name", "read"), READERS.values(), ids=READERS)


def refusal(read: Callable[[Path], object], path: Path) -> str:
    """The one line with which `path` is refused."""
    with pytest.raises(InputError) as caught:
        read(path)
    assert str(caught.value).isprintable()
    return str(caught.value)


@each_reader
@pytest.mark.timeout(60)
def test_a_pipe_is_refused_without_waiting_for_it(tmp_path: Path, name: str, read: Callable[[Path], object]) -> None:
    os.mkfifo(tmp_path / name)
    refusal(read, tmp_path / name)


@each_reader
def test_a_folder_in_a_files_place_is_refused(tmp_path: Path, name: str, read: Callable[[Path], object]) -> None:
    (tmp_path / name).mkdir()
    refusal(read, tmp_path / name)


@each_reader
def test_a_link_to_itself_is_refused(tmp_path: Path, name: str, read: Callable[[Path], object]) -> None:
    (tmp_path / name).symlink_to(tmp_path / name)
    refusal(read, tmp_path / name)


@pytest.mark.skipif(not Path("/dev/zero").exists(), reason="the system has no /dev/zero")
@each_reader
@pytest.mark.timeout(60)
def test_a_device_is_refused(tmp_path: Path, name: str, read: Callable[[Path], object]) -> None:
    (tmp_path / name).symlink_to("/dev/zero")
    refusal(read, tmp_path / name)


@each_reader
def test_a_file_of_a_hundred_terabytes_is_refused(tmp_path: Path, name: str, read: Callable[[Path], object]) -> None:
    with open(tmp_path / name, "wb") as file:
        try:
            file.truncate(10**14)  # takes no room on the disk
        except OSError:
            file.truncate(10**12)
    refusal(read, tmp_path / name)


@pytest.mark.parametrize("name", ["a\0b", "\ud800", "a" * 5000])
def test_a_name_that_no_file_can_have_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError) as caught, opened(tmp_path / name, most_bytes=1):
        pass
    assert str(caught.value).isprintable()


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("[" * 100_000, "too deeply"),
        ('{"a": 1, "a": 2}', "'a' appears twice"),
        ("9" * 5000, "digits"),
        ("[NaN]", "not finite"),
        ("[1e999]", "not finite"),
    ],
    ids=["nesting", "twice", "digits", "nan", "overflow"],
)
def test_json_that_means_nothing_certain_is_refused(text: str, what: str) -> None:
    with pytest.raises(ValueError, match=what):
        parse_json(text)


def test_json_beyond_the_limit_is_not_read(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_bytes(b" " * (MAX_JSON_BYTES + 1))
    with pytest.raises(InputError, match="the limit is 32 MiB"):
        read_json(tmp_path / "a.json")


def _claiming_a_trillion(data: bytes, count: int) -> bytes:
    """A PLY file of `count` vertices that says it has more."""
    return data.replace(b"vertex %d\n" % count, b"vertex 1000000000000\n")


def _gzip_bomb() -> bytes:
    """A file that is long enough to be believed when it claims sixty million Gaussians, 14 GB of them."""
    header = struct.pack("<4sIIBBBB", b"NGSP", 3, 60_000_000, 3, 12, 0, 0)
    return gzip.compress(header + np.random.default_rng(0).bytes(4 << 20), 1)


def _glb_bomb() -> bytes:
    """A file of 3 MB whose layers, 5 GB of them, are all made of the same numbers."""
    one = examples.gaussians(40_000, 0)
    data = examples.written("a.glb", lambda path: write_glb(path, {"original": one}))
    (length,) = struct.unpack_from("<I", data, 12)
    document = json.loads(data[20 : 20 + length])
    (primitive,) = document["meshes"][0]["primitives"]
    colors = primitive["attributes"]["KHR_gaussian_splatting:SH_DEGREE_0_COEF_0"]
    terms = [f"KHR_gaussian_splatting:SH_DEGREE_{n}_COEF_{i}" for n in range(4) for i in range(2 * n + 1)]
    primitive["attributes"] |= dict.fromkeys(terms, colors)
    document["meshes"] = [{"primitives": [primitive]}] * 700
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    rest = data[20 + length :]
    return struct.pack("<4sIIII", b"glTF", 2, 20 + len(text) + len(rest), len(text), 0x4E4F534A) + text + rest


BOMBS: dict[str, tuple[str, Callable[[], bytes], str]] = {
    "ply": ("a.ply", lambda: _claiming_a_trillion(examples.gaussian_plys()[1], 3), "read_gaussians"),
    "points": ("a.ply", lambda: _claiming_a_trillion(examples.point_clouds()[0], 4), "read_point_cloud"),
    "spz": ("a.spz", _gzip_bomb, "read_gaussians"),
    "glb": ("a.glb", _glb_bomb, "read_gaussians"),
}

_CHILD = """
import resource, sys, time
from pathlib import Path
from cvdgs.core.capture.points import read_point_cloud
from cvdgs.core.errors import InputError
from cvdgs.core.splats.io.files import read_gaussians
from cvdgs.core.files.untrusted import read_json
resource.setrlimit(resource.RLIMIT_AS, ({0}, {0}))
started = time.process_time()
try:
    {1}(Path(sys.argv[1]))
except InputError as error:
    print(error)
assert time.process_time() - started < {2}, "a hang"
"""


@pytest.mark.parametrize(("name", "make", "reader"), BOMBS.values(), ids=BOMBS)
def test_a_bomb_does_not_take_more_memory_than_stated(
    tmp_path: Path, name: str, make: Callable[[], bytes], reader: str
) -> None:
    (tmp_path / name).write_bytes(make())
    assert re.search(r"cut short|it claims", _read_in_child(reader, tmp_path / name))


@pytest.mark.slow
def test_the_largest_json_does_not_take_more_memory_than_stated(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_bytes(b"[" + b"{}," * (MAX_JSON_BYTES // 3 - 2) + b"{}]")
    assert _read_in_child("read_json", tmp_path / "a.json") == ""


def _read_in_child(reader: str, path: Path) -> str:
    """Read `path` in a process with little memory; returns the refusal."""
    command = [sys.executable, "-c", _CHILD.format(MEMORY_BYTES, reader, SECONDS), str(path)]
    result = subprocess.run(command, capture_output=True, text=True, timeout=240)
    assert result.returncode == 0, result.stderr
    return result.stdout


def test_a_lock_that_is_a_link_leaves_the_linked_file_alone(tmp_path: Path) -> None:
    (tmp_path / "precious").write_text("mine")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / ".lock").symlink_to(tmp_path / "precious")
    with pytest.raises(InputError):
        RunFolder(tmp_path / "out")
    assert (tmp_path / "precious").read_text() == "mine"


@pytest.mark.parametrize("name", [".partial", ".complete", ".replaced", ".checkpoint"])
def test_a_folder_of_a_run_that_is_a_link_is_not_followed(tmp_path: Path, name: str) -> None:
    (tmp_path / "precious").mkdir()
    (tmp_path / "precious" / "file").write_text("mine")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / name).symlink_to(tmp_path / "precious")
    folder = RunFolder(tmp_path / "out")
    (folder.staging / "report.json").write_text("{}")
    folder.commit()
    assert not (tmp_path / "out" / name).is_symlink()
    assert [path.name for path in (tmp_path / "precious").iterdir()] == ["file"]
    assert (tmp_path / "out" / "report.json").read_text() == "{}"


@pytest.mark.parametrize("name", ["enhanced", "renders", "turntable"])
def test_a_layer_is_not_added_through_a_link_in_a_run_from_elsewhere(tmp_path: Path, name: str) -> None:
    (tmp_path / "photographs").mkdir()
    (tmp_path / "photographs" / "0001.png").write_text("mine")
    (tmp_path / "out" / name).mkdir(parents=True)
    (tmp_path / "out" / name / "protan-1.0").symlink_to(tmp_path / "photographs")
    (tmp_path / "out" / "report.json").write_text(json.dumps(examples.report()))
    folder = RunFolder(tmp_path / "out")
    folder.carry_over()
    remove_layer(folder.staging, "protan-1.0")
    write_png(folder.staging / name / "protan-1.0" / "0001.png", np.zeros((2, 2, 3), np.uint8))
    folder.commit()
    assert (tmp_path / "photographs" / "0001.png").read_text() == "mine"
    assert (tmp_path / "out" / name / "protan-1.0" / "0001.png").is_file()


def test_a_file_is_not_written_through_a_link_that_waits_in_its_folder(tmp_path: Path) -> None:
    (tmp_path / "precious").write_text("mine")
    partial_file(tmp_path / "scene.ply").symlink_to(tmp_path / "precious")
    with replacing(tmp_path / "scene.ply") as temporary:
        temporary.write_text("new")
    assert (tmp_path / "precious").read_text() == "mine"
    assert not (tmp_path / "scene.ply").is_symlink()
    assert (tmp_path / "scene.ply").read_text() == "new"


@pytest.mark.timeout(60)
def test_a_list_of_results_that_is_a_pipe_names_no_files(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "metrics.csv")
    assert enhanced_files(tmp_path) == []


def test_frames_beyond_the_limit_of_views_are_refused(tmp_path: Path) -> None:
    frames = [{"file_path": "a.png"}] * 20_001
    (tmp_path / "transforms.json").write_text(json.dumps({"frames": frames}))
    with pytest.raises(InputError, match="20,001 frames, the limit is 20,000"):
        inspect_capture(tmp_path)
