"""How the frames of a batch scale with workers, and a model that says where more of them stop helping.

Command: ``benchmark.py throughput``.
"""

from __future__ import annotations

import argparse
import importlib.util
import math
import statistics
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.optimize import nnls

from ....core.batch.scheduler import BatchOutcome
from ....core.batch.task import Plan
from ....core.runtime.cli import ConsoleReporter
from ....core.runtime.protocol import Reporter
from ....core.runtime.resources import available_processors
from ..charts import Theme, logarithmic, picture, plot_series, write_charts
from ..options import Part, positive
from ..provenance import trained_product
from ..tables import Column, frame_of, markdown_table, number, write_csv, write_text
from .batch import BatchBenchmark, run_on_dask

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NAME = "throughput"
WORKERS = (1, 2, 4)
LOCAL, DASK = "local", "Dask"
LEAST_GAIN = 0.1
"""Of the work of one worker: what a further one has to add to be worth it."""
_MOST_DRAWN = 64  # workers
_CHART_SIZE = (6.4, 4.2)  # inches
_COLUMNS: tuple[Column, ...] = (
    ("engine", "engine", ""),
    ("workers", "workers", "d"),
    ("seconds", "seconds", ".1f"),
    ("rate", "frames a second", ".2f"),
    ("speedup", "times one worker", ".2f"),
)
_MODEL: tuple[Column, ...] = (
    ("engine", "engine", ""),
    ("serial", "contention σ", ".3f"),
    ("crosstalk", "crosstalk κ", ".4f"),
    ("worth", "workers that each add a tenth", ".0f"),
    ("reached", "then times one", ".1f"),
    ("most", "times one, at most", ".1f"),
)
_DEFINITIONS = """\
A turntable of {frames} frames of {size} pixels of a finished run, in tasks of four, by workers with one thread each on
one machine of {cores} processor cores; medians of {rounds}. The model is Gunther's universal scalability law, N
workers do N / (1 + σ (N - 1) + κ N (N - 1)) times the work of one; with κ = 0 it is Amdahl's law, whose limit is 1/σ.
It is fitted to the measurements with no more workers than there are cores, so with two cores it has one free parameter
and says what these tasks share on one machine. Workers beyond the cores cannot help, whatever it says; workers on other
machines share less, so its limit is for them a low one. *Workers that each add a tenth*: beyond that number, a further
one adds less than a tenth of the work of one."""


@dataclass(frozen=True)
class Throughput:
    """One engine with a number of workers.

    Attributes:
        engine: `LOCAL` or `DASK`.
        workers: of one thread each.
        seconds: of the batch, the median.
        rate: frames a second.
        speedup: relative to the same engine with its fewest workers.
    """

    engine: str
    workers: int
    seconds: float
    rate: float
    speedup: float


@dataclass(frozen=True)
class Scalability:
    """The universal scalability law of Gunther, *Guerrilla Capacity Planning*, 2007, section 4.

    Attributes:
        engine: that it is fitted to.
        serial: σ, the share of the work that workers wait for each other with; NaN where that is unknown.
        crosstalk: κ, what each pair of workers costs.
    """

    engine: str
    serial: float
    crosstalk: float

    @property
    def best(self) -> float:
        """The number of workers with the most work done; NaN where it always grows."""
        return math.sqrt(max(1.0 - self.serial, 0.0) / self.crosstalk) if self.crosstalk > 0.0 else math.nan

    @property
    def most(self) -> float:
        """The largest speedup; infinite where nothing is shared, NaN where the law is unknown."""
        if math.isnan(self.serial):
            return math.nan
        if not math.isnan(self.best):
            return self.speedup(max(self.best, 1.0))
        return 1.0 / self.serial if self.serial > 0.0 else math.inf

    @property
    def worth(self) -> float:
        """The last number of workers of which each adds `LEAST_GAIN`; infinite and NaN as `most`."""
        if math.isnan(self.serial):
            return math.nan
        if self.serial <= 0.0 and self.crosstalk <= 0.0:
            return math.inf
        workers = 1
        while self.speedup(workers + 1) - self.speedup(workers) >= LEAST_GAIN:
            workers += 1
        return float(workers)

    def speedup(self, workers: float) -> float:
        """Times the work of one worker."""
        others = workers - 1.0
        return workers / (1.0 + self.serial * others + self.crosstalk * workers * others)


def fit_scalability(engine: str, speedups: Mapping[int, float]) -> Scalability:
    """The law that fits speedups by numbers of workers best, both parameters at least 0.

    N / speedup - 1 = σ (N - 1) + κ N (N - 1) is linear in them. Two numbers of workers determine σ alone, one nothing.

    Args:
        speedups: relative to one worker, which may be among them.
    """
    several = np.array([count for count in speedups if count > 1], float)
    if not several.size:
        return Scalability(engine, math.nan, 0.0)
    lost = several / np.array([speedups[int(count)] for count in several]) - 1.0
    terms = np.stack([several - 1.0, several * (several - 1.0)], axis=1)[:, : len(several)]
    found, _ = nnls(terms, lost)
    return Scalability(engine, float(found[0]), float(found[1]) if len(found) > 1 else 0.0)


def measure_throughput(
    benchmark: BatchBenchmark, reporter: Reporter, workers: Sequence[int] = WORKERS
) -> list[Throughput]:
    """Each engine that is installed with each number of workers, `benchmark.rounds` times in turns."""
    engines: dict[str, Callable[[Plan, int], BatchOutcome]] = {LOCAL: benchmark.run_locally}
    if importlib.util.find_spec("distributed") is None:
        reporter.warning("no-engine", "Dask is not installed, so it is not measured")
    else:
        engines[DASK] = run_on_dask
    seconds: dict[tuple[str, int], list[float]] = {}
    total = benchmark.rounds * len(engines) * len(workers)
    for turn in range(benchmark.rounds):
        for engine, run in engines.items():
            for count in workers:
                plan = benchmark.plan(f"{engine.lower()}-{count}-{turn}")
                seconds.setdefault((engine, count), []).append(run(plan, count).seconds)
                done = sum(map(len, seconds.values()))
                reporter.progress(NAME, done / total, f"{engine}, {count} workers")
    return throughputs(seconds, benchmark.frames)


def throughputs(seconds: Mapping[tuple[str, int], Sequence[float]], frames: int) -> list[Throughput]:
    """The figures of repeated batches by engine and number of workers."""
    medians = {key: statistics.median(values) for key, values in seconds.items()}
    found = []
    for (engine, count), median in medians.items():
        fewest = min(other for name, other in medians if name == engine)
        found.append(Throughput(engine, count, median, frames / median, medians[engine, fewest] / median))
    return found


def write_throughput(
    folder: Path, found: Sequence[Throughput], *, frames: int, size: tuple[int, int], rounds: int, cores: int
) -> str:
    """Write ``throughput.csv``, ``throughput.md`` and its chart; returns the text of the page."""
    table = frame_of(Throughput, found)
    write_csv(folder / f"{NAME}.csv", table)
    within = table[table.workers <= cores]
    laws = [
        fit_scalability(str(engine), dict(zip(mine.workers, mine.speedup, strict=True)))
        for engine, mine in within.groupby("engine", sort=False)
    ]
    models = frame_of(Scalability, laws).assign(
        worth=[law.worth for law in laws],
        reached=[law.speedup(law.worth) if math.isfinite(law.worth) else math.nan for law in laws],
        most=[law.most for law in laws],
    )
    write_charts(folder, NAME, _CHART_SIZE, partial(_draw, found=found, laws=laws, cores=cores), formats=("svg",))
    lines = [
        "# Batches over workers",
        "",
        _DEFINITIONS.format(frames=frames, size=f"{size[0]}×{size[1]}", rounds=rounds, cores=cores),
        "",
    ]
    lines += [*markdown_table(table, _COLUMNS), "", "## Where more workers stop helping", ""]
    alternative = "Work done over workers, measured and by the model; the tables have the same figures"
    lines += [*markdown_table(models, _MODEL), "", picture(NAME, alternative), ""]
    for law in laws:
        halves = ", ".join(f"{count} workers {number(law.speedup(count), '.1f')} times" for count in (4, 8, 16))
        lines.append(f"- {law.engine}, by the model on as many cores: {halves} the work of one.")
    return write_text(folder / f"{NAME}.md", lines)


def _draw(figure: Figure, theme: Theme, found: Sequence[Throughput], laws: Sequence[Scalability], cores: int) -> None:
    """Points that were measured, lines of the laws, and what workers who share nothing would do."""
    axes = figure.subplots()
    logarithmic(axes)
    workers = np.geomspace(1, _MOST_DRAWN, 100)
    axes.plot(workers, workers, color=theme.muted, linestyle="dotted", linewidth=1, label="nothing shared")
    axes.axvline(cores, color=theme.muted, linestyle="dashed", linewidth=0.8, label=f"cores measured on: {cores}")
    for law, style in zip(laws, theme.series, strict=False):
        mine = [one for one in found if one.engine == law.engine]
        label = f"{law.engine}, measured"
        plot_series(axes, [one.workers for one in mine], [one.speedup for one in mine], style, label, joined=False)
        line: dict[str, Any] = {"color": style.color, "linestyle": style.dash, "linewidth": 1.5}
        axes.plot(workers, [law.speedup(count) for count in workers], label=f"{law.engine}, model", **line)
    highest = max([one.speedup for one in found] + [law.speedup(_MOST_DRAWN) for law in laws])
    axes.set(title="times the work of one worker", xlabel="workers of one thread each", ylim=(0.0, 1.1 * highest))
    figure.legend(loc="outside lower center", ncols=3)


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("--run", type=Path, default=Path("out/demo"), help="a finished run (out/demo)")
    add("--frames", type=positive, default=32, metavar="N", help="frames of the turntable, in chunks of four (32)")
    add("--width", type=positive, default=480, metavar="PIXELS", help="of a frame, three quarters as high (480)")
    add("--rounds", type=positive, default=3, metavar="N", help="repetitions; medians are reported (3)")


def _measure(options: argparse.Namespace) -> str:
    """Render a turntable with more and more workers; writes throughput.csv, throughput.md and a chart."""
    with tempfile.TemporaryDirectory(prefix="cvdgs-batch-") as folder:
        asked = {"frames": options.frames, "size": (options.width, options.width * 3 // 4), "rounds": options.rounds}
        benchmark = BatchBenchmark(options.run, Path(folder), **asked)
        found = measure_throughput(benchmark, ConsoleReporter(sys.stderr))
    return write_throughput(options.out, found, **asked, cores=available_processors())


PART = Part(
    NAME,
    "frames of a batch over workers, and where more of them stop helping",
    _add_arguments,
    _measure,
    pages=(f"{NAME}.md",),
    shaped_by=lambda: (*trained_product(), WORKERS, LEAST_GAIN),
)
