"""Where methods fail, in words and pictures: stress.csv, stress.md, the chart, and stress.html."""

from __future__ import annotations

import base64
import html
import tempfile
from collections.abc import Sequence
from pathlib import Path

from ....images import read_png, write_jpeg
from ....run_files import ENHANCED_FOLDER, RENDERS_FOLDER
from ...charts import picture
from ...tables import markdown_table, number, write_csv
from .axes import HARMLESS, Axis
from .chart import curve, methods_of, write_stress_chart
from .failure import MOST_LOST, MOST_RWE, UNTOUCHED, Standing, first_failure, standings
from .plan import StressPlan, StressResult

NAME = "stress"
OURS = "layers"
PLAIN_METHOD = "plain"
COUNTED_LEVEL = 3
"""The level at which ours is counted where plain settings have failed."""
_JPEG_QUALITY = 90

_METHODS = (
    "- **layers**: geometry from the photographs, colours fitted to the enhanced photographs (the default). "
    "**joint**: both together from the enhanced photographs. **post**: renderings enhanced one by one.",
    "- **plain**: as `layers`, with the settings of plain Gaussian splatting: Gaussians divided by their gradients, "
    "every pixel and photograph taken as it is, no multi-view loss.",
)


def write_stress(folder: Path, plan: StressPlan, results: Sequence[StressResult], command: str) -> str:
    """Write everything into `folder`; returns the text of stress.md.

    Args:
        command: that made it, as texts show it.

    Raises:
        InputError: matplotlib is missing.
    """
    items = standings(results)
    write_csv(folder / f"{NAME}.csv", Standing, items)
    write_stress_chart(folder, NAME, plan.axes, items)
    (folder / f"{NAME}.html").write_text(_page(plan, results, items), encoding="utf-8")
    text = "\n".join(_text(plan, items, command)) + "\n"
    (folder / f"{NAME}.md").write_text(text, encoding="utf-8")
    return text


def _text(plan: StressPlan, items: Sequence[Standing], command: str) -> list[str]:
    return [
        "# Where it fails",
        "",
        f"`{command}`",
        "",
        *_how(plan),
        "",
        "## The untouched capture",
        "",
        *_untouched(items),
        "",
        "## The first level at which each method fails",
        "",
        *_first_failures(plan, items),
        "",
        *_count(plan, items),
        "",
        "## The curves",
        "",
        "Bands: one standard deviation over the seeds. Dotted: the failure lines.",
        "",
        picture(NAME, "PSNR, RWE and CCPR of each method over the levels of each axis"),
        "",
        "## What the product says",
        "",
        "Names of the warnings that a run in mode `layers` gives at each level, beside those of the untouched capture.",
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


def _untouched(items: Sequence[Standing]) -> list[str]:
    header = ["method", "PSNR", "RWE", "CCPR", "CCPR of the input", "failed"]
    rows = [
        [
            item.method,
            number(item.psnr, 2),
            *(number(value, 3) for value in (item.rwe, item.ccpr, item.ccpr_input)),
            item.failed or "no",
        ]
        for item in items
        if item.axis == UNTOUCHED
    ]
    return markdown_table(header, rows)


def _first_failures(plan: StressPlan, items: Sequence[Standing]) -> list[str]:
    methods = methods_of(items)
    rows = []
    for axis in plan.axes:
        cells = [axis.title]
        for method in methods:
            found = first_failure(curve(items, method, axis.name))
            if found is None:
                cells.append("stands")
            elif found.level == HARMLESS:
                cells.append("untouched already")
            else:
                cells.append(f"{axis.text(found.level)} ({found.failed})")
        rows.append(cells)
    return markdown_table(["what is made worse", *methods], rows)


def _count(plan: StressPlan, items: Sequence[Standing]) -> list[str]:
    """On how many axes ours stands where plain settings have fallen."""
    if COUNTED_LEVEL not in plan.levels:
        return []
    fallen = [axis for axis in plan.axes if _at(items, PLAIN_METHOD, axis).failed]
    standing = [axis for axis in fallen if not _at(items, OURS, axis).failed]
    names = f" ({', '.join(axis.name for axis in standing)})" if standing else ""
    return [
        f"At level {COUNTED_LEVEL} of {max(plan.levels)}, plain settings have failed on {len(fallen)} of "
        f"{len(plan.axes)} axes; on {len(standing)} of these `{OURS}` is still above its failure line{names}."
    ]


def _warnings(plan: StressPlan, items: Sequence[Standing]) -> list[str]:
    usual = {name for item in items if item.level == HARMLESS and item.method == OURS for name in item.warnings.split()}
    rows = []
    for axis in plan.axes:
        levels = _broken(curve(items, OURS, axis.name))
        told = [_told(item, usual) for item in levels]
        rows.append([axis.title, *(f"{item.value}: {names}" for item, names in zip(levels, told, strict=True))])
    header = ["what is made worse", *(f"level {level}" for level in plan.broken_levels)]
    lines = markdown_table(header, rows)
    return [*lines, "", f"On the untouched capture: {', '.join(sorted(usual)) or 'nothing'}."]


def _told(item: Standing, usual: set[str]) -> str:
    """The warnings beside the `usual` ones; where no seed gave a result, why."""
    if not item.seeds:
        return item.failed
    return ", ".join(sorted(set(item.warnings.split()) - usual)) or "nothing"


def _page(plan: StressPlan, results: Sequence[StressResult], items: Sequence[Standing]) -> str:
    worst, seed = max(plan.levels), min(plan.seeds)
    shown = [result for result in results if result.attempt.seed == seed]
    sections = [_section("untouched", [r for r in shown if r.attempt.axis is None], items)]
    for axis in plan.axes:
        chosen = [r for r in shown if r.attempt.axis == axis and r.attempt.level == worst]
        sections.append(_section(f"{axis.title}: {axis.text(worst)}", chosen, items))
    title = "Where it fails"
    lead = (
        "A held-out photograph, and each method's enhanced scene from the same camera, at the worst level of each axis."
    )
    return (
        "<!doctype html><html lang='en'><head><meta charset='utf-8'>"
        "<meta name='viewport' content='width=device-width, initial-scale=1'>"
        f"<title>{title}</title><style>{_STYLE}</style></head>"
        f"<body><h1>{title}</h1><p>{lead}</p>{''.join(sections)}</body></html>\n"
    )


_STYLE = """
:root { color-scheme: light dark; }
body { font: 15px/1.5 system-ui, sans-serif; margin: 2rem auto; max-width: 1180px; padding: 0 1rem; }
h1 { font-size: 1.5rem; } h2 { font-size: 1.1rem; margin: 1.6rem 0 .4rem; }
.row { display: grid; grid-template-columns: repeat(auto-fit, minmax(200px, 1fr)); gap: .6rem; }
figure { margin: 0; } figcaption { font-size: .82rem; opacity: .85; } img { width: 100%; display: block; }
"""


def _section(title: str, results: Sequence[StressResult], items: Sequence[Standing]) -> str:
    if not results:
        return ""
    figures = []
    enhanced = _picture_of(results[0], ENHANCED_FOLDER)
    if enhanced is not None:
        figures.append(_figure(enhanced, "enhanced photograph"))
    for result in results:
        rendered = _picture_of(result, RENDERS_FOLDER)
        standing = _standing_of(result, items)
        caption = f"{result.attempt.method}: {standing.failed or 'stands'}"
        figures.append(_figure(rendered, caption) if rendered else f"<p>{html.escape(caption)}</p>")
    return f"<h2>{html.escape(title)}</h2><div class='row'>{''.join(figures)}</div>"


def _picture_of(result: StressResult, kind: str) -> Path | None:
    """The middle one of a trial's rendered views, or the enhanced photograph of the same view."""
    layer = result.attempt.recipe.layer.name
    rendered = sorted((result.pictures / RENDERS_FOLDER / layer).glob("*.png"))
    if not rendered:
        return None
    path = result.pictures / kind / layer / rendered[len(rendered) // 2].name
    return path if path.is_file() else None


def _figure(path: Path, caption: str) -> str:
    with tempfile.TemporaryDirectory() as scratch:
        file = Path(scratch) / "picture.jpg"
        write_jpeg(file, read_png(path), _JPEG_QUALITY)
        data = base64.b64encode(file.read_bytes()).decode("ascii")
    text = html.escape(caption)
    return f"<figure><img alt='{text}' src='data:image/jpeg;base64,{data}'><figcaption>{text}</figcaption></figure>"


def _broken(levels: Sequence[Standing]) -> list[Standing]:
    return [item for item in levels if item.level != HARMLESS]


def _at(items: Sequence[Standing], method: str, axis: Axis) -> Standing:
    return next(i for i in items if (i.method, i.axis, i.level) == (method, axis.name, COUNTED_LEVEL))


def _standing_of(result: StressResult, items: Sequence[Standing]) -> Standing:
    attempt = result.attempt
    levels = curve(items, attempt.method, attempt.axis.name if attempt.axis else "")
    return next(item for item in levels if item.level == attempt.level)


def _count_of(count: int, noun: str) -> str:
    return f"{count} {noun}" + ("s" if count != 1 else "")
