"""Captures of the real world beside the made-worse ones: what a run makes of each, and whether it says why."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import pandas as pd

from ....core.bootstrap import ROOT
from ....core.errors import InputError
from ....core.evaluate.advice import AdviceThresholds
from ....core.runs.report import REPORT_FILE
from ....core.runtime.protocol import Reporter
from ....core.settings import Settings
from ..options import counted, names
from ..provenance import digest_of, fingerprint, trained_product
from ..studies.captures import CaptureFolder
from ..studies.recipe import DEUTAN, NOT_MEASURED
from ..tables import Column, markdown_table, write_csv, write_text
from .failure import MOST_RWE

NAME = "stress-real"
REAL = "real"
"""What stands in place of an axis in tables of such captures."""
LEAST_PSNR = AdviceThresholds().psnr
REFUSED = "refused"
FAR = {"psnr": 10.0, "rwe": 0.2, "ccpr": 0.2}
"""Distances to the failure lines that count as far from failing: there is no untouched capture to compare with."""
_UNUSABLE = 2  # exit code
_METHOD = "layers"
_SCRIPT = ROOT / "scripts" / "run.py"
_HOLDOUT_MARK = "@"
_FIGURES = ["views", "psnr", "rwe", "ccpr", "ccpr_input", "gaussians"]
_COLUMNS: tuple[Column, ...] = (
    ("value", "capture", ""),
    ("views", "views", ".0f"),
    ("psnr", "PSNR", ".2f"),
    ("psnr_deviation", "σ of PSNR", ".2f"),
    ("rwe", "RWE", ".2f"),
    ("ccpr", "CCPR", ".3f"),
    ("ccpr_deviation", "σ of CCPR", ".3f"),
    ("ccpr_input", "CCPR of the input", ".3f"),
    ("gaussians", "Gaussians", ".0f"),
    ("failed", "failed", ""),
    ("warnings", "warnings", ""),
)


@dataclass(frozen=True)
class RealCapture:
    """A capture as a user would give it to run.py.

    Attributes:
        name: in tables and pictures.
        folder: or file.
        holdout: every so many views are held out, from the first on.
    """

    name: str
    folder: Path
    holdout: int = Settings.holdout

    def key(self, max_size: int) -> str:
        """Changes with what is given to a run, and with the longer side of the views in pixels."""
        read = CaptureFolder(self.name, self.folder, max_size).key if self.folder.is_dir() else digest_of(self.folder)
        return repr((read, max_size, self.holdout))


def real_captures(text: str) -> tuple[RealCapture, ...]:
    """The captures of a command line: comma-separated NAME=PATH or NAME@N=PATH, N for `RealCapture.holdout`.

    Raises:
        InputError: one is not there, or not written like that.
    """
    found = []
    for word in names(text):
        known, _, path = word.partition("=")
        name, _, holdout = known.partition(_HOLDOUT_MARK)
        every = holdout or str(Settings.holdout)
        if not name or not path or not every.isdigit() or not Path(path).exists():
            raise InputError(f"cannot use '{word}'", where="--real", remedy="use NAME=PATH or NAME@N=PATH")
        found.append(RealCapture(name, Path(path), int(every)))
    return tuple(found)


def run_real(
    captures: Sequence[RealCapture],
    max_size: int,
    iterations: int,
    folder: Path,
    reporter: Reporter,
    *,
    seeds: int = 1,
    again: bool = False,
) -> pd.DataFrame:
    """Runs of the product for each capture; finished ones that `folder` has from an earlier call are not repeated.

    Args:
        seeds: how many runs each capture gets; they differ in their random seeds.
        again: repeat all of them.

    Returns:
        A row for each capture: the columns of `failure.standings` that need no untouched capture, and the means of
        ``views`` and ``gaussians``; the name of the capture is in ``value``.
    """
    rows = []
    for level, capture in enumerate(captures):
        key = fingerprint(capture.key(max_size), partial(_shaping, iterations))
        reports = []
        for seed in range(seeds):
            reporter.progress(NAME, (level + seed / seeds) / len(captures), f"{capture.name}, seed {seed}")
            place = folder / REAL / f"{capture.name}-{key}-{seed}"
            if again and place.exists():
                shutil.rmtree(place)
            reports.append(_report(capture, place, max_size, iterations, seed))
        rows.append({"level": level, **_row(capture, reports)})
    reporter.progress(NAME, 1.0)
    return pd.DataFrame(rows)


def margins_of_real(items: pd.DataFrame) -> pd.Series:
    """How far from its nearest failure line each capture is, from 0 to 1 by `FAR`; NaN where there are no figures."""
    shares = pd.concat(
        [
            (items.psnr - LEAST_PSNR) / FAR["psnr"],
            (MOST_RWE - items.rwe) / FAR["rwe"],
            (items.ccpr - items.ccpr_input) / FAR["ccpr"],
        ],
        axis=1,
    )
    return shares.min(axis=1, skipna=False).clip(0.0, 1.0)


def write_real(folder: Path, items: pd.DataFrame, max_size: int, iterations: int, seeds: int = 1) -> str:
    """Write ``stress-real.csv`` and ``stress-real.md``; returns the text of the latter."""
    write_csv(folder / f"{NAME}.csv", items)
    lines = [
        "# Where it fails: captures of the real world",
        "",
        f"What `run.py` makes of captures as people take them, at {max_size} pixels with {iterations:,} steps; cameras "
        f"are estimated where there are none. Figures are {_averaged(seeds)}. "
        "A capture has failed where the held-out views have a PSNR below "
        f"{LEAST_PSNR:g} dB, from where on a run says itself that details can hardly be recognised, an RWE above "
        f"{MOST_RWE:g}, or the scene a CCPR below that of the photographs; or where it was refused, for the reason "
        "below the table: that is right where photographs do not suffice. They are in "
        "[one picture](stress.md#one-picture) with the conditions that were made worse on purpose.",
        "",
        *markdown_table(items.assign(failed=items.failed.replace("", "no")), _COLUMNS),
    ]
    refused = items[items.errors != ""]
    lines += ["", *(f"- {item.value}: {item.errors}" for item in refused.itertuples())] if len(refused) else []
    return write_text(folder / f"{NAME}.md", lines)


def _averaged(seeds: int) -> str:
    return f"means of {counted(seeds)}, σ their standard deviations" if seeds > 1 else f"of {counted(seeds)}"


def _shaping(iterations: int) -> tuple[Any, ...]:
    """What shapes a run of a capture."""
    return iterations, *trained_product()


def _report(capture: RealCapture, place: Path, max_size: int, iterations: int, seed: int) -> dict[str, Any] | str:
    """The report of a run, kept in `place`, or the line with which it was refused: that may be for a missing tool."""
    if not (place / REPORT_FILE).is_file():
        place.parent.mkdir(parents=True, exist_ok=True)
        words = [sys.executable, str(_SCRIPT), str(capture.folder), "--out", str(place), "--no-blend"]
        words += ["--max-size", str(max_size), "--iterations", str(iterations), "--holdout", str(capture.holdout)]
        words += ["--seed", str(seed)]
        ended = subprocess.run(words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, check=False)
        last = next((line for line in reversed(ended.stderr.splitlines()) if line.strip()), "")
        if ended.returncode == _UNUSABLE:
            return last.removeprefix("run.py: ").strip().replace(str(capture.folder), capture.name)
        if ended.returncode:
            raise InputError(f"the run broke ({last})", where=capture.folder, remedy=f"try it alone: {' '.join(words)}")
    report: dict[str, Any] = json.loads((place / REPORT_FILE).read_text(encoding="utf-8"))
    return report


def _row(capture: RealCapture, reports: Sequence[dict[str, Any] | str]) -> dict[str, Any]:
    """The row of a capture of which a run of each seed has a report, or the line with which it was refused."""
    refusals = [report for report in reports if isinstance(report, str)]
    finished = [report for report in reports if not isinstance(report, str)]
    runs = pd.DataFrame([_figures(report) for report in finished], columns=_FIGURES, dtype=float)
    means, deviations = runs.mean(skipna=False), runs.std(skipna=False)  # no mean of what a seed lacks
    failed = _exceeded(means) if finished else []
    if refusals:
        some = f"{REFUSED} with {len(refusals)} of {len(reports)} seeds"
        failed = [some, *failed] if finished else [REFUSED]
    return {
        "method": _METHOD,
        "axis": REAL,
        "value": capture.name,
        "seeds": len(finished),
        "errors": "; ".join(sorted(set(refusals))),
        "failed": "; ".join(failed),
        "warnings": " ".join(sorted({warning["name"] for report in finished for warning in report["warnings"]})),
        **means,
        **{f"{name}_deviation": deviations[name] for name in ("psnr", "rwe", "ccpr")},
    }


def _figures(report: dict[str, Any]) -> dict[str, float]:
    """What a run measured; NaN where it could not."""
    layer = report["layers"][DEUTAN.name]
    found = {
        "views": report["capture"]["views"],
        "psnr": report["reconstruction"]["psnr"],
        "rwe": layer["rwe"]["ratio"],
        "ccpr": layer["ccpr"]["rendered"],
        "ccpr_input": layer["ccpr"]["input"],
        "gaussians": report["gaussians"],
    }
    return {name: NOT_MEASURED if value is None else value for name, value in found.items()}


def _exceeded(figures: pd.Series) -> list[str]:
    """The criteria that the means fail."""
    found = []
    if not figures["psnr"] >= LEAST_PSNR:
        found.append(f"PSNR {figures['psnr']:.1f} dB")
    if figures["rwe"] > MOST_RWE:
        found.append(f"RWE {figures['rwe']:.2f}")
    if figures["ccpr"] < figures["ccpr_input"]:
        found.append(f"CCPR {figures['ccpr']:.3f}, the input's is {figures['ccpr_input']:.3f}")
    return found
