"""The picture of a batch's page, by a stand-in for the browser; what cannot be drawn is refused in one line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cvdgs.core.files.images import read_png, write_png
from cvdgs.scripts.make_page_picture import main


@pytest.fixture
def page(tmp_path: Path) -> Path:
    (tmp_path / "index.html").write_text("<p>a page</p>", encoding="utf-8")
    return tmp_path / "index.html"


def program(folder: Path, script: str) -> str:
    path = folder / "browser"
    path.write_text(f"#!/bin/sh\n{script}\n", encoding="utf-8")
    path.chmod(0o755)
    return str(path)


def test_the_picture_has_a_quarter_of_the_grey_levels(page: Path, tmp_path: Path) -> None:
    drawn = np.arange(256, dtype=np.uint8).reshape(16, 16)[..., None].repeat(3, axis=2)
    write_png(tmp_path / "drawn.png", drawn)
    draws = f'for word; do case "$word" in --screenshot=*) cp "{tmp_path}/drawn.png" "${{word#*=}}";; esac; done'
    out = tmp_path / "out.png"
    assert main([str(page), "--out", str(out), "--browser", program(tmp_path, draws)]) == 0
    found = read_png(out).astype(int)
    assert set(np.unique(found)) == {*range(0, 256, 4), 255}
    assert np.abs(found - drawn).max() <= 2


@pytest.mark.parametrize("script", ["exit 1", "exit 0", None])
def test_a_browser_that_draws_nothing_is_refused_and_an_older_picture_stays(
    page: Path, tmp_path: Path, script: str | None, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out.png"
    out.write_bytes(b"older")
    browser = "nope" if script is None else program(tmp_path, script)
    assert main([str(page), "--out", str(out), "--browser", browser]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1
    assert out.read_bytes() == b"older"


def test_a_page_that_is_not_there_and_options_that_are_missing_are_refused_in_a_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([str(tmp_path / "none.html"), "--out", str(tmp_path / "out.png"), "--browser", "nope"]) == 2
    assert main([str(tmp_path / "none.html")]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 2
