"""The contact sheet of a batch: which pictures it shows, how they are made smaller, and that it says what they are."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cvdgs.core.color import srgb
from cvdgs.core.errors import InputError
from cvdgs.core.rendering.requests import SheetArguments
from cvdgs.core.runs.layout import spread_over_turn
from cvdgs.core.runtime.protocol import Reporter
from cvdgs.cvdgs_addon.batch.contact_sheet import make_sheet
from cvdgs.cvdgs_addon.batch.pixels import Pixels, downscale, read_picture

from .batches import SIZE, number_picture, sequence

ROUNDING = 1  # level of 255: Blender decodes and encodes what it writes letters on
HUES = {"a": 0, "b": 2}


def sheet(out: Path, frames: int = 8, columns: int = 4, title: str = "Autumn") -> Pixels:
    rows = tuple({"label": f"Layer {folder}", "folder": folder, "frames": frames} for folder in HUES)
    make_sheet(SheetArguments(title, rows, columns, "sheet.png"), out, reporter=Reporter())
    return read_picture(out / "sheet.png")


def places(sheet: Pixels, picture: Pixels) -> list[tuple[int, int]]:
    """Top and left of every copy of `picture`."""
    height, width, _ = picture.shape
    signed = sheet.astype(np.int16)

    def alike(top: int, left: int) -> bool:
        return np.abs(signed[top : top + height, left : left + width] - picture).max() <= ROUNDING

    corners = signed[: 1 - height, : 1 - width], signed[height - 1 :, width - 1 :]
    begins, ends = (
        np.abs(corner - picture[at]).max(axis=2) <= ROUNDING
        for corner, at in zip(corners, ((0, 0), (-1, -1)), strict=True)
    )
    return [(int(top), int(left)) for top, left in zip(*np.nonzero(begins & ends), strict=True) if alike(top, left)]


@pytest.fixture
def turned(tmp_path) -> Path:
    for folder, hue in HUES.items():
        sequence(tmp_path / folder, 8, hue)
    return tmp_path


def test_every_row_shows_its_turntable_from_all_sides(turned):
    made = sheet(turned)
    found = {
        folder: [place for number in (1, 3, 5, 7) for place in places(made, number_picture(number, hue))]
        for folder, hue in HUES.items()
    }
    for row in found.values():
        assert len(row) == 4
        tops, lefts = zip(*row, strict=True)
        assert len(set(tops)) == 1
        assert np.diff(lefts).min() > SIZE[0]
    assert found["b"][0][0] > found["a"][0][0] + SIZE[1]
    assert [path.name for path in turned.glob("*.png")] == ["sheet.png"]


def test_it_says_what_it_shows(turned):
    made = sheet(turned)
    (top, _), *_ = places(made, number_picture(1, HUES["a"]))
    heading, label = made[: top - 42], made[top - 38 : top - 4]
    for band in (heading, label):
        assert (band < 90).any(), "dark letters"
        assert (band > 230).mean() > 0.7, "on light paper"
    other = sheet(turned, title="Winter")
    assert np.abs(other[: top - 42].astype(int) - heading).max() > 90


def test_a_long_line_has_room(turned):
    title = "Autumn and winter, woven and knitted, for living rooms and halls"
    made = sheet(turned, title=title)
    heading = made[30:76]
    columns = np.flatnonzero((heading < 90).any(axis=(0, 2)))
    assert columns[-1] < made.shape[1] - 20
    assert columns[-1] - columns[0] > 0.55 * 30 * len(title), "in one line"


def test_a_short_turn_is_shown_whole(turned):
    assert spread_over_turn(3, 8) == [1, 2, 3]
    assert spread_over_turn(96, 8) == [1, 13, 25, 37, 49, 61, 73, 85]
    made = sheet(turned, frames=3, columns=8)
    assert sum(len(places(made, number_picture(number, 0))) for number in range(1, 9)) == 3


def test_a_missing_picture_is_named_and_nothing_is_written(turned):
    (turned / "b" / "0005.png").unlink()
    with pytest.raises(InputError, match=r"b/0005\.png: no such picture"):
        sheet(turned)
    assert not list(turned.glob("*.png"))


def test_smaller_pictures_have_the_same_light():
    picture = np.random.default_rng(1).integers(0, 256, (60, 90, 3), np.uint8)
    smaller = downscale(picture, 40)
    assert smaller.shape == (27, 40, 3)
    light, before = (srgb.decode(pixels / 255.0).mean() for pixels in (smaller, picture))
    assert light == pytest.approx(before, rel=2e-3)
    half = srgb.decode(downscale(picture, 45) / 255.0)
    blocks = srgb.decode(picture / 255.0).reshape(30, 2, 45, 2, 3).mean(axis=(1, 3))
    np.testing.assert_allclose(half, blocks, atol=5e-3)
    np.testing.assert_array_equal(downscale(picture, 90), picture)
