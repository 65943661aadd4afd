"""Gaussians from one file format to another: 3DGS .ply, .spz (Niantic) and .splat (web viewers).

    python scripts/convert.py IN OUT [--drop-damaged]

For example: python scripts/convert.py out/demo/splats.deutan-1.0.ply showroom.spz

The endings say what is written. A .ply holds everything; a .spz is about ten times smaller and rounds; a .splat rounds
too and holds no colours that depend on the direction. IN stays as it is. Needs numpy.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "core"))
import bootstrap

bootstrap.load(modules=("numpy",))
from cvdgs.core.errors import InputError
from cvdgs.core.runtime.cli import OneLineParser, exit_code
from cvdgs.core.splats.io.files import read_gaussians, require_known_suffix, write_gaussians


def main(arguments: list[str]) -> int:
    """Convert; returns the exit code."""

    def work() -> None:
        options = build_parser().parse_args(arguments)
        print(convert(options.source, options.target, drop_damaged=options.drop_damaged))

    return exit_code("convert.py", work)


def build_parser() -> argparse.ArgumentParser:
    """Two paths and an option."""
    parser = OneLineParser(
        prog="convert.py", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False
    )
    parser.add_argument("source", type=Path, metavar="IN", help=".ply, .spz or .splat")
    parser.add_argument("target", type=Path, metavar="OUT", help="likewise; replaced if it is there")
    parser.add_argument("--drop-damaged", action="store_true", help="drop Gaussians with values that are not finite")
    return parser


def convert(source: Path, target: Path, *, drop_damaged: bool) -> str:
    """Read `source`, write `target`, and say in a line what was done."""
    require_known_suffix(target)  # before anything long
    if target.exists() and source.exists() and target.samefile(source):
        raise InputError("is also the input", where=target, remedy="name another file to write")
    gaussians = read_gaussians(source, drop_damaged=drop_damaged)
    write_gaussians(target, gaussians)
    said = f"wrote {target}: {len(gaussians):,} Gaussians, {target.stat().st_size / 1e6:.1f} MB"
    if target.suffix.lower() == ".splat" and gaussians.sh_degree:
        said += f"; .splat holds no view-dependent colours (degree {gaussians.sh_degree} before)"
    return said


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
