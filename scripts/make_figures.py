"""The figures of docs/how-it-works.md, from a finished run of the demo: how training went, and where colours went.

    make demo
    python scripts/make_figures.py out/demo --out docs/figures

Exit codes: 0 done, 2 not a finished run.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "core"))
import bootstrap

bootstrap.load(modules=("torch", "OpenImageIO", "matplotlib"))
import numpy as np

from cvdgs.core.color.simulation import simulate
from cvdgs.core.color.spaces import image_to_tensor, srgb_to_lab
from cvdgs.core.errors import InputError
from cvdgs.core.files.images import read_png
from cvdgs.core.runs.layout import CAPTURE_FOLDER, ENHANCED_FOLDER, IMAGES_FOLDER
from cvdgs.core.runs.report import read_report
from cvdgs.core.runtime.cli import OneLineParser, exit_code
from cvdgs.core.settings import Layer
from cvdgs.scripts.benchmarks.charts import Theme, plot_series, write_charts

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLORS = 400  # that are shown, drawn at random from a view
SEED = 0


def draw_training(curve: list[dict[str, Any]], figure: Figure, theme: Theme) -> None:
    """Quality on held-out views and number of Gaussians over the time of training."""
    seconds = [entry["seconds"] for entry in curve]
    panels = (("psnr", "PSNR of held-out views, dB", 1.0), ("gaussians", "Gaussians, thousands", 1e-3))
    axes = figure.subplots(1, len(panels))
    for panel, (key, title, factor), style in zip(axes, panels, theme.series, strict=False):
        plot_series(panel, seconds, [entry[key] * factor for entry in curve], style, title)
        panel.set_title(title)
        panel.set_xlabel("seconds of training")


def draw_colors(
    before: np.ndarray, after: np.ndarray, observer: tuple[str, float, str], figure: Figure, theme: Theme
) -> None:
    """Where the colours of a view lie for the observer, before and after the enhancement: lightness over blue–yellow.

    These are the two dimensions that a red–green dichromat has.

    Args:
        before, after: (N, 3) uint8 sRGB colours of the same places.
        observer: type, severity and model of the simulation.
    """
    axes = figure.subplots(1, 2, sharex=True, sharey=True)
    for panel, colors, title in zip(axes, (before, after), ("photograph", "enhanced photograph"), strict=True):
        lab = srgb_to_lab(simulate(image_to_tensor(colors[None]), *observer))[:, 0].numpy()
        normal = image_to_tensor(before[None]).numpy()[:, 0].T
        panel.scatter(lab[2], lab[0], s=14, c=normal, edgecolors=theme.muted, linewidths=0.3)
        panel.set_title(f"{title}, as a {observer[0]} sees it")
        panel.set_xlabel("b*: blue to yellow")
    axes[0].set_ylabel("L*: lightness")


def make_figures(run: Path, out: Path) -> None:
    """Write both figures, each for light and dark pages.

    Raises:
        InputError: `run` is not a finished run, or held no views out.
    """
    report = read_report(run)
    try:
        layer, view = next(iter(report["layers"])), report["views_shown"][0]
        curve, simulation, observer = report["curve"], report["settings"]["simulation"], Layer.from_name(layer)
        before = read_png(run / CAPTURE_FOLDER / IMAGES_FOLDER / f"{view}.png").reshape(-1, 3)
        after = read_png(run / ENHANCED_FOLDER / layer / f"{view}.png").reshape(-1, 3)
        measured = all(entry["psnr"] is not None for entry in curve)
    except (OSError, LookupError, TypeError, ValueError, StopIteration) as error:
        raise InputError(f"is not a finished run ({error})", where=run, remedy="run 'make demo' first") from None
    if not measured:
        raise InputError("the run held no views out to be measured on", where=run, remedy="make it with --holdout 8")
    chosen = np.random.default_rng(SEED).choice(len(before), COLORS, replace=False)

    def colors(figure: Figure, theme: Theme) -> None:
        draw_colors(before[chosen], after[chosen], (observer.cvd, observer.severity, simulation), figure, theme)

    write_charts(out, "colours", (8.0, 3.6), colors, formats=("svg",))
    write_charts(out, "training", (8.0, 2.8), lambda *to: draw_training(curve, *to), formats=("svg",))


def main(arguments: list[str]) -> int:
    """Parse the command line and draw; returns the exit code."""
    parser = OneLineParser(prog="make_figures.py", description=__doc__.splitlines()[0])
    parser.add_argument("run", type=Path, metavar="RUN", help="output folder of scripts/run.py")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for the figures")

    def work() -> None:
        options = parser.parse_args(arguments)
        make_figures(options.run, options.out)

    return exit_code("make_figures.py", work)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
