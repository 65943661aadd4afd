"""The sheet that gives a scene its scale: what is printed is what is found."""

import re

import numpy as np
import pytest

from cvdgs.core.capture.tags import find_tags
from cvdgs.core.errors import InputError
from cvdgs.scripts.scale_sheet import main, sheet

PIXELS = 4.0  # in a millimetre


def drawn(text: str) -> np.ndarray:
    """The sheet's rectangles as a picture."""
    width, height = map(float, re.search(r'viewBox="0 0 ([\d.]+) ([\d.]+)"', text).groups())
    picture = np.full((round(height * PIXELS), round(width * PIXELS), 3), 255, np.uint8)
    for rectangle in re.findall(r'<rect x="([\d.]+)" y="([\d.]+)" width="([\d.]+)" height="([\d.]+)"/>', text):
        left, top, across, down = (float(number) * PIXELS for number in rectangle)
        picture[round(top) : round(top + down), round(left) : round(left + across)] = 0
    return picture


@pytest.mark.parametrize(("number", "side", "paper"), [(0, 0.15, "a4"), (29, 0.1, "letter")])
def test_the_printed_tag_is_found_in_its_size(number, side, paper):
    (tag,) = find_tags(drawn(sheet(number, side, paper)))
    assert tag.number == number
    sides = np.linalg.norm(tag.corners - np.roll(tag.corners, -1, axis=0), axis=1) / PIXELS
    np.testing.assert_allclose(sides, 1000.0 * side, atol=0.3)


@pytest.mark.parametrize(("number", "side"), [(30, 0.1), (-1, 0.1), (0, 0.2), (0, 0.001), (0, float("nan"))])
def test_a_tag_that_does_not_exist_or_does_not_fit_is_refused(number, side):
    with pytest.raises(InputError):
        sheet(number, side, "a4")


def test_the_command_writes_the_file_or_says_in_one_line_why_not(tmp_path, capsys):
    assert main(["--out", str(tmp_path / "sheet.svg")]) == 0
    assert (tmp_path / "sheet.svg").read_text() == sheet(0, 0.15, "a4")
    assert main(["--out", str(tmp_path / "missing" / "sheet.svg")]) == 2
    assert main(["--out", str(tmp_path / "b.svg"), "--side", "3"]) == 2
    assert not (tmp_path / "b.svg").exists()
    assert all(line.startswith("scale_sheet.py: ") for line in capsys.readouterr().err.splitlines())
