"""Measures the product's own code and writes tables: python scripts/benchmark.py PART --out DIR [options]."""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "core"))
import bootstrap

bootstrap.load()
from cvdgs.core.arguments import OneLineParser  # noqa: E402
from cvdgs.core.capture import read_capture  # noqa: E402
from cvdgs.core.console import ConsoleReporter  # noqa: E402
from cvdgs.core.demo import SHOWROOM  # noqa: E402
from cvdgs.core.errors import InputError  # noqa: E402
from cvdgs.core.evaluate.batch import BatchBenchmark, write_batch_figures  # noqa: E402
from cvdgs.core.evaluate.display import display_fidelity  # noqa: E402
from cvdgs.core.evaluate.drift import (  # noqa: E402
    RECONSTRUCTION_STEPS,
    cached_matches,
    measure_drift,
    write_drift,
)
from cvdgs.core.evaluate.enhancers.benchmark import EnhancerBenchmark  # noqa: E402
from cvdgs.core.evaluate.enhancers.methods import method_factory  # noqa: E402
from cvdgs.core.evaluate.enhancers.scores import ENHANCED_FOR  # noqa: E402
from cvdgs.core.evaluate.modes import PerViewLut, compare_modes, write_modes  # noqa: E402
from cvdgs.core.evaluate.selection import measure_selection, read_frames, write_selection  # noqa: E402
from cvdgs.core.evaluate.training import comparisons  # noqa: E402
from cvdgs.core.evaluate.training.step_comparison import compare_steps, write_steps  # noqa: E402
from cvdgs.core.settings import Layer, Settings  # noqa: E402
from cvdgs.core.splats import raster  # noqa: E402

SHARED = bootstrap.ROOT.parent / "shared"
PHOTOS = SHARED / "data" / "photos"
FOX = SHARED / "data" / "fox"
KERMIT = SHARED / "data" / "kermit"
TRAINER_TABLES = ("time", "auto", "strategies", "seeds")
STEP_SIZE = 480  # pixels of the longer side: fox at 270x480, as in the notes
PER_VIEW = "lut-per-view"  # what `modes` calls a LUT of its own for each image
ALL_ENHANCERS = ("none", "gain", "fidaner", "lut", "cgan")
QUICK: dict[str, Any] = {
    "types": ("protan", "deutan"),
    "severities": (1.0,),
    "size": 256,
    "plates": 10,
    "textiles": 6,
    "most_photographs": 6,
    "other_models": False,
    "trade_off": False,
}
"""What `enhancer --quick` measures: enough to steer a training by, in less than a minute without the LUT."""


def main(arguments: list[str]) -> int:
    """Run one part; returns the exit code."""
    try:
        options = build_parser().parse_args(arguments)
        options.out.mkdir(parents=True, exist_ok=True)
        print(options.measure(options))
    except InputError as error:
        print(f"benchmark.py: {error}", file=sys.stderr)
        return 2
    return 0


def build_parser() -> argparse.ArgumentParser:
    """A subcommand for each part, all with --out."""
    parser = OneLineParser(prog="benchmark.py", description=__doc__)
    parts = parser.add_subparsers(dest="part", required=True, metavar="PART")
    _add_step(parts.add_parser("step", help="a whole training step against the prototype's loop, in one run"))
    _add_trainer(parts.add_parser("trainer", help="time to a quality, automatic decisions, strategies, seeds"))
    _add_display(parts.add_parser("display", help="Cycles against our rasteriser on a finished run"))
    _add_enhancer(parts.add_parser("enhancer", help="enhancers compared on photographs, plates and textiles"))
    _add_drift(parts.add_parser("drift", help="how much enhanced views contradict each other before reconstruction"))
    _add_modes(parts.add_parser("modes", help="layers, joint and post: contrast, view consistency and time"))
    _add_select(parts.add_parser("select", help="hard frames and sequences of a folder, and what easy frames keep"))
    _add_batch(
        parts.add_parser("batch", help="batches of turntables: workers, frames, kills, a thousand items, engines")
    )
    for part in parts.choices.values():
        part.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for the tables")
    return parser


def _add_step(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--capture", type=Path, default=None, help="default: the evaluation data's fox, else the demo")
    parser.add_argument("--prototype", type=Path, default=SHARED / "prototypes" / "kernels", metavar="DIR")
    parser.add_argument("--rounds", type=int, default=5, help="interleaved repetitions; the medians count (5)")
    parser.add_argument("--threads", type=int, default=2)
    parser.set_defaults(measure=measure_step)


def measure_step(options: argparse.Namespace) -> str:
    """Time our step and the prototype's by turns; writes step.csv and step.md."""
    capture = read_capture(options.capture or (FOX if FOX.is_dir() else SHOWROOM), max_size=STEP_SIZE)
    found = compare_steps(capture, options.prototype, options.rounds, options.threads, ConsoleReporter(sys.stderr))
    return write_steps(options.out, capture, found)


def _add_trainer(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("--of", type=_names, default=TRAINER_TABLES, metavar="A,B", help=f"tables ({','.join(TRAINER_TABLES)})")
    add("--capture", type=Path, action="append", help="may be given again (the demo and the evaluation data's)")
    add("--prototype", type=Path, default=SHARED / "prototypes" / "kernels", metavar="DIR")
    add("--max-size", type=int, default=STEP_SIZE, metavar="PIXELS", help=f"longer side of the views ({STEP_SIZE})")
    add("--iterations", type=int, default=5000, metavar="N", help="of automatic runs, beside a third of it (5000)")
    add("--strategy-iterations", type=int, default=2000, metavar="N", help="of the strategies and seeds (2000)")
    add("--rounds", type=int, default=3, help="interleaved repetitions of the time to a quality (3)")
    add("--seeds", type=int, default=5)
    add("--threads", type=int, default=2)
    parser.set_defaults(measure=measure_trainer)


def measure_trainer(options: argparse.Namespace) -> str:
    """Train captures in several ways; writes a table for each question. The first capture is timed and reseeded."""
    unknown = set(options.of) - set(TRAINER_TABLES)
    if unknown:
        raise InputError(f"no table '{min(unknown)}'", where="--of", remedy=f"use {', '.join(TRAINER_TABLES)}")
    reporter, out = ConsoleReporter(sys.stderr), options.out
    folders = options.capture or [folder for folder in (FOX, SHOWROOM, KERMIT) if folder.is_dir()]
    captures = [read_capture(folder, max_size=options.max_size, reporter=reporter) for folder in folders]
    comparisons.warm_up()
    texts = []
    if "time" in options.of:
        found = comparisons.compare_time_to_quality(
            captures[0], options.prototype, options.rounds, options.threads, reporter
        )
        texts.append(comparisons.write_time_to_quality(out, captures[0], found))
    if "auto" in options.of:
        steps = (options.iterations, options.iterations // 3)
        runs = [run for capture in captures for run in comparisons.automatic_runs(capture, steps, reporter)]
        texts.append(comparisons.write_automatic_runs(out, runs))
    if "strategies" in options.of:
        steps = options.strategy_iterations
        runs = [run for capture in captures for run in comparisons.compare_strategies(capture, steps, reporter)]
        texts.append(comparisons.write_strategies(out, runs))
    if "seeds" in options.of:
        seeds = comparisons.compare_seeds(captures[0], options.strategy_iterations, options.seeds, reporter)
        texts.append(comparisons.write_seeds(out, seeds))
    return "\n".join(texts)


def _add_batch(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--run", type=Path, default=Path("out/demo"), help="a finished run (out/demo)")
    parser.add_argument("--frames", type=int, default=16, metavar="N", help="of a turn, in chunks of four (16)")
    parser.add_argument("--rounds", type=int, default=3, help="repetitions; the medians count (3)")
    parser.set_defaults(measure=measure_batch)


def measure_batch(options: argparse.Namespace) -> str:
    """Render turntables of a run in several ways; writes batch.csv and batch.md."""
    with tempfile.TemporaryDirectory(prefix="cvdgs-batch-") as folder:
        benchmark = BatchBenchmark(options.run, Path(folder), frames=options.frames, rounds=options.rounds)
        return write_batch_figures(options.out, benchmark.measure(ConsoleReporter(sys.stderr)))


def _add_display(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--run", type=Path, default=Path("out/demo"), help="a finished run (out/demo)")
    parser.add_argument("--view", default="view_016", help="its held-out view (view_016)")
    parser.set_defaults(measure=measure_display)


def measure_display(options: argparse.Namespace) -> str:
    """Render one view of a run through Cycles in both displays; writes display.md."""
    with tempfile.TemporaryDirectory() as scratch:
        found = display_fidelity(options.run, options.view, Path(scratch))
    lines = [f"Cycles against our rasteriser, {options.run.name}, {options.view}, original colours:", ""]
    lines += [f"- {display}: {value:.1f} dB" for display, value in found.items()]
    text = "\n".join(lines) + "\n"
    (options.out / "display.md").write_text(text, encoding="utf-8")
    return text


def _add_enhancer(parser: argparse.ArgumentParser) -> None:
    add, usual = parser.add_argument, EnhancerBenchmark(methods=())
    add(
        "--enhancers",
        type=_names,
        default=ALL_ENHANCERS,
        metavar="A,B",
        help="names or weight files",
    )
    add(
        "--images",
        type=_named_folder,
        action="append",
        metavar="NAME=FOLDER",
        help="photographs; may be given again (the folders of the evaluation data's photographs)",
    )
    add("--cvd", type=_names, dest="types", metavar="A,B", help=f"types ({','.join(usual.types)})")
    add("--severity", type=_numbers, dest="severities", metavar="A,B", help="severities (0.4,0.7,1)")
    add("--size", type=int, metavar="PIXELS", help=f"longer side of the images ({usual.size})")
    add("--plates", type=int, metavar="N", help=f"for each type ({usual.plates})")
    add("--textiles", type=int, metavar="N", help=f"in all ({usual.textiles})")
    add("--processes", type=int, default=1, metavar="N", help="that share the work (1)")
    add("--quick", action="store_true", help="fewer and smaller images, protan and deutan 1.0, Machado alone")
    parser.set_defaults(measure=measure_enhancers)


def measure_enhancers(options: argparse.Namespace) -> str:
    """Compare enhancers; writes enhancer.csv, enhancer.md, the trade-off and contact sheets."""
    folders = options.images if options.images is not None else _photo_folders()
    asked = {name: getattr(options, name) for name in ("types", "severities", "size", "plates", "textiles")}
    asked = {name: value for name, value in asked.items() if value is not None}
    usual = QUICK if options.quick else {}
    benchmark = EnhancerBenchmark(options.enhancers, dict(folders), processes=options.processes, **{**usual, **asked})
    return benchmark.run(options.out, ConsoleReporter(sys.stderr))


def _add_drift(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("--capture", type=Path, action="append", help="beside the demo; may be given again (the evaluation data's fox)")
    add("--enhancers", type=_names, default=("none", "lut"), metavar="A,B", help="names or weight files (none,lut)")
    add("--cvd", type=_names, default=("deutan",), metavar="A,B", help="types (deutan)")
    add("--severity", type=float, default=1.0, metavar="0..1")
    add("--max-size", type=int, default=480, metavar="PIXELS", help="longer side of the views (480)")
    add("--steps", type=int, default=RECONSTRUCTION_STEPS, help=f"of the reconstruction ({RECONSTRUCTION_STEPS})")
    parser.set_defaults(measure=measure_drifts)


def measure_drifts(options: argparse.Namespace) -> str:
    """Measure drift on the demo and other captures; writes drift.csv and drift.md, keeps correspondences as .npz."""
    reporter = ConsoleReporter(sys.stderr)
    captures = options.capture if options.capture is not None else [FOX] if FOX.is_dir() else []
    observers = [Layer(cvd, options.severity) for cvd in options.cvd]
    rows = []
    for folder in [SHOWROOM, *captures]:
        capture = read_capture(folder, max_size=options.max_size, reporter=reporter)
        matches = cached_matches(options.out, capture, options.steps, reporter)
        rows += measure_drift(capture, matches, options.enhancers, observers, reporter)
    return write_drift(options.out, rows)


def _add_modes(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("--capture", type=Path, action="append", help="beside the demo; may be given again (the evaluation data's fox)")
    add("--enhancers", type=_names, default=(PER_VIEW, "cgan"), metavar="A,B", help=f"({PER_VIEW},cgan)")
    add("--max-size", type=int, default=320, metavar="PIXELS", help="longer side of the views (320)")
    add("--iterations", type=int, default=1000, metavar="N", help="of the geometry (1000)")
    parser.set_defaults(measure=measure_modes)


def measure_modes(options: argparse.Namespace) -> str:
    """Run every mode for a deutan on the demo and other captures; writes modes.csv and modes.md."""
    reporter = ConsoleReporter(sys.stderr)
    captures = options.capture if options.capture is not None else [FOX] if FOX.is_dir() else []
    raster.load("cpu", reporter)
    layer, rows = Layer("deutan", 1.0), []
    for folder in [SHOWROOM, *captures]:
        capture = read_capture(folder, max_size=options.max_size, reporter=reporter)
        for name in options.enhancers:
            make = PerViewLut if name == PER_VIEW else method_factory(name)
            enhancer = make(layer.cvd, layer.severity, ENHANCED_FOR)
            with tempfile.TemporaryDirectory() as scratch:
                settings = Settings(
                    str(folder), scratch, layers=(layer,), iterations=options.iterations, simulation=ENHANCED_FOR
                )
                rows += compare_modes(capture, settings, enhancer, name, Path(scratch), reporter)
    return write_modes(options.out, rows)


def _add_select(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("frames", type=Path, metavar="FOLDER", help="photographs in order, or a capture")
    add("--enhancer", default="lut", help="name or weight file (lut)")
    add("--cvd", default="deutan", metavar="TYPE", help="type (deutan)")
    add("--severity", type=float, default=1.0, metavar="0..1")
    add("--max-size", type=int, default=640, metavar="PIXELS", help="longer side of the frames (640)")
    parser.set_defaults(measure=measure_frames)


def measure_frames(options: argparse.Namespace) -> str:
    """Select among the frames of a folder; writes selection.csv and selection.md."""
    frames = read_frames(options.frames, options.max_size)
    observer = Layer(options.cvd, options.severity)
    enhancer = method_factory(options.enhancer)(observer.cvd, observer.severity, ENHANCED_FOR)
    return write_selection(
        options.out, measure_selection(frames, enhancer, observer, reporter=ConsoleReporter(sys.stderr))
    )


def _photo_folders() -> list[tuple[str, Path]]:
    """The evaluation data's sets of photographs, where the data is there."""
    folders = sorted(PHOTOS.iterdir()) if PHOTOS.is_dir() else []
    return [(folder.name, folder) for folder in folders if folder.is_dir()]


def _names(text: str) -> tuple[str, ...]:
    return tuple(name.strip() for name in text.split(",") if name.strip())


def _numbers(text: str) -> tuple[float, ...]:
    return tuple(float(number) for number in _names(text))


def _named_folder(text: str) -> tuple[str, Path]:
    name, separator, folder = text.partition("=")
    if not separator or not name or not folder:
        raise argparse.ArgumentTypeError(f"{text!r} is not NAME=FOLDER")
    return name, Path(folder)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
