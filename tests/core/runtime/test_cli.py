"""Scripts end with one line and the exit code of the contract."""

import pytest

from cvdgs.core.errors import InputError
from cvdgs.core.runtime.cli import exit_code


def refused() -> None:
    raise InputError("is no folder", where="photos", remedy="name another")


def stopped() -> None:
    raise KeyboardInterrupt


def defective() -> None:
    raise ZeroDivisionError


@pytest.mark.parametrize(
    ("work", "code", "said"),
    [
        (lambda: None, 0, ""),
        (refused, 2, "a.py: photos: is no folder - name another\n"),
        (stopped, 130, "a.py: stopped\n"),
    ],
)
def test_a_script_says_in_one_line_why_it_did_not_do_its_work(work, code, said, capsys):
    assert exit_code("a.py", work) == code
    assert capsys.readouterr().err == said


def test_a_defect_of_ours_is_not_hidden():
    with pytest.raises(ZeroDivisionError):
        exit_code("a.py", defective)
