"""What batches of turntables cost: a second worker, a frame, a kill, a thousand items; and whether engines agree.

Command: ``benchmark.py batch``.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from ....core.batch.batch_file import read_batch
from ....core.batch.console import check_captures
from ....core.batch.export import export_openjd
from ....core.batch.local_pool import run_locally
from ....core.batch.plan import make_plan
from ....core.batch.records import record_path
from ....core.batch.scheduler import BatchOutcome, log_path
from ....core.batch.task import SCRIPT, Plan, write_plan
from ....core.demo import SHOWROOM
from ....core.errors import InputError
from ....core.rendering.frames import make_pictures, simulation_model
from ....core.rendering.requests import FramesArguments
from ....core.runtime.cli import ConsoleReporter
from ....core.runtime.protocol import Reporter
from ....core.runtime.resources import Resources
from ..options import Part, positive
from ..tables import Column, frame_of, markdown_table, write_csv, write_text

STAGE = "batch"
_CHUNK = 4  # frames
_ITEMS = 1000
_INSPECTED = 50  # captures
_MEMORY_MB = 1 << 20  # more than any plan needs, so that only cores matter
_OBSERVER = "deutan-1.0"
_POLL_SECONDS = 0.05
_SETTLE_SECONDS = 3.0  # for tasks to notice that their parent was killed
_COLUMNS: tuple[Column, ...] = (
    ("name", "figure", ""),
    ("value", "median", ".2f"),
    ("low", "lowest", ".2f"),
    ("high", "highest", ".2f"),
    ("unit", "unit", ""),
    ("goal", "goal", ""),
)


@dataclass(frozen=True)
class Figure:
    """One measurement.

    Attributes:
        name: of the figure.
        value: the median over the repetitions.
        low, high: the extremes.
        unit: of all three.
        goal: the target; "" for figures that only explain others.
    """

    name: str
    value: float
    low: float
    high: float
    unit: str
    goal: str = ""


@dataclass(frozen=True)
class BatchBenchmark:
    """Measures on turntables of one finished run.

    Args:
        run: the run's folder.
        folder: for the batches.
        frames: of a turntable; every fourth begins a chunk.
        size: width and height of a frame in pixels.
        rounds: repetitions.
    """

    run: Path
    folder: Path
    frames: int = 16
    size: tuple[int, int] = (480, 360)
    rounds: int = 3

    def measure(self, reporter: Reporter) -> list[Figure]:
        """All figures; engines that are not installed are skipped with a warning."""
        parts: Sequence[tuple[str, Callable[[], list[Figure]]]] = (
            ("a second worker", self.second_worker),
            ("frames after the first", self.later_frames),
            ("a kill", self.work_lost_by_a_kill),
            ("a large batch", self.large_batch),
            ("photographs of captures", self.inspecting_captures),
            ("engines", lambda: self.disagreement_of_engines(reporter)),
        )
        figures = []
        for done, (name, part) in enumerate(parts):
            reporter.progress(STAGE, done / len(parts), name)
            figures += part()
        reporter.progress(STAGE, 1.0)
        return figures

    def second_worker(self) -> list[Figure]:
        """The speedup of two workers with a thread each over one, measured in turns."""
        one, two = [], []
        for turn in range(self.rounds):
            one.append(self.run_locally(self.plan(f"one-{turn}"), cores=1).seconds)
            two.append(self.run_locally(self.plan(f"two-{turn}"), cores=2).seconds)
        ratios = [alone / together for alone, together in zip(one, two, strict=True)]
        return [
            _figure("one worker", one, "s"),
            _figure("two workers", two, "s"),
            _figure("two workers against one", ratios, "times faster", "≥ 1.8"),
        ]

    def later_frames(self) -> list[Figure]:
        """The overhead of a chunk's frames after the first over rendering, without and with a simulated picture."""
        plan = self.plan("frames")
        first = FramesArguments.from_dict(plan.tasks[0].arguments)
        plain = replace(first, last=min(self.frames, 2 * _CHUNK))
        model = simulation_model(plan.out / first.run)
        observed = replace(plain, simulated={_OBSERVER: "observed"}, model=model)
        loading: list[float] = []
        overhead: list[float] = []
        overhead_observed: list[float] = []
        for _ in range(self.rounds):
            for arguments, found in ((plain, overhead), (observed, overhead_observed)):
                result = make_pictures("frames", arguments.to_dict(), plan.out, lambda _: None, threads=1)
                seconds = result["seconds"]
                loading.append(seconds["loading"])
                found.append(100.0 * (sum(seconds["pictures"][1:]) / sum(seconds["rendering"][1:]) - 1.0))
        return [
            _figure("loading a run, once a chunk", loading, "s"),
            _figure("a later frame beside its render", overhead, "%", "≤ 5"),
            _figure("the same with an observer's picture", overhead_observed, "%"),
        ]

    def work_lost_by_a_kill(self) -> list[Figure]:
        """Tasks that are repeated after a batch is killed in the middle and restarted."""
        lost, in_flight = [], []
        for turn in range(self.rounds):
            plan = self.plan(f"kill-{turn}")
            command = [sys.executable, str(SCRIPT), str(self._batch_file(plan)), "--out", str(plan.out), "--cores", "2"]
            batch = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            while batch.poll() is None and not _done(plan):
                time.sleep(_POLL_SECONDS)
            batch.kill()
            batch.wait()
            time.sleep(_SETTLE_SECONDS)
            in_flight.append(_attempts(plan) - _done(plan))
            self.run_locally(plan, cores=2)
            lost.append(_attempts(plan) - len(plan.tasks))
        return [
            _figure("tasks in flight at a kill", in_flight, "tasks"),
            _figure("tasks repeated after it", lost, "tasks", "≤ in flight"),
        ]

    def large_batch(self) -> list[Figure]:
        """Reading, checking and planning a thousand items, alternately captures and runs."""
        path = self.folder / "large.toml"
        sources = (f"capture = {json.dumps(str(SHOWROOM))}", f"run = {json.dumps(str(self.run.absolute()))}")
        items = "".join(f'[[items]]\nname = "item-{n}"\n{sources[n % 2]}\n' for n in range(_ITEMS))
        path.write_text('layers = ["original", "deutan-1.0"]\n' + items, encoding="utf-8")
        checking, planning = [], []
        for _ in range(self.rounds):
            started = time.process_time()
            batch = read_batch(path)
            checked = time.process_time()
            make_plan(batch, self.folder / "large")
            planning.append(time.process_time() - started)
            checking.append(checked - started)
        return [
            _figure("checking 1,000 items", checking, "s of the processor", "≤ 2"),
            _figure("checking and planning them", planning, "s of the processor"),
        ]

    def inspecting_captures(self) -> list[Figure]:
        """The time to inspect the photographs and cameras of a capture before a batch starts."""
        seconds = []
        for _ in range(self.rounds):
            one, many = self._seconds_to_inspect(1), self._seconds_to_inspect(1 + _INSPECTED)
            seconds.append(1e3 * (many - one) / _INSPECTED)
        return [_figure("inspecting one more capture of 40 photographs", seconds, "ms")]

    def _seconds_to_inspect(self, count: int) -> float:
        path = self.folder / f"inspect-{count}.toml"
        path.write_text(
            "".join(f'[[items]]\nname = "item-{n}"\ncapture = {json.dumps(str(SHOWROOM))}\n' for n in range(count)),
            encoding="utf-8",
        )
        batch = read_batch(path)
        started = time.monotonic()
        check_captures(batch, path, lambda _: None)
        return time.monotonic() - started

    def disagreement_of_engines(self, reporter: Reporter) -> list[Figure]:
        """Frames that differ between another engine and a local run."""
        plan = self.plan("local")
        self.run_locally(plan, cores=2)
        expected = _pictures(plan)
        figures = []
        for name, package, engine in (("Dask", "distributed", run_on_dask), ("openjd", "openjd", _run_by_openjd)):
            if importlib.util.find_spec(package) is None:
                reporter.warning("no-engine", f"{name} is not installed, so it is not compared")
                continue
            plan = self.plan(name.lower())
            engine(plan)
            made = _pictures(plan)
            differing = sum(made.get(path) != pixels for path, pixels in expected.items())
            name = f"of {len(expected)} frames, different from {name}"
            figures.append(_figure(name, [differing], "frames", "0"))
        return figures

    def plan(self, name: str) -> Plan:
        """Write the plan of a batch of frames in its own folder."""
        width, height = self.size
        path = self.folder / f"{name}.toml"
        path.write_text(
            'layers = ["original"]\noutputs = ["frames"]\n'
            f"[turntable]\nframes = {self.frames}\nchunk = {_CHUNK}\nsize = [{width}, {height}]\n"
            f"[[items]]\nrun = {json.dumps(str(self.run.absolute()))}\n",
            encoding="utf-8",
        )
        plan = make_plan(read_batch(path), self.folder.absolute() / name)
        if plan.out.exists():
            raise InputError(
                "there is an earlier batch", where=plan.out, remedy="choose another folder with --out, or remove it"
            )
        write_plan(plan)
        return plan

    def _batch_file(self, plan: Plan) -> Path:
        return self.folder / f"{plan.out.name}.toml"

    def run_locally(self, plan: Plan, cores: int) -> BatchOutcome:
        """Do the tasks of a plan on this machine, at most as many at once as `cores`."""
        outcome = run_locally(plan, Resources(cores, _MEMORY_MB, 0), lambda _: None)
        _require_success(outcome)
        return outcome


def write_batch_figures(folder: Path, figures: list[Figure]) -> str:
    """Write ``batch.csv`` and ``batch.md``; returns the text of the latter."""
    table = frame_of(Figure, figures)
    write_csv(folder / "batch.csv", table)
    return write_text(folder / "batch.md", markdown_table(table, _COLUMNS))


def run_on_dask(plan: Plan, workers: int = 2) -> BatchOutcome:
    """Do the tasks of a plan on a Dask cluster on this machine, of workers with one thread each."""
    import distributed

    from ....core.batch.dask import run_on_cluster

    local = {"threads_per_worker": 1, "processes": True, "dashboard_address": None}
    with distributed.LocalCluster(n_workers=workers, **local) as cluster:
        outcome = run_on_cluster(plan, cluster.scheduler_address, lambda _: None)
    _require_success(outcome)
    return outcome


def _run_by_openjd(plan: Plan) -> None:
    command = [sys.executable, "-m", "openjd", "run", str(export_openjd(plan))]
    ran = subprocess.run(command, capture_output=True, text=True)
    if ran.returncode != 0:
        what = f"openjd failed ({ran.stdout[-500:].strip()})"
        raise InputError(what, where=plan.out, remedy=f"run it by hand: {' '.join(command)}")


def _require_success(outcome: BatchOutcome) -> None:
    for name, ended in outcome.tasks.items():
        if not ended.state.is_good:
            raise InputError(
                f"{name} failed: {ended.message}", where=log_path(name, outcome.plan.out), remedy="read this log"
            )


def _done(plan: Plan) -> int:
    return sum(record_path(task, plan.out).exists() for task in plan.tasks)


def _attempts(plan: Plan) -> int:
    """Number of started task processes."""
    logs = (log_path(task.name, plan.out) for task in plan.tasks)
    return sum(line.startswith("--- ") for log in logs if log.exists() for line in log.read_text().splitlines())


def _pictures(plan: Plan) -> dict[Path, bytes]:
    return {path.relative_to(plan.out): path.read_bytes() for path in plan.out.rglob("*.png")}


def _figure(name: str, values: Sequence[float], unit: str, goal: str = "") -> Figure:
    return Figure(name, statistics.median(values), min(values), max(values), unit, goal)


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("--run", type=Path, default=Path("out/demo"), help="a finished run (out/demo)")
    add("--frames", type=positive, default=16, metavar="N", help="frames of a turntable, in chunks of four (16)")
    add("--rounds", type=positive, default=3, metavar="N", help="repetitions; medians are reported (3)")


def _measure(options: argparse.Namespace) -> str:
    """Render turntables of a run in several ways; writes batch.csv and batch.md."""
    with tempfile.TemporaryDirectory(prefix="cvdgs-batch-") as folder:
        benchmark = BatchBenchmark(options.run, Path(folder), frames=options.frames, rounds=options.rounds)
        return write_batch_figures(options.out, benchmark.measure(ConsoleReporter(sys.stderr)))


PART = Part(
    "batch", "batches of turntables: workers, frames, kills, a thousand items, engines", _add_arguments, _measure
)
