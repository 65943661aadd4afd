"""Files get their names when they are whole, and leave nothing behind when they are not."""

import os
import subprocess
import sys

import pytest

from cvdgs.core.errors import InputError
from cvdgs.core.files.untrusted import partial_file, replacing, writing_whole


def test_a_file_gets_its_name_when_it_is_whole(tmp_path):
    path = tmp_path / "scene.ply"
    path.write_text("earlier")
    with replacing(path) as temporary:
        temporary.write_text("new")
        assert path.read_text() == "earlier"
    assert path.read_text() == "new"
    assert os.listdir(tmp_path) == ["scene.ply"]


def test_what_fails_leaves_the_earlier_file_and_nothing_else(tmp_path):
    path = tmp_path / "scene.ply"
    path.write_text("earlier")
    with pytest.raises(TypeError), replacing(path) as temporary:
        temporary.write_bytes("no bytes")
    assert path.read_text() == "earlier"
    assert os.listdir(tmp_path) == ["scene.ply"]


def test_a_file_that_nobody_has_made_is_an_error(tmp_path):
    with pytest.raises(FileNotFoundError), replacing(tmp_path / "scene.ply"):
        pass


def test_a_file_keeps_its_ending_while_it_is_made_and_is_hidden(tmp_path):
    assert partial_file(tmp_path / "a.png") == tmp_path / ".a.partial.png"
    with replacing(tmp_path / "a.png", contested=True) as temporary:
        assert temporary.match(".a.*.partial.png")
        temporary.touch()


def test_a_place_that_cannot_be_written_is_the_users_affair(tmp_path):
    refused = pytest.raises(InputError, match=r"cannot be written \(No such file or directory\)")
    with refused, writing_whole(tmp_path / "missing" / "scene.ply") as file:
        file.write(b"")


@pytest.mark.parametrize("on", ["this machine", "another one, where it has the same number"])
def test_two_programs_that_export_into_one_file_each_put_a_whole_one_there(tmp_path, on):
    path = tmp_path / "scene.ply"
    program = f"""
import os, sys
os.getpid = lambda number=os.getpid(): number if {on == "this machine"} else {os.getpid()}
from pathlib import Path
from cvdgs.core.files.untrusted import writing_whole
with writing_whole(Path(sys.argv[1])) as file:
    file.write(b"the other one's")
"""
    variables = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    with writing_whole(path) as file:
        file.write(b"half of ")
        file.flush()
        subprocess.run([sys.executable, "-c", program, str(path)], env=variables, check=True)
        assert path.read_bytes() == b"the other one's"
        file.write(b"ours")
    assert path.read_bytes() == b"half of ours"
    assert os.listdir(tmp_path) == ["scene.ply"]


def test_what_a_killed_export_left_is_removed_by_one_a_day_later(tmp_path):
    path, others = tmp_path / "scene [1].ply", tmp_path / ".scene.partial.ply"
    others.touch()
    left = [path.with_name(f".scene [1].{maker}.partial.ply") for maker in ("0123abcd", "another")]
    for file in left:
        file.write_text("half")
    os.utime(left[0], (0, 0))
    os.utime(others, (0, 0))
    with writing_whole(path) as file:
        file.write(b"whole")
    assert set(tmp_path.iterdir()) == {path, others, left[1]}
    assert path.read_bytes() == b"whole"
