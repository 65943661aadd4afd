"""What a study found, as observers-results.csv, .md and a chart."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import pandas as pd

from ..charts import Theme, picture, plot_series, write_charts
from ..tables import Column, markdown_table, write_csv, write_text
from .analysis import DRAWS, LEVEL, RIDGE, agreement, groups, strengths
from .answers import Participant
from .study import KINDS, QUESTIONS, Key

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

NAME = "observers-results"
_WIDTH, _ROW, _REST = 8.5, 0.24, 1.0  # inches
_STEP = 0.8  # of a row, which the groups share
_KINDS = {"still": "Photographs", "turntable": "Turntables"}
_STRENGTHS: tuple[Column, ...] = (
    ("group", "type", ""),
    ("question", "question", ""),
    ("method", "method", ""),
    ("participants", "participants", "d"),
    ("answers", "answers", "d"),
    ("strength", "strength", "+.2f"),
    ("low", "from", "+.2f"),
    ("high", "to", "+.2f"),
    ("preferred", "preferred, %", ".0f"),
)
_AGREEMENT: tuple[Column, ...] = (
    ("group", "type", ""),
    ("question", "question", ""),
    ("pairs", "pairs shown twice", "d"),
    ("same", "same answer, %", ".0f"),
    ("low", "from", ".0f"),
    ("high", "to", ".0f"),
    ("left", "left chosen, %", ".0f"),
)
_CHANGES: tuple[Column, ...] = (
    ("cvd", "made for", ""),
    ("kind", "kind", ""),
    ("method", "method", ""),
    ("delta_e", "mean ΔE00", ".2f"),
)


def write_results(folder: Path, participants: Sequence[Participant], key: Key, command: str, draws: int = DRAWS) -> str:
    """Write everything into `folder`; returns the text.

    Raises:
        InputError: matplotlib is missing.
    """
    found, repeated = strengths(participants, key, draws=draws), agreement(participants, draws=draws)
    write_csv(folder / f"{NAME}.csv", found)
    write_results_chart(folder, found)
    shown = pd.DataFrame([vars(item) for item in key.shown.values()])
    changes = shown.groupby(["cvd", "kind", "method"], sort=False).delta_e.mean().reset_index()
    members = {name: len(some) for name, some in groups(participants).items()}
    lines = [
        "# What the participants chose",
        "",
        f"By `{command}`, of study {key.study}, made by `{key.command}`.",
        "",
        f"Participants by the arrangement test: {', '.join(f'{name} {count}' for name, count in members.items())}.",
        "",
        *(f"- **{name}**: {text}" for name, text in QUESTIONS.items()),
        "",
        "*Strength*: natural logarithm of the odds of being chosen over the first method of its table (Bradley-Terry, "
        f"maximum likelihood with a ridge of {RIDGE:g}), with the {100 * LEVEL:.0f} % interval over {draws:,} draws of "
        "participants; *preferred*: the same as a probability, 50 being chance.",
        "",
        picture(NAME, "The strength of each method under each question, by type, with intervals"),
        "",
    ]
    for kind in KINDS:
        mine = found[found.kind == kind]
        lines += [f"## {_KINDS[kind]}", "", *markdown_table(mine, _STRENGTHS), ""] if len(mine) else []
    lines += ["## Pairs shown twice", "", *markdown_table(repeated, _AGREEMENT), ""]
    lines += ["## How much the methods changed", "", *markdown_table(changes, _CHANGES)]
    return write_text(folder / f"{NAME}.md", lines)


def write_results_chart(folder: Path, found: pd.DataFrame) -> list[Path]:
    """Write the strengths, a column of panels for each question and a row for each kind, as `write_charts` does."""
    kinds = [kind for kind in KINDS if (found.kind == kind).any()]
    lines = [_ROW * found[found.kind == kind].method.nunique() * (1 + found.group.nunique()) for kind in kinds]

    def draw(figure: Figure, theme: Theme) -> None:
        panels = figure.subplots(len(kinds), len(QUESTIONS), squeeze=False, sharex=True, height_ratios=lines)
        for row, kind in zip(panels, kinds, strict=True):
            for panel, question in zip(row, QUESTIONS, strict=True):
                _draw_panel(panel, found[(found.kind == kind) & (found.question == question)], theme)
                panel.set_title(f"{_KINDS[kind]}: {question}")
            row[-1].set_yticklabels([])
        for panel in panels[-1]:
            panel.set_xlabel("log odds of being chosen over the first one")
        figure.legend(*panels[0][0].get_legend_handles_labels(), loc="outside lower center", ncols=4)

    return write_charts(folder, NAME, (_WIDTH, sum(lines) + _REST), draw)


def _draw_panel(panel: Axes, found: pd.DataFrame, theme: Theme) -> None:
    methods, types = list(found.method.unique()), list(found.group.unique())
    for number, (group, style) in enumerate(zip(types, theme.series, strict=False)):
        mine = found[found.group == group]
        offset = _STEP * ((number + 0.5) / len(types) - 0.5)
        heights = [methods.index(method) + offset for method in mine.method]
        panel.hlines(heights, mine.low, mine.high, color=style.color, linewidth=1.5)
        plot_series(panel, mine.strength, heights, style, group, joined=False)
    panel.axvline(0.0, color=theme.muted, linewidth=1, linestyle=":")
    panel.set_yticks(range(len(methods)), methods)
    panel.set_ylim(len(methods) - 0.5, -0.5)
    panel.grid(visible=False, axis="y")
