"""The job "enhance" on the console: photographs recoloured into a folder. Standard library only."""

from __future__ import annotations

import sys
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from ..errors import InputError
from ..files.untrusted import explained
from ..runs.enhanced import METRICS_NAME, SHEET_NAME, enhanced_files
from ..runs.folder import RunFolder
from ..runtime.process import WORKER, Event, Job, find_python
from ..runtime.progress import Clock, RunProgress, format_seconds
from ..runtime.supervisor import BarDisplay, JsonDisplay, Listener, Log, all_or_nothing, finish, in_console
from ..settings import OPTIONS, Layer, Settings, check_layer, check_option, typed_value

LOG_NAME = "enhance.log"

_NAME_PHOTOGRAPHS = "name photographs or a folder of them"
_UPDATE = "update the program that sends it"

# Share of the time by stage, measured on two cores with twelve photographs of 0.4 megapixels and the LUT.
_STAGE_SHARES = {"start": 0.14, "read": 0.02, "enhance": 0.84}


@dataclass(frozen=True)
class EnhanceRequest:
    """The options of ``scripts/enhance.py``; the worker checks whether they go together.

    Attributes:
        inputs: photographs, and folders that are searched with their subfolders.
        out: the output folder.
        cvd, severity, simulation, strength, enhancer, seed, device: as in `Settings`.
        change_budget, fit: as in `Settings`.
        separately: fit the enhancer to each photograph alone.
        together: fit it to all photographs as one scene, whatever their colours; with neither, those whose palettes are
            alike are one scene.
        skip_unreadable: leave out photographs that cannot be read instead of refusing all.

    Raises (on construction):
        InputError: there are no inputs, a name is empty, or a value is out of range.
    """

    inputs: tuple[str, ...]
    out: str
    cvd: str = "deutan"
    severity: float = 1.0
    simulation: str = Settings.simulation
    strength: float = Settings.strength
    enhancer: str = Settings.enhancer
    seed: int = Settings.seed
    device: str = Settings.device
    change_budget: float | None = Settings.change_budget
    fit: int = Settings.fit
    separately: bool = False
    together: bool = False
    skip_unreadable: bool = False

    def __post_init__(self) -> None:
        if not self.inputs:
            raise InputError("no photographs are given", where="inputs", remedy=_NAME_PHOTOGRAPHS)
        # A path of nothing would be the current folder.
        if not all(self.inputs):
            raise InputError("a name is empty", where="inputs", remedy=_NAME_PHOTOGRAPHS)
        if not self.out:
            raise InputError("no output folder is given", where="--out", remedy="name a folder to write to")
        check_layer(Layer(self.cvd, self.severity))
        for entry in fields(self):
            if entry.name in OPTIONS:
                check_option(entry.name, getattr(self, entry.name))

    def to_dict(self) -> dict[str, Any]:
        """A JSON-ready dictionary; `from_dict` reads it back."""
        return asdict(self)

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> EnhanceRequest:
        """The request of `to_dict`.

        Raises:
            InputError: unknown or missing entries, or unusable values.
        """
        unknown = sorted(set(values) - {entry.name for entry in fields(cls)})
        if unknown:
            raise InputError(f"the request has unknown entries: {', '.join(unknown)}", where="stdin", remedy=_UPDATE)
        if not isinstance(values.get("inputs", ()), list | tuple):
            raise InputError("they are no list", where="inputs", remedy="give a list of names")
        try:
            others = {name: typed_value(cls, name, value) for name, value in values.items() if name != "inputs"}
            return cls(inputs=tuple(map(str, values["inputs"])), **others)
        except (TypeError, KeyError) as error:
            raise InputError(f"unusable request{explained(error)}", remedy=_UPDATE) from None


def enhance_in_console(request: EnhanceRequest, *, json_events: bool) -> int:
    """Do `request` with progress on the console; returns the exit code of the contract.

    Args:
        json_events: write the events to stdout as JSON lines instead of a progress bar on stderr.
    """
    progress = RunProgress(tuple(_STAGE_SHARES), expected=_STAGE_SHARES)
    display = JsonDisplay(sys.stdout) if json_events else BarDisplay(sys.stderr, "enhance.py", progress, _summary)
    return in_console(lambda listen: enhance(request, listen), display)


def enhance(request: EnhanceRequest, listen: Listener) -> Event:
    """Enhance the photographs of `request` and put the results into its folder; returns the summary.

    Raises:
        InputError: unusable input or output; nothing was written.
        Cancelled: nothing was written.
        WorkerDefect: the worker failed; its log is kept in the output folder.
    """
    clock = Clock()
    listen({"event": "status", "stage": "start", "message": "starting"})
    python = find_python()
    folder = RunFolder(request.out, enhanced_files, METRICS_NAME)
    with all_or_nothing(folder, request.out, LOG_NAME):
        with open(folder.staging / LOG_NAME, "w", encoding="utf-8") as log_file:
            log = Log(log_file, listen)
            message = {"job": "enhance", "request": request.to_dict(), "folder": str(folder.staging)}
            summary = finish(Job([python, str(WORKER)], message, log.line), log.event)["summary"]
        (folder.staging / LOG_NAME).unlink()  # of interest only when the worker fails
    return {"out": request.out, "seconds": clock.total, "summary": summary}


def _summary(result: Event) -> str:
    summary = result["summary"]
    lines = [f"done in {format_seconds(result['seconds'])}: {summary['images']} photographs"]
    before, after = summary["ccpr"]["input"], summary["ccpr"]["enhanced"]
    if before is not None and after is not None:
        lines.append(f"  contrast preserved (CCPR): photographs {before:.3f}, enhanced {after:.3f}")
    return "\n".join([*lines, f"  open {Path(result['out']) / SHEET_NAME}"])
