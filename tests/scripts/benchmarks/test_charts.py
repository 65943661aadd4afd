"""Charts: every series can be told from the others and from the page, with any colour vision."""

import itertools

import pytest
import torch

from cvdgs.core.color.simulation import simulate
from cvdgs.core.color.spaces import delta_e_76, srgb_to_lab
from cvdgs.core.errors import InputError
from cvdgs.core.files.images import read_png
from cvdgs.scripts.benchmarks.charts import DARK, LIGHT, Theme, picture, plot_series, write_charts

DICHROMATS = ("protan", "deutan", "tritan")
CLEARLY_APART = 10.0  # ΔE76; the practice of map palettes


def seen_by(cvd: str, color: str) -> torch.Tensor:
    """CIELAB of a colour as a dichromat sees it."""
    srgb = torch.tensor([int(color[i : i + 2], 16) / 255 for i in (1, 3, 5)], dtype=torch.float64)
    return srgb_to_lab(simulate(srgb.view(3, 1, 1), cvd, 1.0))


@pytest.mark.parametrize("cvd", DICHROMATS)
@pytest.mark.parametrize("theme", [LIGHT, DARK], ids=lambda theme: theme.name)
def test_every_dichromat_tells_the_series_apart_and_from_the_page(theme: Theme, cvd: str):
    colors = [theme.background, *(style.color for style in theme.series)]
    for first, second in itertools.combinations(colors, 2):
        assert float(delta_e_76(seen_by(cvd, first), seen_by(cvd, second))) >= CLEARLY_APART, (first, second)


@pytest.mark.parametrize("theme", [LIGHT, DARK], ids=lambda theme: theme.name)
def test_series_differ_without_any_colour_too(theme: Theme):
    assert len({style.marker for style in theme.series}) == len(theme.series)
    assert len({style.dash for style in theme.series}) == len(theme.series)


def draw_lines(figure, theme):
    axes = figure.add_subplot()
    for index, style in enumerate(theme.series):
        plot_series(axes, [0, 1], [index, index], style, f"series {index}")
    axes.legend()


def test_a_chart_is_written_for_light_and_dark_pages(tmp_path):
    written = write_charts(tmp_path, "chart", (4, 3), draw_lines)
    assert [path.name for path in written] == ["chart.svg", "chart.png", "chart-dark.svg", "chart-dark.png"]
    light, dark = (read_png(tmp_path / name) for name in ("chart.png", "chart-dark.png"))
    assert light[0, 0].min() > 250
    assert dark[0, 0].max() < 50


def test_the_same_data_give_the_same_svg(tmp_path):
    for folder in ("first", "second"):
        write_charts(tmp_path / folder, "chart", (4, 3), draw_lines)
    first, second = ((tmp_path / folder / "chart.svg").read_bytes() for folder in ("first", "second"))
    assert first == second
    assert b"series 3" in first  # text stays text


def test_a_page_shows_the_dark_chart_where_pages_are_dark():
    html = picture("pareto", 'quality "over" time')
    assert 'prefers-color-scheme: dark)" srcset="pareto-dark.svg"' in html
    assert 'alt="quality &quot;over&quot; time"' in html


def test_a_missing_matplotlib_is_said_in_one_line(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "matplotlib", None)
    with pytest.raises(InputError, match="install the extra 'bench'"):
        write_charts(tmp_path, "chart", (4, 3), draw_lines)
