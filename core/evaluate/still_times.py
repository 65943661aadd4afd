"""How long Blender takes for a still of a run, with discs as instances and as one mesh (see ``disc_nodes``)."""

from __future__ import annotations

import statistics
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..events import Reporter
from ..job import PICTURE_WORKER, Event, Workers, blender_command
from ..job_console import finish
from .tables import markdown_table


@dataclass(frozen=True)
class StillTimes:
    """What to time: a view of a finished run.

    Attributes:
        run: output folder of the run.
        view: key of the view.
        gaussians: how many of the most important are drawn.
        width, height: of the still in pixels.
        rounds: that all ways are timed in turns; the medians count.
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
        """Markdown: a table of seconds, and for either axes the mesh's share of the instances' processor time.

        Raises:
            InputError: the run cannot be used, or there is no Blender.
        """
        arguments = {name: value for name, value in vars(self).items() if name != "run"}

        def listen(event: Event) -> None:
            if event["event"] == "progress":
                reporter.progress(event["stage"], event["fraction"], event["message"])

        request = {"job": "time-stills", "out": str(self.run.resolve()), "arguments": arguments}
        job = Workers().start_command(blender_command([], PICTURE_WORKER), request)
        return self._text(finish(job, listen)["stills"])

    @property
    def _engine_name(self) -> str:
        return "EEVEE" if self.engine == "eevee" else "Cycles"

    def _text(self, stills: list[dict[str, Any]]) -> str:
        what = f"A still of {self.gaussians:,} Gaussians, {self.width}x{self.height}, {self._engine_name}"
        title = f"{what}, {self.run.name}, {self.view}; medians of {self.rounds}:"
        rows, processor = [], {}
        for still in stills:
            way = (still["axes"], still["hull"])
            processor[way] = statistics.median(still["processor_seconds"])
            rows.append((*way, f"{statistics.median(still['seconds']):.1f}", f"{processor[way]:.1f}"))
        table = markdown_table(("axes", "discs as", "seconds", "processor seconds"), rows)
        ratios = [
            f"- {axes} axes: the mesh takes {processor[axes, 'mesh'] / processor[axes, 'instances']:.2f} of the "
            "instances' processor time"
            for axes in dict.fromkeys(axes for axes, _ in processor)
        ]
        return "\n".join([title, "", *table, "", *ratios]) + "\n"
