"""`benchmark.py figure`: the modes from novel views, for normal and simulated vision."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from ...core.console import ConsoleReporter
from ...core.evaluate.enhancers.methods import NETWORK, method_label
from ...core.evaluate.studies.enhancers import PER_VIEW_LUT
from ...core.evaluate.studies.figure import write_figure
from ...core.evaluate.studies.novel_views import NovelViews, cached_novel_views, novel_views
from ...core.evaluate.studies.recipe import Recipe
from ...core.evaluate.studies.scenes import DEMO
from ...core.run_files import ORIGINAL
from .options import names
from .part import Part
from .study_options import add_study_arguments, chosen_sources, made_by, settled, work_folder, write_text

SIZE, ITERATIONS, VIEWS = 320, 1000, 48
QUICK_VIEWS = 6
TITLES = {
    PER_VIEW_LUT: "A LUT of each view alone, which contradicts itself from view to view",
    NETWORK: "The product's network",
}


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add_study_arguments(parser, captures=(DEMO,), max_size=SIZE, iterations=ITERATIONS)
    enhancers = (PER_VIEW_LUT, NETWORK)
    parser.add_argument(
        "--enhancers",
        type=names,
        default=enhancers,
        metavar="A,B",
        help=f"names or weight files, a picture each ({','.join(enhancers)})",
    )
    parser.add_argument("--views", type=int, default=VIEWS, metavar="N", help=f"cameras of the path ({VIEWS})")


def _measure(options: argparse.Namespace) -> str:
    """Render the modes along a path; writes figure-CAPTURE-ENHANCER.png, the same in dark, and figure.md."""
    options = settled(options)
    if options.quick:
        options.views = min(options.views, QUICK_VIEWS)
    lines = ["# The modes from novel views", "", *made_by(options, seeds=1), "", *_EXPLANATION, ""]
    for source in chosen_sources(options):
        subject = source.load()
        for enhancer in options.enhancers:
            recipe = Recipe("figure", enhancer=enhancer, iterations=options.iterations)
            name = f"{source.name}-{method_label(enhancer)}"
            place = work_folder(options) / "figure" / f"{name}-{options.max_size}-{options.iterations}-{options.views}"
            reporter = ConsoleReporter(sys.stderr)
            make = partial(novel_views, source.name, subject, recipe, options.views, place, reporter)
            views = cached_novel_views(place, make)
            title = TITLES.get(enhancer, method_label(enhancer))
            lines += [*_write(options.out, f"figure-{name}", views, recipe, f"{title}. Capture: {source.name}"), ""]
    return write_text(options.out / "figure.md", lines)


def _write(out: Path, name: str, views: NovelViews, recipe: Recipe, title: str) -> Sequence[str]:
    """Draw one picture; returns the lines that show it."""
    choice = write_figure(out, name, views, recipe.layer, recipe.simulation, title)
    count = len(views.pictures[ORIGINAL])
    caption = (
        f"{title}. The path has {count} cameras between the held-out views {views.between[0]} and {views.between[1]}; "
        f"pictures and upper enlargements are of camera {choice.camera + 1}, lower ones of camera {choice.camera + 2}."
    )
    return [
        f'<picture><source media="(prefers-color-scheme: dark)" srcset="{name}-dark.png">'
        f'<img src="{name}.png" alt="{title}"></picture>',
        "",
        caption,
    ]


_EXPLANATION = [
    "Every camera is between two held-out ones, so no photograph was taken there. Shown are the two neighbouring "
    "cameras between which the pictures of `post` change the most beyond what those of `layers` do. The frame is where "
    "the three modes differ the most (mean ΔE76); beside each picture it is enlarged, above for the camera of the "
    "picture, below for the next one. The strips put the same narrow slice of every camera's picture side by side.",
]


PART = Part("figure", "the modes from novel views, for normal and simulated vision", _add_arguments, _measure)
