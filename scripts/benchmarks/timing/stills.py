"""Stills of a run in Blender: how close they are to our rasteriser, and how long they take.

Discs are timed as instances and as one mesh (see ``drawing_nodes``). Command: ``benchmark.py display``.
"""

from __future__ import annotations

import argparse
import shutil
import statistics
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from ....core.color.metrics import psnr
from ....core.color.spaces import image_to_tensor
from ....core.errors import InputError
from ....core.files.images import read_png
from ....core.runs.layout import ORIGINAL, RENDERS_FOLDER, layer_still_file
from ....core.runtime.cli import ConsoleReporter
from ....core.runtime.process import Event, Workers, blender_command
from ....core.runtime.protocol import Reporter
from ....core.runtime.supervisor import finish
from ....core.settings import ENGINES
from ..options import Part, positive
from ..tables import Column, markdown_table, write_text
from .blender_worker import PATH as BLENDER_TIMER

DISPLAYS = ("photo", "scene-linear")
_ENGINE_NAMES = {"cycles": "Cycles", "eevee": "EEVEE"}
_COLUMNS: tuple[Column, ...] = (
    ("axes", "axes", ""),
    ("hull", "discs as", ""),
    ("seconds", "seconds", ".1f"),
    ("processor_seconds", "processor seconds", ".1f"),
)


@dataclass(frozen=True)
class StillTimes:
    """Times a view of a finished run.

    Attributes:
        run: output folder of the run.
        view: key of the view.
        gaussians: number of the most important ones to draw.
        width, height: of the still in pixels.
        rounds: in which all variants are timed in turns; medians are reported.
        engine: "cycles", which renders on the processor, or "eevee".
    """

    run: Path
    view: str
    gaussians: int = 20_000
    width: int = 400
    height: int = 300
    rounds: int = 3
    engine: str = "cycles"

    def measure(self, reporter: Reporter) -> str:
        """Markdown: a table of seconds, and the mesh's share of the instances' processor time for each kind of axes.

        Raises:
            InputError: the run cannot be used, or there is no Blender.
        """
        arguments = {name: value for name, value in vars(self).items() if name != "run"}

        def listen(event: Event) -> None:
            if event["event"] == "progress":
                reporter.progress(event["stage"], event["fraction"], event["message"])

        request = {"job": "time-stills", "out": str(self.run.resolve()), "arguments": arguments}
        job = Workers().start_command(blender_command([], BLENDER_TIMER), request)
        return self._text(finish(job, listen)["stills"])

    def _text(self, stills: list[dict[str, Any]]) -> str:
        what = f"A still of {self.gaussians:,} Gaussians, {self.width}x{self.height}, {_ENGINE_NAMES[self.engine]}"
        title = f"{what}, {self.run.name}, {self.view}; medians of {self.rounds}:"
        times = pd.DataFrame(stills)
        for name in ("seconds", "processor_seconds"):
            times[name] = times[name].map(statistics.median)
        processor = times.pivot(index="axes", columns="hull", values="processor_seconds")
        ratios = [
            f"- {axes} axes: the mesh takes {ratio:.2f} of the instances' processor time"
            for axes, ratio in (processor.mesh / processor.instances)[times["axes"].unique()].items()
        ]
        return "\n".join([title, "", *markdown_table(times, _COLUMNS), "", *ratios]) + "\n"


def display_fidelity(run: Path, view: str, scratch: Path) -> dict[str, float]:
    """PSNR in dB of Cycles stills to ``renders/original/<view>.png``, by display.

    Args:
        run: output folder of a finished run; not changed.
        view: key of a held-out view.
        scratch: an empty folder for copies of the run.

    Raises:
        InputError: the run has no render of that view, or Blender could not show it.
    """
    reference = run / RENDERS_FOLDER / ORIGINAL / f"{view}.png"
    if not reference.is_file():
        raise InputError("there is no such rendering", where=reference, remedy="give a run and a held-out view")
    expected = image_to_tensor(read_png(reference))
    return {
        display: psnr(expected, image_to_tensor(read_png(_still(run, view, display, scratch)))) for display in DISPLAYS
    }


def _still(run: Path, view: str, display: str, scratch: Path) -> Path:
    copy = scratch / display
    shutil.copytree(run, copy)
    command = blender_command([str(copy), "--view", view, "--display", display])
    if subprocess.run(command, capture_output=True).returncode:
        raise InputError("Blender could not render it", where=run, remedy="run scripts/run.py on the capture again")
    return copy / layer_still_file(ORIGINAL)


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("--run", type=Path, default=Path("out/demo"), help="a finished run (out/demo)")
    add("--view", default="view_016", help="one of its held-out views (view_016)")
    add("--gaussians", type=positive, default=20_000, metavar="N", help="Gaussians in timed stills (20000)")
    add("--engine", choices=ENGINES, default=ENGINES[0], help=f"engine of timed stills ({ENGINES[0]})")
    add("--rounds", type=positive, default=3, metavar="N", help="rounds of timing; medians are reported (3)")


def _measure(options: argparse.Namespace) -> str:
    """Render one view of a run in Blender, compare it with our rasteriser and time it; writes display.md."""
    with tempfile.TemporaryDirectory() as scratch:
        found = display_fidelity(options.run, options.view, Path(scratch))
    lines = [f"Cycles against our rasteriser, {options.run.name}, {options.view}, original colours:", ""]
    lines += [f"- {display}: {value:.1f} dB" for display, value in found.items()]
    settings = {"gaussians": options.gaussians, "rounds": options.rounds, "engine": options.engine}
    times = StillTimes(options.run, options.view, **settings)
    return write_text(options.out / "display.md", [*lines, "", times.measure(ConsoleReporter(sys.stderr))])


PART = Part("display", "Blender on a finished run: against our rasteriser, and its time", _add_arguments, _measure)
