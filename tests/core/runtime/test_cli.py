"""Scripts end with one line and the exit code of the contract."""

import errno

import pytest

from cvdgs.core.errors import InputError
from cvdgs.core.runtime.cli import exit_code


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
