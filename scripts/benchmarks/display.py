"""`benchmark.py display`: Blender's picture of a run beside ours."""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

from ...core.evaluate.display import display_fidelity
from .part import Part


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--run", type=Path, default=Path("out/demo"), help="a finished run (out/demo)")
    parser.add_argument("--view", default="view_016", help="its held-out view (view_016)")


def _measure(options: argparse.Namespace) -> str:
    """Render one view of a run through Cycles in both displays; writes display.md."""
    with tempfile.TemporaryDirectory() as scratch:
        found = display_fidelity(options.run, options.view, Path(scratch))
    lines = [f"Cycles against our rasteriser, {options.run.name}, {options.view}, original colours:", ""]
    lines += [f"- {display}: {value:.1f} dB" for display, value in found.items()]
    text = "\n".join(lines) + "\n"
    (options.out / "display.md").write_text(text, encoding="utf-8")
    return text


PART = Part("display", "Cycles against our rasteriser on a finished run", _add_arguments, _measure)
