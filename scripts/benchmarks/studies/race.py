"""How much work another program needs for the quality that it reaches, and ours for the same on the same photographs.

Command: ``benchmark.py peers``, which runs one training after the other, each with the machine to itself.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from ....core.errors import InputError
from ....core.pipeline.device import describe_processor
from ....core.runtime.cli import ConsoleReporter
from ....core.runtime.protocol import Reporter
from ....core.settings import QUALITIES
from ....core.splats import raster
from ....core.splats.training.plan import TrainingPlan
from ..charts import Curve, Theme, draw_curves, picture, write_charts
from ..options import Part, add_study_arguments, chosen_sources, counted, positive, with_quick_defaults, work_folder
from ..provenance import fingerprint, trained_product
from ..tables import Column, frame_of, markdown_table, means_and_deviations, tables_of_means, write_csv, write_text
from ..timing.runs import train_once
from ..timing.trainer import QUICK_PLAN
from .captures import DEMO, Centred, SubjectSource
from .peers import OPENSPLAT_ITERATIONS, OpenSplat, OpenSplatRun, Point, opensplat_runs, train_opensplat
from .recipe import optimistic

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NAME = "peers"
FINISHES_FILE = "peers.jsonl"
SIZE = 480
DRAFT, STANDARD = (
    next(quality.iterations for quality in QUALITIES if quality.name == name) for name in ("DRAFT", "STANDARD")
)
SHORT = 300
"""Steps of our shortest run."""
LONG = "ours, a long run"
OURS = {
    "ours, quick": QUICK_PLAN,
    **{
        label: TrainingPlan(steps=steps, limit=None, sh_degree=None, curve_points=40)
        for label, steps in ((f"ours, {SHORT} steps", SHORT), ("ours, a draft", DRAFT), (LONG, STANDARD))
    },
}
"""Plans of our trainings, measured often enough to read off when they reach a quality. But for the quick one everything
is decided automatically."""
_PANEL, _HEIGHT = 4.6, 4.0  # inches
_KEYS: tuple[Column, ...] = (("capture", "capture", ""), ("label", "program", ""), ("iterations", "steps", "d"))
_COLUMNS: tuple[Column, ...] = (
    ("psnr", "PSNR", ".2f"),
    ("processor_seconds", "processor seconds", ".1f"),
    ("seconds", "by the clock", ".1f"),
    ("gaussians", "Gaussians", ".0f"),
)
_EQUAL: tuple[Column, ...] = (
    ("capture", "capture", ""),
    ("label", "to the best of", ""),
    ("psnr", "PSNR", ".2f"),
    ("processor_seconds", "it took", ".1f"),
    ("ours", "our run", ""),
    ("our_seconds", "took", ".1f"),
    ("times", "times less", ".1f"),
)
_RANGE: tuple[Column, ...] = (("least", "at least", ".1f"), ("most", "at most", ".1f"))
_DEFINITIONS = """\
All trainings of a capture one after the other on the same processor cores, in **processor seconds**: time by the clock
depends on what else a machine does. Each program gets the same training views (every eighth is held out) and sparse
points, and its scenes are rendered by our rasteriser for the held-out views, several times on the way. OpenSplat's
rasteriser for processors takes every principal point to be in the middle of the photograph whatever the file says, so
all programs get photographs that are cropped until it is there (of those at hand only fox's need it); then its own
picture of its scene and ours agree to 44.8 dB (a view of fox at 240 pixels). A peer's time has the start of its program
and the reading of the photographs in it, a few seconds, and the saving of the scenes that are measured; ours has not,
and neither has the measuring. Where a run of ours found the poses to be off and corrected them, its last measurement is
from poses of the held-out views that were aligned with its scene by their photographs; a peer's never are. *To the best
of*: the highest PSNR that was measured of a peer, and when; ours took as long as until it had that for the first time;
a dash: never. OpenSplat's own number of steps, 30,000, takes hours on a processor: it is given fewer, on which its
schedules depend as they do for its users. Its *best settings* are those of four tried on fox: densification every 100
steps from the 100th to the last (by default its Adam takes a step only every 32 once densification has ended,
half-way), the first half at half size. Threads of all programs wait passively (`OMP_WAIT_POLICY`), as they do in our
runs: with those that spin, the default, OpenSplat's best settings took 140 processor seconds instead of 121 on fox and
125 instead of 94 in the room (one run each)."""
_REPEATED = """\
Programs take turns, seed by seed; OpenSplat's own seed is fixed, so its runs are repetitions. A seed's ratio is that of
its own two runs. The first table has medians over the seeds, a run that never got there counting as endless, and the
least and the largest ratio; the last ones have means and standard deviations, the chart has the first seed."""


@dataclass(frozen=True)
class Finish:
    """A training at its end, and on its way there.

    Attributes:
        capture, label: what was trained, and by which program and settings.
        seed: of ours; which repetition it is of a program that has a fixed one.
        iterations: steps.
        psnr: of the held-out views, dB.
        seconds, processor_seconds: wall time, and processor time of all threads.
        gaussians: their number.
        curve: in the order of time.
        decided_on_held_out: as of `TrainingResult`; no other program sees held-out views.
    """

    capture: str
    label: str
    seed: int
    iterations: int
    psnr: float
    seconds: float
    processor_seconds: float
    gaussians: int
    curve: tuple[Point, ...] = ()
    decided_on_held_out: bool = False

    @property
    def best(self) -> Point:
        """The first of the measurements with the highest PSNR."""
        return max(self.curve, key=lambda point: point.psnr)

    def seconds_to(self, psnr: float) -> float:
        """Processor seconds until a PSNR of at least `psnr` was first measured; NaN if it never was."""
        return next((point.processor_seconds for point in self.curve if point.psnr >= psnr), math.nan)


@dataclass(frozen=True)
class Equal:
    """When one of our runs had reached the best of a peer; NaN where it never did.

    Attributes:
        capture, label, seed: of the peer's `Finish`.
        psnr, processor_seconds: of its best.
        ours: label of our run.
        our_seconds: processor seconds of it, until that PSNR was first measured.
        times: how many times as much the peer took.
    """

    capture: str
    label: str
    seed: int
    psnr: float
    processor_seconds: float
    ours: str
    our_seconds: float
    times: float


class FinishStore:
    """Finished trainings in a file of JSON lines, so that a broken-off race goes on where it was."""

    def __init__(self, path: Path, *, again: bool = False) -> None:
        self._path = path
        path.parent.mkdir(parents=True, exist_ok=True)
        if again:
            path.unlink(missing_ok=True)
        lines = path.read_text(encoding="utf-8").splitlines(keepends=True) if path.exists() else []
        complete = [json.loads(line) for line in lines if line.endswith("\n")]
        self._known = {entry.pop("key"): _finish_of(entry) for entry in complete}
        if len(complete) < len(lines):  # broken off while it was written
            path.write_text("".join(lines[: len(complete)]), encoding="utf-8")

    def get(self, key: str, make: Callable[[], Finish]) -> Finish:
        """The training of a key; made and kept if it is not there."""
        if key not in self._known:
            self._known[key] = made = make()
            with self._path.open("a", encoding="utf-8") as file:
                file.write(json.dumps({"key": key, **asdict(made)}) + "\n")
        return self._known[key]


def peer_finishes(
    program: Path,
    source: SubjectSource,
    store: FinishStore,
    reporter: Reporter,
    runs: Sequence[OpenSplatRun],
    seed: int = 0,
) -> list[Finish]:
    """OpenSplat's trainings of a capture; those that `store` has are not repeated.

    Args:
        seed: which repetition this is: OpenSplat's own seed is fixed.
    """
    version = OpenSplat.at(program).version

    def train(run: OpenSplatRun) -> Finish:
        (peer,) = train_opensplat(program, source.name, source.load(), reporter, [run])
        trial = peer.trial
        cost = (trial.geometry_seconds, trial.processor_seconds)
        how = (trial.capture, trial.label, seed, trial.iterations)
        return Finish(*how, trial.psnr, *cost, trial.gaussians, peer.curve)

    return [store.get(_key(source, version, run, seed), partial(train, run)) for run in runs]


def our_finishes(
    source: SubjectSource, store: FinishStore, iterations: int, reporter: Reporter, seed: int = 0
) -> list[Finish]:
    """Our trainings of a capture; those that `store` has are not repeated.

    Args:
        iterations: of the longest run.
    """

    def train(label: str, plan: TrainingPlan) -> Finish:
        reporter.status(NAME, f"{source.name}, {label}, seed {seed}")
        run = train_once(source.load().given, label, plan, seed=seed)
        curve = tuple(Point(run.busy * seconds, psnr) for seconds, psnr in run.curve)
        cost = (run.seconds, run.processor_seconds, run.gaussians)
        return Finish(source.name, label, seed, run.steps, run.psnr, *cost, curve, run.decided_on_held_out)

    plans = {**OURS, LONG: replace(OURS[LONG], steps=iterations)}
    known = partial(_key, source, trained_product())
    return [store.get(known(name, plan, seed), partial(train, name, plan)) for name, plan in plans.items()]


def race(finish: Finish, ours: Sequence[Finish]) -> list[Equal]:
    """When each of our trainings of a seed had reached the best of a peer's."""
    found, best = [], finish.best
    for run in ours:
        seconds = run.seconds_to(best.psnr)
        times = math.nan if math.isnan(seconds) else best.processor_seconds / seconds
        equal = (best.psnr, best.processor_seconds, run.label, seconds, times)
        found.append(Equal(finish.capture, finish.label, finish.seed, *equal))
    return found


def over_seeds(equals: Sequence[Equal]) -> pd.DataFrame:
    """The medians of `Equal` over the seeds, with the ``least`` and ``most`` of their ratios.

    A run that never reached the peer counts as one that took endlessly; NaN where that is the median, or the least.
    """
    table = frame_of(Equal, equals)
    endless = table.assign(our_seconds=table.our_seconds.fillna(np.inf), times=table.times.fillna(0.0))
    groups = endless.groupby(["capture", "label", "ours"], sort=False)
    medians = groups[["psnr", "processor_seconds", "our_seconds", "times"]].median()
    found = medians.assign(least=groups.times.min(), most=groups.times.max()).replace(np.inf, np.nan)
    ratios = ["times", "least", "most"]
    found[ratios] = found[ratios].replace(0.0, np.nan)
    return found.reset_index()


def write_peers(folder: Path, finishes: Sequence[Finish], equals: Sequence[Equal], heading: Sequence[str]) -> str:
    """Write ``peers.csv``, ``peers.md`` and its chart; returns the text of the page."""
    table = frame_of(Finish, [replace(finish, curve=()) for finish in finishes]).drop(columns="curve")
    write_csv(folder / f"{NAME}.csv", table)
    captures = list(dict.fromkeys(finish.capture for finish in finishes))
    size = (_PANEL * len(captures), _HEIGHT)
    write_charts(folder, NAME, size, partial(_draw, finishes=finishes), formats=("svg",))
    alternative = "PSNR of held-out views over processor seconds, ours and others; the tables have the ends"
    repeated = table.seed.nunique() > 1
    lines = ["# Time to equal quality", "", *heading, "", _DEFINITIONS, ""]
    lines += [_REPEATED, ""] if repeated else []
    lines += [*optimistic(table), picture(NAME, alternative), ""]
    lines += [*markdown_table(over_seeds(equals), (*_EQUAL, *_RANGE) if repeated else _EQUAL), "", "## All runs", ""]
    of_runs = means_and_deviations(table, [name for name, _, _ in _KEYS], _COLUMNS)
    return write_text(folder / f"{NAME}.md", [*lines, *tables_of_means(*of_runs, _KEYS, _COLUMNS)])


def _draw(figure: Figure, theme: Theme, finishes: Sequence[Finish]) -> None:
    """A panel for each capture, a series for each program and settings, of the first seed."""
    curves = [
        Curve(
            finish.capture,
            finish.label,
            [point.processor_seconds for point in finish.curve],
            [point.psnr for point in finish.curve],
        )
        for finish in finishes
        if finish.seed == 0
    ]
    draw_curves(figure, theme, curves, y="PSNR of held-out views, dB", x="processor seconds", columns=2)


def _key(source: SubjectSource, *facts: Any) -> str:
    """Of a training on this machine: times of another one are not comparable with those that are made now."""
    return fingerprint(source.key, lambda: (describe_processor(), *facts))


def _finish_of(entry: dict[str, Any]) -> Finish:
    return Finish(**{**entry, "curve": tuple(Point(**point) for point in entry["curve"])})


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add_study_arguments(parser, captures=(DEMO,), max_size=SIZE, iterations=STANDARD, alone=True)
    add, steps = parser.add_argument, OPENSPLAT_ITERATIONS
    add("--opensplat", type=Path, metavar="FILE", help="OpenSplat's executable")
    add("--peer-iterations", type=positive, default=steps, metavar="N", help=f"steps of other programs ({steps})")


def _measure(options: argparse.Namespace) -> str:
    """Train captures with other programs and with ours; writes peers.csv, peers.md and a chart."""
    options = with_quick_defaults(options)
    if options.opensplat is None:
        raise InputError("no other program is given", where="--opensplat", remedy="give OpenSplat's executable")
    reporter, finishes, equals = ConsoleReporter(sys.stderr), list[Finish](), list[Equal]()
    store = FinishStore(work_folder(options) / FINISHES_FILE, again=options.again)
    runs = opensplat_runs(options.peer_iterations)
    raster.load("cpu", reporter)  # compiles the kernels, which is no part of a training
    for source, seed in product(map(Centred, chosen_sources(options)), range(options.seeds)):
        peers = peer_finishes(options.opensplat, source, store, reporter, runs, seed)
        ours = our_finishes(source, store, options.iterations, reporter, seed)
        finishes += [*peers, *ours]
        equals += [equal for peer in peers for equal in race(peer, ours)]
    heading = [f"Photographs of at most {options.max_size} pixels, {counted(options.seeds)}."]
    return write_peers(options.out, finishes, equals, heading)


PART = Part(
    NAME,
    "work to the quality of another program (OpenSplat), on the same photographs",
    _add_arguments,
    _measure,
    pages=(f"{NAME}.md",),
    shaped_by=lambda: (*trained_product(), OURS, opensplat_runs()),
)
