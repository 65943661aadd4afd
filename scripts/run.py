"""The main job: from photographs with known cameras to a CVD-friendly Gaussian scene in Blender.

    python scripts/run.py CAPTURE --out DIR [options]
    blender -b -P scripts/run.py -- CAPTURE --out DIR [options]
    python scripts/run.py --doctor                              what is here, what is missing, how to get it

Needs the standard library only: the work is done by worker processes with their own interpreters (see core/job.py).
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "core"))
import bootstrap

bootstrap.load(oldest=(3, 10))
from cvdgs.core.doctor.console import DOCTOR, diagnose_in_console  # noqa: E402

# It is for machines where little is right yet: it comes before the imports that need a newer Python, and before the
# parser, which wants a capture and --out.
if __name__ == "__main__" and DOCTOR in sys.argv:
    sys.exit(diagnose_in_console(as_json="--json" in sys.argv))

bootstrap.require_python()
from cvdgs.core.arguments import OneLineParser, script_arguments  # noqa: E402
from cvdgs.core.errors import InputError  # noqa: E402
from cvdgs.core.front import run_in_console  # noqa: E402
from cvdgs.core.settings import CVD_TYPES, DEVICES, ENGINES, ENHANCERS, MODES, SIMULATIONS, Layer, Settings  # noqa: E402


def number_or_auto(text: str) -> int | None:
    """None for ``auto``, else the number; argparse names this function when the text is neither."""
    return None if text == "auto" else int(text)


def build_parser() -> argparse.ArgumentParser:
    """The options of design.md; their ranges are checked by `Settings`."""
    parser = OneLineParser(prog="run.py", description=__doc__.splitlines()[0], allow_abbrev=False)
    add = parser.add_argument
    add("capture", metavar="CAPTURE", help="folder of photographs with cameras: COLMAP model or transforms.json")
    add("--out", required=True, metavar="DIR", help="folder for the results; replaced only when the run succeeds")
    add("--cvd", action="append", metavar="TYPE", help=f"{'|'.join(CVD_TYPES)}; repeat for several layers (deutan)")
    add("--severity", action="append", type=float, metavar="0..1", help="one for all layers, or one per --cvd (1)")
    add("--simulation", default="machado", metavar="MODEL", help="|".join(SIMULATIONS) + " (machado)")
    add("--strength", type=float, default=1.0, metavar="0..1", help="of the enhancement (1)")
    add("--enhancer", default="lut", metavar="NAME", help="|".join(ENHANCERS) + "|FILE.safetensors (lut)")
    add("--mode", default="layers", metavar="MODE", help="|".join(MODES) + "; the README says what they are (layers)")
    add("--iterations", type=int, default=5000, metavar="N", help="of the geometry stage (5000)")
    add("--gaussians", type=number_or_auto, default=None, metavar="N", help="at most so many; auto (auto)")
    add("--sh-degree", type=number_or_auto, default=None, metavar="0..3", help="of the original colours; auto (auto)")
    add("--max-size", type=number_or_auto, default=None, metavar="PIXELS", help="longer side for training; auto (auto)")
    add("--holdout", type=int, default=8, metavar="N", help="keep every Nth view for testing; 0 = none (8)")
    add("--device", default="auto", metavar="DEVICE", help="|".join(DEVICES) + " (auto)")
    add("--seed", type=int, default=0, metavar="N", help="of everything random (0)")
    add(
        "--refine-poses",
        action=argparse.BooleanOptionalAction,
        help="correct cameras that are a little off and their lens; good ones stay as given (yes; joint: the lens)",
    )
    add(
        "--turntable",
        type=int,
        default=0,
        metavar="FRAMES",
        help="pictures of a turn around the subject, of each layer (0: none)",
    )
    add("--engine", default="cycles", metavar="ENGINE", help="of the turntable: " + "|".join(ENGINES) + " (cycles)")
    add("--no-blend", action="store_true", help="no Blender: neither scene.blend nor stills")
    add("--resume", action="store_true", help="add the layers to the finished run in DIR")
    add("--sfm", action="store_true", help="estimate the cameras of a folder that has none (pycolmap)")
    add("--json", action="store_true", help="events on stdout, one JSON object a line, instead of a progress bar")
    add(DOCTOR, action="store_true", help="instead of a run: what is here, what is missing, how to get it; also --json")
    return parser


def parse_settings(options: argparse.Namespace) -> Settings:
    """The validated settings for parsed options."""
    types = options.cvd or ["deutan"]
    severities = options.severity or [1.0]
    if len(severities) == 1:
        severities = severities * len(types)
    if len(severities) != len(types):
        raise InputError(
            f"{len(severities)} severities for {len(types)} types",
            where="--severity",
            remedy="give one, or one per --cvd",
        )
    return Settings(
        capture=options.capture,
        out=options.out,
        layers=tuple(Layer(cvd, severity) for cvd, severity in zip(types, severities, strict=True)),
        simulation=options.simulation,
        strength=options.strength,
        enhancer=options.enhancer,
        mode=options.mode,
        iterations=options.iterations,
        gaussians=options.gaussians,
        sh_degree=options.sh_degree,
        max_size=options.max_size,
        holdout=options.holdout,
        device=options.device,
        seed=options.seed,
        refine_poses=options.refine_poses,
        turntable=options.turntable,
        engine=options.engine,
        blend=not options.no_blend,
        resume=options.resume,
        sfm=options.sfm,
    )


def main(arguments: list[str]) -> int:
    """Parse, run, and return the exit code of the contract."""
    try:
        options = build_parser().parse_args(arguments)
        settings = parse_settings(options)
    except InputError as error:
        print(f"run.py: {error}", file=sys.stderr)
        return 2
    return run_in_console(settings, json_events=options.json)


if __name__ == "__main__":
    code = main(script_arguments())
    sys.stdout.flush()
    sys.exit(code)
