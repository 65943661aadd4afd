"""Measures the product's own code and writes tables: python scripts/benchmark.py PART --out DIR [options].

Parts: step (a whole training step against the prototype's loop, in one run); display (Cycles against our rasteriser on
a finished run, encoded and linear blending).
"""

from __future__ import annotations

import argparse
import contextlib
import csv
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "core"))
import bootstrap

bootstrap.load()
from cvdgs.core.capture import Capture, read_capture  # noqa: E402
from cvdgs.core.demo import SHOWROOM  # noqa: E402
from cvdgs.core.errors import InputError  # noqa: E402
from cvdgs.core.evaluate.display import display_fidelity  # noqa: E402
from cvdgs.core.evaluate.prototype_loop import PrototypeLoop  # noqa: E402
from cvdgs.core.evaluate.step_benchmark import (  # noqa: E402
    StepTimes,
    benchmark_camera,
    benchmark_step,
    random_gaussians,
)
from cvdgs.core.evaluate.training_step import training_step_milliseconds  # noqa: E402

SHARED = bootstrap.ROOT.parent / "shared"
STEPS = 300
SIZE = 480  # pixels of the longer side: fox at 270x480, as in the notes


def main(arguments: list[str]) -> int:
    """Run one part; returns the exit code."""
    parser = argparse.ArgumentParser(prog="benchmark.py", description=__doc__.splitlines()[0])
    parser.add_argument("part", choices=["step", "display"])
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--capture", type=Path, default=None, help="default: the evaluation data's fox, else the demo")
    parser.add_argument("--prototype", type=Path, default=SHARED / "prototypes" / "kernels", metavar="DIR")
    parser.add_argument("--rounds", type=int, default=5, help="interleaved repetitions; the medians count (5)")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--run", type=Path, default=Path("out/demo"), help="finished run for 'display' (out/demo)")
    parser.add_argument("--view", default="view_016", help="its held-out view (view_016)")
    options = parser.parse_args(arguments)
    try:
        measure_step(options) if options.part == "step" else measure_display(options)
    except InputError as error:
        print(f"benchmark.py: {error}", file=sys.stderr)
        return 2
    return 0


def measure_display(options: argparse.Namespace) -> None:
    """Render one view of a run through Cycles in both displays and write display.md."""
    with tempfile.TemporaryDirectory() as scratch:
        found = display_fidelity(options.run, options.view, Path(scratch))
    lines = [f"Cycles against our rasteriser, {options.run.name}, {options.view}, original colours:", ""]
    lines += [f"- {display}: {value:.1f} dB" for display, value in found.items()]
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "display.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    print("\n".join(lines))


def measure_step(options: argparse.Namespace) -> None:
    """Time our step and the prototype's by turns, write step.csv and step.md, and print the ratio."""
    capture = read_capture(options.capture or _default_capture(), max_size=SIZE)
    with tempfile.TemporaryDirectory() as scratch:
        prototype = None
        if PrototypeLoop.is_there(options.prototype):
            prototype = PrototypeLoop(options.prototype, capture, Path(scratch))
            prototype.step_milliseconds(120, options.threads)  # its first call compiles
        else:
            print(f"no prototype at {options.prototype}: ours alone", file=sys.stderr)
        ours: list[float] = []
        theirs: list[float] = []
        for round_ in range(options.rounds):
            ours.append(training_step_milliseconds(capture, STEPS, options.threads))
            if prototype:
                theirs.append(prototype.step_milliseconds(STEPS, options.threads))
            print(
                f"round {round_ + 1}: ours {ours[-1]:.2f} ms" + (f", prototype {theirs[-1]:.2f} ms" if theirs else "")
            )
    with _busy_neighbour():
        disturbed = training_step_milliseconds(capture, STEPS, options.threads)
    camera = capture.views[0].camera
    scene = random_gaussians(10_000, camera.width, camera.height)
    stages = benchmark_step(
        scene, benchmark_camera(camera.width, camera.height), capture.views[0].image, threads=options.threads
    )
    _write_step(options.out, capture, ours, theirs, disturbed, stages)


@contextlib.contextmanager
def _busy_neighbour() -> Iterator[None]:
    """Another process that keeps one processor busy."""
    process = subprocess.Popen([sys.executable, "-c", "while True: pass"])
    try:
        yield
    finally:
        process.kill()
        process.wait()


def _default_capture() -> Path:
    fox = SHARED / "data" / "fox"
    return fox if fox.is_dir() else SHOWROOM


def _write_step(
    out: Path, capture: Capture, ours: list[float], theirs: list[float], disturbed: float, stages: StepTimes
) -> None:
    out.mkdir(parents=True, exist_ok=True)
    with open(out / "step.csv", "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["round", "ours_ms", "prototype_ms"])
        for round_, mine in enumerate(ours):
            writer.writerow([round_ + 1, f"{mine:.3f}", f"{theirs[round_]:.3f}" if theirs else ""])
    camera, count = capture.views[0].camera, len(capture.points)
    lines = [
        f"Whole training step, {capture.source.name} at {camera.width}x{camera.height}, {count} Gaussians; "
        f"medians of {len(ours)} runs of {STEPS} steps:",
        "",
        f"- ours {statistics.median(ours):.1f} ms",
    ]
    if theirs:
        ratio = statistics.median(mine / other for mine, other in zip(ours, theirs, strict=True))
        lines += [f"- prototype {statistics.median(theirs):.1f} ms", f"- ratio {ratio:.2f}"]
    lines += [
        f"- ours beside one busy process {disturbed:.1f} ms",
        "",
        f"Stages, {stages.gaussians} random Gaussians, medians in ms: "
        + ", ".join(f"{name} {times.wall:.1f}" for name, times in stages.stages.items()),
    ]
    (out / "step.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    print("\n".join(lines))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
