"""Gaussians from file to file: 3DGS .ply, .spz (Niantic), .splat (web viewers), .glb (glTF), .usd, and a web page.

    python scripts/convert.py IN OUT [--drop-damaged] [--clean 0..1] [--crop "x,y,z radius"]
    python scripts/convert.py IN... OUT.glb|OUT.usd|OUT.html [--up AXIS]

For example: python scripts/convert.py out/demo/splats.ply out/demo/splats.deutan-1.0.ply showroom.glb

The endings say what is written. A .ply holds everything; a .spz is about ten times smaller and rounds; a .splat rounds
too and holds no colours that depend on the direction. A .glb or .usd holds the colours of several files of the same
Gaussians, a scene or a variant each. .usd, .usda and .usdc are written only, and need the extra 'usd'. An .html shows
the scene in a browser, from the disk, with a slider from the first file's colours to the others'; files of a finished
run bring its cameras and figures. IN stays as it is. Needs numpy.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "core"))
import bootstrap

bootstrap.load(modules=("numpy",))
from cvdgs.core.errors import InputError, one_line
from cvdgs.core.files.untrusted import is_there
from cvdgs.core.runtime.cli import OneLineParser, exit_code
from cvdgs.core.splats.io.files import (
    WITH_A_WORLD,
    most_important,
    read_sound_layers,
    require_known_suffix,
    without_floaters,
    write_layers,
)
from cvdgs.core.splats.io.layers import TO_Y_UP, world_of_run
from cvdgs.core.splats.subject import Subject
from cvdgs.core.splats.web.finished_run import is_finished_run, surroundings_of
from cvdgs.core.splats.web.page import SUFFIX as WEB_PAGE_SUFFIX
from cvdgs.core.splats.web.page import write_web_page

_MANY_FOR_A_PAGE = 500_000  # Gaussians; some 20 MB


def main(arguments: list[str]) -> int:
    """Convert; returns the exit code."""

    def work() -> None:
        options = build_parser().parse_args(arguments)
        print(convert(options))

    return exit_code("convert.py", work)


def build_parser() -> argparse.ArgumentParser:
    """Paths and options."""
    parser = OneLineParser(
        prog="convert.py", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False
    )
    parser.add_argument("sources", type=Path, nargs="+", metavar="IN", help=".ply, .spz, .splat or .glb")
    parser.add_argument("target", type=Path, metavar="OUT", help="likewise, .usd or .html; replaced if it is there")
    parser.add_argument("--drop-damaged", action="store_true", help="drop Gaussians with values that are not finite")
    parser.add_argument("--layer", default="", metavar="NAME", help="write this layer of IN alone")
    parser.add_argument(
        "--up",
        default="",
        choices=tuple(TO_Y_UP),
        help="axis of the scene that points up in a .glb, .usd or .html; else what report.json beside IN says",
    )
    parser.add_argument(
        "--gaussians",
        type=int,
        metavar="N",
        help="write the N Gaussians that contribute most to pictures",
    )
    parser.add_argument(
        "--clean",
        type=float,
        default=0.0,
        metavar="0..1",
        help="leave out Gaussians that look like floaters: 0 none, 0.5 the clear cases, 1 every suspicion",
    )
    parser.add_argument(
        "--crop",
        default="",
        metavar="SPHERE",
        help='keep what is inside "x,y,z radius" alone; a run\'s report.json proposes one around what was photographed',
    )
    return parser


def convert(options: argparse.Namespace) -> str:
    """Read the sources, write the target, and say in a line what was done."""
    target: Path = options.target
    require_known_suffix(target)  # before anything long
    if options.gaussians is not None and options.gaussians < 1:
        raise InputError("that leaves nothing to write", where="--gaussians", remedy="give a number from 1 on")
    if not 0.0 <= options.clean <= 1.0:  # also refuses NaN
        raise InputError(f"{options.clean:g} is out of range", where="--clean", remedy="give a number from 0 to 1")
    subject = Subject.parse(options.crop) if options.crop else None
    for source in options.sources:
        if is_there(target) and is_there(source) and target.samefile(source):
            raise InputError("is also the input", where=target, remedy="name another file to write")
    layers, sound = read_sound_layers(options.sources, drop_damaged=options.drop_damaged)
    if options.layer:
        if options.layer not in layers:
            raise InputError(
                f"there is no layer '{options.layer}'", where=options.sources[0], remedy=f"name {' or '.join(layers)}"
            )
        layers = {options.layer: layers[options.layer]}
    before = len(next(iter(layers.values())))
    if options.clean:
        layers = without_floaters(layers, options.sources, options.clean, sound)
    cleaned = before - len(next(iter(layers.values())))
    if subject is not None:
        layers = {name: layer.take(subject.holds(layer)) for name, layer in layers.items()}
        if not all(map(len, layers.values())):
            raise InputError("nothing lies inside", where="--crop", remedy="give another centre or a larger radius")
    if options.gaussians:
        layers = most_important(layers, options.gaussians)
    folders = {source.resolve().parent for source in options.sources}
    if target.suffix.lower() == WEB_PAGE_SUFFIX and len(folders) == 1 and is_finished_run(*folders):
        write_web_page(target, layers, options.up, surroundings_of(*folders))
    else:
        up, metres = world_of_run(options.sources[0]) if target.suffix.lower() in WITH_A_WORLD else ("", 1.0)
        write_layers(target, layers, up=options.up or up, metres=metres)
    first = next(iter(layers.values()))
    said = f"wrote {target}: {len(first):,} Gaussians, {target.stat().st_size / 1e6:.1f} MB"
    if options.clean:
        said += f"; {cleaned:,} floaters ({cleaned / before:.2%}) left out"
    if len(layers) > 1:
        said += f"; layers {one_line(', '.join(layers))}"  # a .glb can call them anything
    if target.suffix.lower() == WEB_PAGE_SUFFIX and len(first) > _MANY_FOR_A_PAGE:
        said += f"; heavy for a phone, --gaussians {_MANY_FOR_A_PAGE} makes it lighter"
    if target.suffix.lower() == ".splat" and first.sh_degree:
        said += f"; .splat holds no view-dependent colours (degree {first.sh_degree} before)"
    return said


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
