"""Zips: what is in them arrives, and what leads out of them or is too much does not."""

from __future__ import annotations

import os
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from cvdgs.core.errors import InputError
from cvdgs.core.intake.archive import unpack


def write_zip(path: Path, files: dict[str, bytes], compression: int = zipfile.ZIP_STORED) -> Path:
    with zipfile.ZipFile(path, "w", compression) as archive:
        for name, content in files.items():
            archive.writestr(zipfile.ZipInfo(name), content, compression)
    return path


def refused(path: Path, folder: Path) -> str:
    folder.mkdir()
    with pytest.raises(InputError) as error:
        unpack(path, folder)
    return str(error.value)


@pytest.mark.parametrize("inside", ["", "my room/"])
def test_the_files_arrive_without_what_systems_add(tmp_path: Path, inside: str) -> None:
    files = {f"{inside}images/1.jpg": b"one", f"{inside}transforms.json": b"{}", f"{inside}.DS_Store": b"x"}
    path = write_zip(tmp_path / "x.zip", files | {"__MACOSX/._1.jpg": b"x", f"{inside}Icon\r": b"x"})
    (tmp_path / "out").mkdir()
    found = unpack(path, tmp_path / "out")
    names = {file.relative_to(found).as_posix() for file in found.rglob("*") if file.is_file()}
    assert names == {"images/1.jpg", "transforms.json"}
    assert (found / "images/1.jpg").read_bytes() == b"one"


@pytest.mark.parametrize("name", ["../out.jpg", "a/../../out.jpg", "/etc/out.jpg", "C:/out.jpg", "..\\out.jpg"])
def test_paths_that_lead_out_are_refused_before_anything_is_written(tmp_path: Path, name: str) -> None:
    path = write_zip(tmp_path / "x.zip", {"first.jpg": b"x", name: b"x"})
    assert "path" in refused(path, tmp_path / "out")
    assert not list((tmp_path / "out").iterdir())
    assert not (tmp_path / "out.jpg").exists()


@pytest.mark.parametrize("name", ["Screenshot 9.41.00\u202fAM.png", "\u3000部屋/1.jpg", "\ue000.jpg"])
def test_names_of_any_script_are_unpacked(tmp_path: Path, name: str) -> None:
    path = write_zip(tmp_path / "x.zip", {"images/1.jpg": b"one", name: b"two"})
    (tmp_path / "out").mkdir()
    assert (unpack(path, tmp_path / "out") / name).read_bytes() == b"two"


@pytest.mark.parametrize("encoding", ["utf-8", "cp437"])
def test_names_that_do_not_tell_their_encoding_are_read(tmp_path: Path, encoding: str) -> None:
    """macOS' Finder writes UTF-8, older programs CP437."""
    path = unflagged(tmp_path / "x.zip", {"images/Küche.jpg".encode(encoding): b"one", b"images/2.jpg": b"two"})
    (tmp_path / "out").mkdir()
    assert (unpack(path, tmp_path / "out") / "Küche.jpg").read_bytes() == b"one"


def test_such_a_name_is_checked_as_it_is_written(tmp_path: Path) -> None:
    path = unflagged(tmp_path / "x.zip", {b"first.jpg": b"x", "ü/../../x.jpg".encode(): b"x"})
    assert "path" in refused(path, tmp_path / "out")
    path = unflagged(tmp_path / "y.zip", {b"first.jpg": b"x", "ü\u0085.jpg".encode(): b"x"})
    assert "unusable name" in refused(path, tmp_path / "other")


def unflagged(path: Path, files: dict[bytes, bytes]) -> Path:
    """A zip whose names say nothing of their encoding."""
    stand_ins = {f"{number}".rjust(len(name), "x"): name for number, name in enumerate(files)}
    data = write_zip(path, dict(zip(stand_ins, files.values(), strict=True))).read_bytes()
    for stand_in, name in stand_ins.items():
        assert data.count(stand_in.encode()) == 2
        data = data.replace(stand_in.encode(), name)
    path.write_bytes(data)
    return path


@pytest.mark.skipif(os.name == "nt", reason="reserved in Windows")
def test_names_with_a_time_of_day_are_unpacked(tmp_path: Path) -> None:
    path = write_zip(tmp_path / "x.zip", {"2024-01-01 12:30:00.png": b"one"})
    (tmp_path / "out").mkdir()
    assert (unpack(path, tmp_path / "out") / "2024-01-01 12:30:00.png").read_bytes() == b"one"


def test_a_name_with_a_control_character_is_refused_with_what_to_do(tmp_path: Path) -> None:
    path = write_zip(tmp_path / "x.zip", {"first.jpg": b"x", "a\tb.jpg": b"x"})
    assert "'a\\tb.jpg' - rename the file" in refused(path, tmp_path / "out")
    assert not list((tmp_path / "out").iterdir())


def test_links_are_refused(tmp_path: Path) -> None:
    info = zipfile.ZipInfo("photo.jpg")
    info.external_attr = 0o120777 << 16
    with zipfile.ZipFile(tmp_path / "x.zip", "w") as archive:
        archive.writestr(info, "/etc/passwd")
    assert "link" in refused(tmp_path / "x.zip", tmp_path / "out")


def test_a_bomb_is_refused(tmp_path: Path) -> None:
    path = write_zip(tmp_path / "x.zip", {"x.png": bytes(300 << 20)}, zipfile.ZIP_DEFLATED)
    assert "photographs never do" in refused(path, tmp_path / "out")
    assert not list((tmp_path / "out").iterdir())


def test_a_bomb_that_states_a_small_size_writes_no_more_than_that(tmp_path: Path) -> None:
    path = write_zip(tmp_path / "x.zip", {"x.png": bytes(5 << 20)}, zipfile.ZIP_DEFLATED)
    data = bytearray(path.read_bytes())
    for signature, at in ((b"PK\x01\x02", 24), (b"PK\x03\x04", 22)):
        place = data.index(signature) + at
        data[place : place + 4] = struct.pack("<I", 1000)
    path.write_bytes(data)
    refused(path, tmp_path / "out")
    assert sum(file.stat().st_size for file in (tmp_path / "out").iterdir()) <= 1000


def cut(data: bytes) -> bytes:
    return data[: len(data) // 2]


def without_checksum(data: bytes) -> bytes:
    return data.replace(b"pixels", b"pixelz")


@pytest.mark.parametrize("damage", [cut, without_checksum, lambda _: b"", lambda _: b"PK\x05\x06" + bytes(18)])
def test_damage_is_refused(tmp_path: Path, damage: Callable[[bytes], bytes]) -> None:
    path = write_zip(tmp_path / "x.zip", {"x.png": b"pixels" * 100})
    path.write_bytes(damage(path.read_bytes()))
    assert "zip" in refused(path, tmp_path / "out")


def test_a_damaged_entry_of_lzma_is_refused(tmp_path: Path) -> None:
    path = write_zip(tmp_path / "x.zip", {"x.png": bytes(range(256)) * 100}, zipfile.ZIP_LZMA)
    data = bytearray(path.read_bytes())
    data[60:90] = b"\xff" * 30
    path.write_bytes(data)
    assert "damaged" in refused(path, tmp_path / "out")


def test_an_archive_that_may_not_be_read_asks_for_permissions(tmp_path: Path) -> None:
    folder = tmp_path / "x.zip"
    folder.mkdir()  # which nobody may open as a file
    assert "check its permissions" in refused(folder, tmp_path / "out")


def test_an_encrypted_one_is_refused(tmp_path: Path) -> None:
    path = write_zip(tmp_path / "x.zip", {"x.png": b"pixels"})
    data = bytearray(path.read_bytes())
    for signature, at in ((b"PK\x01\x02", 8), (b"PK\x03\x04", 6)):
        data[data.index(signature) + at] |= 1
    path.write_bytes(data)
    assert "encrypted" in refused(path, tmp_path / "out")
