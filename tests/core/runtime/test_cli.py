"""Scripts end with one line and the exit code of the contract."""

import errno
import os
import subprocess
import sys

import pytest

from cvdgs.core.errors import InputError
from cvdgs.core.runtime.cli import exit_code

TERMINATED = """
import os, signal, sys
from pathlib import Path
from cvdgs.core.files.untrusted import writing_whole
from cvdgs.core.runtime.cli import exit_code

def work():
    with writing_whole(Path("scene.ply")) as file:
        file.write(b"half of it")
        os.kill(os.getpid(), signal.SIGTERM)

sys.exit(exit_code("a.py", work))
"""


def refused() -> None:
    raise InputError("is no folder", where="photos", remedy="name another")


def stopped() -> None:
    raise KeyboardInterrupt


def on_a_full_disk() -> None:
    raise OSError(errno.ENOSPC, "No space left on device", "out/a\nb.ply")


def out_of_memory() -> None:
    raise MemoryError


def defective() -> None:
    raise ZeroDivisionError


@pytest.mark.parametrize(
    ("work", "code", "said"),
    [
        (lambda: None, 0, ""),
        (refused, 2, "a.py: photos: is no folder - name another\n"),
        (stopped, 130, "a.py: stopped\n"),
        (
            on_a_full_disk,
            2,
            "a.py: out/a\\nb.ply: No space left on device - free space or check the permissions, then run again\n",
        ),
        (
            out_of_memory,
            2,
            "a.py: the machine is out of memory - close other programs, or give it less to do\n",
        ),
    ],
)
def test_a_script_says_in_one_line_why_it_did_not_do_its_work(work, code, said, capsys):
    assert exit_code("a.py", work) == code
    assert capsys.readouterr().err == said


def test_a_defect_of_ours_is_not_hidden():
    with pytest.raises(ZeroDivisionError):
        exit_code("a.py", defective)


@pytest.mark.skipif(os.name != "posix", reason="elsewhere a process that is terminated cannot do anything more")
def test_a_script_that_is_terminated_leaves_nothing_half_made(tmp_path):
    variables = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, "-c", TERMINATED]
    result = subprocess.run(command, cwd=tmp_path, env=variables, capture_output=True, text=True)
    assert (result.returncode, result.stderr) == (130, "a.py: stopped\n")
    assert os.listdir(tmp_path) == []
