"""Build the Blender extension cvdgs-<version>.zip with Blender's own tool, and check it.

    python scripts/build_extension.py --out DIR

Needs a Python with the bpy wheel, whose copy of Blender's `blender_ext.py` does the work, or --tool with the path of
another copy (in a Blender: <version>/scripts/addons_core/bl_pkg/cli/blender_ext.py). An earlier zip is replaced only by
a complete one. Exit codes: 0 done, 2 unusable arguments or manifest.
"""

from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "core"))
import bootstrap

bootstrap.load()
from cvdgs.core.errors import InputError
from cvdgs.core.files.untrusted import is_file
from cvdgs.core.runtime.cli import OneLineParser, exit_code

MANIFEST = bootstrap.ROOT / "blender_manifest.toml"
_TOOL_IN_WHEEL = "*/scripts/addons_core/bl_pkg/cli/blender_ext.py"
# What Python, editors, merges and file managers leave beside sources: .swp, .DS_Store, ._name and #name# among it.
_LEFT_OVERS = ("__pycache__", "*.py[cod]", ".*", "*~", "#*#", "*.orig", "*.rej", "*.bak", "*.tmp")


def build(out: Path, tool: Path) -> Path:
    """Validate the source, build the zip into the folder `out`, validate the zip; returns its path.

    ``validate`` passes many broken manifests that ``build`` refuses, and what counts is the zip, so all three are done.

    Raises:
        InputError: there is no such tool, it refuses, or `out` cannot be written.
    """
    if not is_file(tool):
        raise InputError("no such file", where=tool, remedy="name a Blender's blender_ext.py with --tool")
    with open(MANIFEST, "rb") as file:
        manifest = tomllib.load(file)
    name = f"{manifest['id']}-{manifest['version']}.zip"
    try:
        out.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".build-", dir=out) as temporary:
            zip_file, source = Path(temporary) / name, Path(temporary) / "source"
            _copy(manifest.get("build", {}).get("paths_exclude_pattern", []), source)
            _run(tool, "validate", str(source))
            _run(tool, "build", "--source-dir", str(source), "--output-filepath", str(zip_file))
            _run(tool, "validate", str(zip_file))
            os.replace(zip_file, out / name)
    except OSError as error:
        raise InputError(
            f"cannot be written to ({error.strerror})", where=out, remedy="choose another folder with --out"
        ) from None
    return out / name


def _copy(patterns: Sequence[str], folder: Path) -> None:
    """Copy what the manifest names (``!/NAME``) without left-overs and the folders it excludes (``/PATH/``).

    Blender's tool takes everything in a folder that is taken, whatever else the patterns leave out.
    """
    excluded = {bootstrap.ROOT / pattern.strip("/") for pattern in patterns if not pattern.startswith("!")}

    def ignored(place: str, names: list[str]) -> set[str]:
        left_out = {name for name in names if Path(place, name) in excluded}
        return left_out | shutil.ignore_patterns(*_LEFT_OVERS)(place, names)

    folder.mkdir()
    for name in (pattern.removeprefix("!/").rstrip("/") for pattern in patterns if pattern.startswith("!/")):
        source = bootstrap.ROOT / name
        if source.is_dir():
            shutil.copytree(source, folder / name, ignore=ignored)
        else:
            shutil.copy(source, folder / name)


def find_tool() -> Path:
    """Blender's extension tool inside the bpy wheel of this Python; bpy itself is not started.

    Raises:
        InputError: there is none.
    """
    spec = importlib.util.find_spec("bpy")
    for folder in (spec.submodule_search_locations or ()) if spec else ():
        for tool in sorted(Path(folder).glob(_TOOL_IN_WHEEL)):
            return tool
    raise InputError("this Python has no bpy wheel", where=sys.executable, remedy="use the project's, or give --tool")


def _run(tool: Path, *arguments: str) -> None:
    result = subprocess.run([sys.executable, str(tool), *arguments], capture_output=True, text=True)
    complaint = " ".join((result.stdout + result.stderr).split())
    if result.returncode != 0:
        raise InputError(f"refused by Blender's '{arguments[0]}': {complaint}", where=MANIFEST, remedy="correct it")


def main() -> int:
    """Parse the command line and build; returns the exit code."""
    parser = OneLineParser(
        description="Build the Blender extension.", epilog="example: python scripts/build_extension.py --out dist"
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for the zip")
    parser.add_argument("--tool", type=Path, metavar="FILE", help="blender_ext.py (default: the bpy wheel's)")

    def work() -> None:
        arguments = parser.parse_args()
        zip_file = build(arguments.out, arguments.tool or find_tool())
        print(f"{zip_file} ({zip_file.stat().st_size / 1e6:.1f} MB)")

    return exit_code("build_extension.py", work)


if __name__ == "__main__":
    sys.exit(main())
