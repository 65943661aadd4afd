"""Build the textile showroom in Blender and photograph it: the embedded demo capture, or a room one walks around in.

    python scripts/make_showroom.py --out DIR                 with the bpy wheel
    blender -b -P scripts/make_showroom.py -- --out DIR       with Blender

The shipped capture, core/demo/showroom, is what the defaults give. Exit code 2 for unusable arguments.
"""

from __future__ import annotations

import importlib.util
import sys
from dataclasses import replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "core"))
import bootstrap

bootstrap.load()
from cvdgs.core.errors import InputError
from cvdgs.core.runtime.cli import ConsoleReporter, OneLineParser, exit_code, script_arguments
from cvdgs.scripts.showroom.settings import ROOM_CAMERAS, SCENES, VARIANTS, CaptureSettings, SceneSettings

PREVIEW_SAMPLES = 3
_MOST_THREADS = 1024  # of Blender; it makes one of a negative number


def parse(arguments: list[str]) -> tuple[Path, CaptureSettings, int]:
    """The output folder, the settings and the number of threads that the command line asks for."""
    defaults = CaptureSettings()
    parser = OneLineParser(prog="make_showroom.py", description=__doc__.splitlines()[0], allow_abbrev=False)
    add = parser.add_argument
    add("--out", type=Path, required=True, help="folder to write; an earlier showroom in it is replaced")
    add("--scene", choices=SCENES, default=defaults.scene.scene, help="a set, or a room one walks in (%(default)s)")
    usual = {name: f"({getattr(defaults.cameras, name)}; room {value:g})" for name, value in ROOM_CAMERAS.items()}
    add("--views", type=int, help=f"photographs {usual['views']}")
    add("--width", type=int, help=f"of a photograph, in pixels {usual['width']}")
    add("--height", type=int, help=f"likewise {usual['height']}")
    add("--samples", type=int, default=defaults.samples, help="Cycles samples a pixel before denoising (%(default)s)")
    add("--seed", type=int, default=defaults.seed, help="of cloth, rendering and points (%(default)s)")
    add("--points", type=int, default=defaults.points, help="sparse points (%(default)s)")
    add("--depth-views", type=int, default=defaults.depth_views, help="views with a depth map (%(default)s)")
    add("--variant", choices=VARIANTS, default=defaults.scene.variant, help="whose confused colours (%(default)s)")
    add(
        "--satin-roughness", type=float, default=defaults.scene.satin_roughness, help="0 mirror to 1 matt (%(default)s)"
    )
    add("--sheer-opacity", type=float, default=defaults.scene.sheer_opacity, help="of the organza (%(default)s)")
    add("--yarn-scale", type=float, default=defaults.scene.yarn_scale, help="multiplies the width of all yarns")
    add("--light", type=float, default=defaults.scene.light, help="multiplies all light")
    add("--cloth-detail", type=float, default=defaults.scene.cloth_detail, help="resolution of the cloth meshes")
    add("--threads", type=int, default=0, help="that render; 0 uses all cores")
    add("--preview", action="store_true", help=f"{PREVIEW_SAMPLES} samples and coarser cloth")
    given = parser.parse_args(arguments)
    scene = SceneSettings(
        scene=given.scene,
        variant=given.variant,
        satin_roughness=given.satin_roughness,
        sheer_opacity=given.sheer_opacity,
        yarn_scale=given.yarn_scale,
        light=given.light,
        cloth_detail=given.cloth_detail,
    )
    asked = {name: getattr(given, name) for name in ("views", "width", "height") if getattr(given, name) is not None}
    cameras = replace(defaults.cameras, **{**(ROOM_CAMERAS if given.scene == "room" else {}), **asked})
    settings = replace(
        defaults,
        scene=scene,
        cameras=cameras,
        samples=given.samples,
        seed=given.seed,
        points=given.points,
        depth_views=given.depth_views,
    )
    if given.preview:
        settings = replace(settings, samples=PREVIEW_SAMPLES, scene=replace(scene, cloth_detail=0.6))
    settings.check()
    if not 0 <= given.threads <= _MOST_THREADS:
        remedy = f"give 0 for all cores, or 1 to {_MOST_THREADS}"
        raise InputError(f"{given.threads} is out of range", where="--threads", remedy=remedy)
    return given.out, settings, given.threads


def main(arguments: list[str]) -> int:
    """Run the command; the exit code."""

    def work() -> None:
        out, settings, threads = parse(arguments)
        if importlib.util.find_spec("bpy") is None:
            raise InputError("this Python has no bpy", remedy="install the bpy wheel, or run the script inside Blender")
        from cvdgs.scripts.showroom.capture import make

        make(out, settings, ConsoleReporter(sys.stderr), threads)

    return exit_code("make_showroom.py", work)


if __name__ == "__main__":
    code = main(script_arguments())
    sys.stdout.flush()
    sys.exit(code)
