"""The results of a stress test: stress.csv, stress.md, the charts, and stress.html with pictures."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import jinja2
import numpy as np
import pandas as pd

from ....core.files.images import read_png
from ....core.runs.layout import ENHANCED_FOLDER, RENDERS_FOLDER
from ..charts import Theme, picture, plot_series, write_charts
from ..embedding import jpeg_uri
from ..options import trials_took
from ..studies.recipe import Trial
from ..tables import Column, frame_of, markdown_table, write_csv, write_text
from .axes import HARMLESS, Axis
from .failure import MOST_LOST, MOST_RWE, UNTOUCHED, curve, fails_by_the_line_of, standings
from .heat_map import PICTURE_LINES, with_margins, write_heat_map
from .plan import StressPlan, StressResult

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

NAME = "stress"
OURS, PLAIN_METHOD = "layers", "plain"
COUNTED_LEVEL = 3
"""The level at which we count the axes where plain settings have failed and ours stands."""
_JPEG_QUALITY = 90
_WIDTH, _ROW, _LEGEND = 9.0, 1.75, 0.6  # inches
_PANELS = {"psnr": "PSNR, dB", "rwe": "RWE", "ccpr": "CCPR"}
_SPREAD_OPACITY = 0.18

_METHODS = (
    "- **layers**: geometry from the photographs, colours fitted to the enhanced photographs (the default). "
    "**joint**: both together from the enhanced photographs. **post**: renderings enhanced one by one.",
    "- **plain**: as `layers`, with the settings of plain Gaussian splatting: Gaussians divided by their gradients, "
    "every pixel and photograph taken as it is, its photometric loss alone: no multi-view loss, no hinge on contrast.",
)
_UNTOUCHED: tuple[Column, ...] = (
    ("method", "method", ""),
    ("psnr", "PSNR", ".2f"),
    ("rwe", "RWE", ".3f"),
    ("ccpr", "CCPR", ".3f"),
    ("ccpr_input", "CCPR of the input", ".3f"),
    ("verdict", "failed", ""),
)
_FAILURES: tuple[Column, ...] = (
    ("title", "what is made worse", ""),
    ("method", "method", ""),
    ("value", "at", ""),
    ("psnr_lost", "PSNR lost, dB", ".1f"),
    ("rwe", "RWE", ".2f"),
    ("ccpr", "CCPR", ".3f"),
    ("ccpr_input", "CCPR of the input", ".3f"),
)
_WARNINGS: tuple[Column, ...] = (("title", "what is made worse", ""), ("value", "at", ""), ("names", "warnings", ""))
_PAGE = jinja2.Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True).from_string("""\
<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>Where it fails</title>
<style>
:root { color-scheme: light dark; }
body { font: 15px/1.5 system-ui, sans-serif; margin: 2rem auto; max-width: 1180px; padding: 0 1rem; }
h1 { font-size: 1.5rem; } h2 { font-size: 1.1rem; margin: 1.6rem 0 .4rem; }
.row { display: grid; grid-template-columns: repeat(auto-fit, minmax(200px, 1fr)); gap: .6rem; }
figure { margin: 0; } figcaption { font-size: .82rem; opacity: .85; } img { width: 100%; display: block; }
</style>
</head>
<body>
<h1>Where it fails</h1>
<p>A held-out photograph, enhanced, and each method's enhanced scene from the same camera: of the untouched capture, and
at the worst level of each axis.</p>
{% for title, pictures in sections if pictures %}
<h2>{{ title }}</h2>
<div class="row">
{% for caption, jpeg in pictures %}
{% if jpeg %}
<figure><img alt="{{ caption }}" src="{{ jpeg }}"><figcaption>{{ caption }}</figcaption></figure>
{% else %}
<p>{{ caption }}</p>
{% endif %}
{% endfor %}
</div>
{% endfor %}
</body>
</html>
""")


def write_stress(folder: Path, plan: StressPlan, results: Sequence[StressResult], *, processes: int = 1) -> str:
    """Write everything into `folder`; returns the text of stress.md.

    Args:
        processes: how many trials ran at a time.

    Raises:
        InputError: matplotlib is missing.
    """
    items = standings(results)
    # Axes share trials, those of the untouched scenes, and trials have their pictures to themselves.
    trials = frame_of(Trial, list({result.pictures: result.trial for result in results}.values()))
    write_csv(folder / f"{NAME}.csv", items)
    write_stress_chart(folder, NAME, plan.axes, items)
    write_heat_map(folder, with_margins(items))
    (folder / f"{NAME}.html").write_text(_PAGE.render(sections=_sections(plan, results, items)), encoding="utf-8")
    return write_text(folder / f"{NAME}.md", stress_lines(plan, items, trials_took(trials, processes)))


def stress_lines(plan: StressPlan, items: pd.DataFrame, took: str) -> list[str]:
    """The lines of stress.md; `took` says how long its trials did."""
    untouched = items[items.axis == UNTOUCHED]
    verdicts = untouched.errors.where(untouched.errors != "", untouched.failed.ne("").map({True: "yes", False: "no"}))
    return [
        "# Where it fails",
        "",
        took,
        "",
        *_how(plan),
        "",
        "## The untouched capture",
        "",
        *markdown_table(untouched.assign(verdict=verdicts), _UNTOUCHED),
        "",
        "## The first level at which each method fails",
        "",
        *_first_failures(plan, items),
        "",
        *_count(plan, items),
        "",
        "## One picture",
        "",
        *PICTURE_LINES,
        "",
        "## The curves",
        "",
        "Bands: one standard deviation over the seeds. Dotted: the failure lines.",
        "",
        picture(NAME, "PSNR, RWE and CCPR of each method over the levels of each axis"),
        "",
        "## The product's warnings",
        "",
        "Names of the warnings of a run in mode `layers` at each level, beside those of the untouched capture.",
        "",
        *_warnings(plan, items),
        "",
        f"Pictures of the worst level of each axis: [{NAME}.html]({NAME}.html).",
    ]


def _how(plan: StressPlan) -> list[str]:
    broken = len(plan.broken_levels)
    return [
        f"{plan.base.name} at {plan.base.max_size} pixels, {plan.iterations} steps, at most {plan.gaussians:,} "
        f"Gaussians for every method, {_count_of(len(plan.seeds), 'seed')}. Each axis has the untouched capture, which "
        f"axes share, and {_count_of(broken, 'level')} of it made worse. What is wrong is wrong with what the method "
        "is given; results are judged by the untouched photographs and cameras that were held out, and where the scene "
        "itself differs (chroma, satin, sheer cloth, yarns) by those of that scene. Cloth that differs is rendered "
        "anew, at this size and with few samples, and is compared with the untouched scene rendered likewise.",
        "",
        *_METHODS,
        "",
        f"A method has failed, as was fixed beforehand, where the mean over the seeds of its **PSNR** is more than "
        f"{MOST_LOST:g} dB below its own on the untouched capture, of its **RWE** (warping error relative to the "
        f"photographs') above {MOST_RWE:g}, or of its **CCPR** (contrast left for the observer) below that of the "
        "photographs themselves; or where any seed gave an error or a number that is not finite.",
    ]


def _first_failures(plan: StressPlan, items: pd.DataFrame) -> list[str]:
    """Where each method fails first on each axis; then the figures and errors that it fails by."""
    overview, failed = [], []
    for axis in plan.axes:
        row = {"title": axis.title}
        for method in items.method.unique():
            levels = curve(items, method, axis.name)
            failing = levels[levels.failed != ""].head(1)
            row[method] = "stands"
            for found in failing.itertuples():
                row[method] = "untouched already" if found.level == HARMLESS else axis.text(found.level)
                if found.level != HARMLESS:
                    failed.append(failing.assign(title=axis.title))
        overview.append(row)
    columns = [("title", "what is made worse", ""), *((method, method, "") for method in items.method.unique())]
    lines = markdown_table(pd.DataFrame(overview), columns)
    if failed:
        figures = pd.concat(failed)
        words = "The figures at these levels; PSNR is lost against the method's own on the untouched capture:"
        lines += ["", words, "", *markdown_table(figures, _FAILURES)]
        errors = [f"- {f.title}, {f.method}: {f.errors}" for f in figures[figures.errors != ""].itertuples()]
        lines += ["", *errors] if errors else []
    return lines


def _count(plan: StressPlan, items: pd.DataFrame) -> list[str]:
    """On how many axes ours stands where plain settings have failed."""
    if COUNTED_LEVEL not in plan.levels:
        return []
    counted = items.level == COUNTED_LEVEL
    fallen, standing = _fallen(plan, items[counted & (items.failed != "")])
    common, above = _fallen(plan, items[counted & fails_by_the_line_of(PLAIN_METHOD, items)])
    return [
        f"At level {COUNTED_LEVEL} of {max(plan.levels)}, plain settings have failed on {fallen} of "
        f"{len(plan.axes)} axes; on {standing} `{OURS}` is still above its failure line.",
        "",
        f"By its own line a method fails the sooner the better it is on the untouched capture. With one line for all, "
        f"{MOST_LOST:g} dB below the PSNR of plain settings there, these have failed on {common}, and on {above} "
        f"`{OURS}` stands.",
    ]


def _fallen(plan: StressPlan, failing: pd.DataFrame) -> tuple[int, str]:
    """On how many axes plain settings are among the `failing` rows, and on which of them ours is not, in words."""
    failed = {method: set(failing.axis[failing.method == method]) for method in (OURS, PLAIN_METHOD)}
    fallen = [axis.name for axis in plan.axes if axis.name in failed[PLAIN_METHOD]]
    standing = [name for name in fallen if name not in failed[OURS]]
    names = f" ({', '.join(standing)})" if standing else ""
    return len(fallen), f"{len(standing)} of these{names}"


def _warnings(plan: StressPlan, items: pd.DataFrame) -> list[str]:
    harmless = items[(items.level == HARMLESS) & (items.method == OURS)]
    usual = {name for warnings in harmless.warnings for name in warnings.split()}
    rows = []
    for axis in plan.axes:
        levels = curve(items, OURS, axis.name)
        for item in levels[levels.level != HARMLESS].itertuples():
            # Without any result, the reason for that.
            names = ", ".join(sorted(set(item.warnings.split()) - usual)) if item.seeds else item.failed
            rows.append({"title": axis.title, "value": item.value, "names": names or "nothing"})
    lines = markdown_table(pd.DataFrame(rows), _WARNINGS)
    return [*lines, "", f"On the untouched capture: {', '.join(sorted(usual)) or 'nothing'}."]


def _sections(
    plan: StressPlan, results: Sequence[StressResult], items: pd.DataFrame
) -> list[tuple[str, list[tuple[str, str]]]]:
    """Title, and captions and data URIs of pictures, of the untouched capture and of each axis's worst level."""
    worst, seed = max(plan.levels), min(plan.seeds)
    shown = [result for result in results if result.attempt.seed == seed]
    sections = [(UNTOUCHED, [result for result in shown if result.attempt.axis is None])]
    for axis in plan.axes:
        chosen = [r for r in shown if r.attempt.axis == axis and r.attempt.level == worst]
        sections.append((f"{axis.title}: {axis.text(worst)}", chosen))
    return [(title, _pictures(chosen, items)) for title, chosen in sections]


def _pictures(results: Sequence[StressResult], items: pd.DataFrame) -> list[tuple[str, str]]:
    """An enhanced photograph, and each method's rendering; without data where there is none."""
    found = []
    enhanced = _jpeg_of(results[0], ENHANCED_FOLDER) if results else ""
    if enhanced:
        found.append(("enhanced photograph", enhanced))
    for result in results:
        attempt = result.attempt
        levels = curve(items, attempt.method, attempt.axis.name if attempt.axis else UNTOUCHED)
        (failed,) = levels.failed[levels.level == attempt.level]
        found.append((f"{attempt.method}: {failed or 'stands'}", _jpeg_of(result, RENDERS_FOLDER)))
    return found


def _jpeg_of(result: StressResult, kind: str) -> str:
    """Data URI of the middle one of a trial's rendered views, or of the enhanced photograph of the same view."""
    layer = result.attempt.recipe.layer.name
    rendered = sorted((result.pictures / RENDERS_FOLDER / layer).glob("*.png"))
    path = result.pictures / kind / layer / rendered[len(rendered) // 2].name if rendered else None
    if path is None or not path.is_file():
        return ""
    return jpeg_uri(read_png(path), _JPEG_QUALITY)


def write_stress_chart(folder: Path, name: str, axes: Sequence[Axis], items: pd.DataFrame) -> list[Path]:
    """Write the curves, a row of panels for each axis and a column for each figure, as `write_charts` does."""

    def draw(figure: Figure, theme: Theme) -> None:
        panels = figure.subplots(len(axes), len(_PANELS), squeeze=False)
        for row, axis in zip(panels, axes, strict=True):
            for panel, (key, title) in zip(row, _PANELS.items(), strict=True):
                _draw_panel(panel, axis, key, items, theme)
                panel.set_ylabel(title)
            unit = axis.unit.strip()
            row[0].set_title(f"{axis.title}, {unit}" if unit else axis.title)
        handles, labels = panels[0][0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=len(labels))

    return write_charts(folder, name, (_WIDTH, _LEGEND + _ROW * len(axes)), draw)


def _draw_panel(panel: Axes, axis: Axis, key: str, items: pd.DataFrame, theme: Theme) -> None:
    methods = items.method.unique()
    for method, style in zip(methods, theme.series, strict=False):
        levels = curve(items, method, axis.name)
        figures, deviations = levels[key], levels[f"{key}_deviation"].fillna(0.0)
        band = (levels.level, figures - deviations, figures + deviations)
        panel.fill_between(*band, color=style.color, alpha=_SPREAD_OPACITY, linewidth=0)
        plot_series(panel, levels.level, figures, style, method)
        line = figures.iloc[0] - MOST_LOST
        if key == "psnr" and np.isfinite(line):
            panel.axhline(line, color=style.color, linestyle=":", linewidth=1)
    if key == "rwe":
        panel.axhline(MOST_RWE, color=theme.muted, linestyle=":", linewidth=1)
    elif key == "ccpr":
        inputs = curve(items, methods[0], axis.name)
        panel.plot(inputs.level, inputs.ccpr_input, color=theme.muted, ls=":", lw=1)
    shown = sorted({HARMLESS, *items.level})
    panel.set_xticks(shown, [axis.text(level).removesuffix(axis.unit) for level in shown])


def _count_of(count: int, noun: str) -> str:
    return f"{count} {noun}" + ("s" if count != 1 else "")
