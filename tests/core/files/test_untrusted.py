"""What is said of files that are not what their names promise, whoever reads them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from cvdgs.core.capture.reader import inspect_capture
from cvdgs.core.errors import InputError
from cvdgs.core.files.untrusted import read_bytes, read_json
from cvdgs.core.splats.io.files import read_gaussians

from ..capture.make_captures import shots, write_colmap, write_transforms

POINTER = b"version https://git-lfs.github.com/spec/v1\noid sha256:" + b"0123456789abcdef" * 4 + b"\nsize 48000000\n"


def refused_as_pointer(path: Path, read: Callable[[], object]) -> None:
    path.write_bytes(POINTER)
    with pytest.raises(InputError, match=rf"{path.name}: only a Git LFS pointer.* - run 'git lfs pull'"):
        read()


@pytest.mark.parametrize("name", ["scene.ply", "scene.spz", "scene.splat", "scene.sog"])
def test_a_pointer_of_git_lfs_in_the_place_of_splats_is_called_one(tmp_path: Path, name: str) -> None:
    refused_as_pointer(tmp_path / name, lambda: read_gaussians(tmp_path / name))


@pytest.mark.parametrize(
    "name",
    [
        *("images/0002.png", "sparse/0/cameras.bin", "sparse/0/images.bin", "sparse/0/points3D.bin"),
        *("sparse/0/cameras.txt", "sparse/0/images.txt", "sparse/0/points3D.txt"),
    ],
)
def test_a_pointer_of_git_lfs_in_a_colmap_capture_is_called_one(tmp_path: Path, name: str) -> None:
    write_colmap(tmp_path, shots(3), text=name.endswith(".txt"))
    refused_as_pointer(tmp_path / name, lambda: inspect_capture(tmp_path))


def test_a_pointer_of_git_lfs_in_the_place_of_transforms_is_called_one(tmp_path: Path) -> None:
    write_transforms(tmp_path, shots(3))
    refused_as_pointer(tmp_path / "transforms.json", lambda: inspect_capture(tmp_path))


def test_small_files_are_read_from_their_beginning(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(POINTER[8:])
    assert read_bytes(tmp_path / "a", most_bytes=1000) == POINTER[8:]
    (tmp_path / "b").write_text("3")
    assert read_json(tmp_path / "b") == 3
