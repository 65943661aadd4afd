"""The wheel: the package, its data, and nothing else of the tree."""

from __future__ import annotations

import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from cvdgs.core.bootstrap import ROOT

pytestmark = pytest.mark.slow  # building takes a quarter of a minute

PARTS = {"core", "cvdgs_addon", "operators", "scripts", "ui"}
FILES = {"__init__.py", "blender_manifest.toml", "py.typed"}
NEEDED = {
    *("core/__main__.py", "core/demo/showroom/transforms.json", "core/splats/raster/blend_cpu.h"),
    *("core/batch/page.html", "core/files/templates/base.html", "core/photographs/sheet.html", "core/runs/report.html"),
    *("core/splats/web/viewer.html", "core/splats/web/renderer.js", "core/splats/web/viewer.css"),
    *("core/batch/page_style.css", "core/enhance/gan/weights/enhancer.safetensors"),
    *("core/enhance/gan/weights/enhancer.safetensors.sha256", "requirements.txt", "requirements-torch.txt"),
}
DATA = {".py", ".h", ".js", ".css", ".html", ".json", ".png", ".jpg", ".ply", ".md", ".safetensors", ".sha256"}


@pytest.fixture(scope="module")
def names(tmp_path_factory) -> list[str]:
    """The wheel's files; built from a copy of what git tracks, because building leaves its own files in the tree."""
    tree, out = tmp_path_factory.mktemp("tree"), tmp_path_factory.mktemp("wheel")
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True)
    if listed.returncode != 0:
        pytest.skip("this is no checkout")
    for name in filter(None, listed.stdout.split("\0")):
        if (ROOT / name).is_file():
            (tree / name).parent.mkdir(parents=True, exist_ok=True)
            (tree / name).write_bytes((ROOT / name).read_bytes())
    command = [sys.executable, "-m", "pip", "wheel", "--no-deps", "--no-build-isolation", "--wheel-dir", out, tree]
    result = subprocess.run(command, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    (wheel,) = out.glob("cvdgs-*.whl")
    return zipfile.ZipFile(wheel).namelist()


def test_it_holds_the_package_and_its_data(names):
    assert {f"cvdgs/{name}" for name in NEEDED | FILES} <= set(names)
    modules = {path.relative_to(ROOT).as_posix() for part in PARTS for path in (ROOT / part).rglob("*.py")}
    assert {f"cvdgs/{module}" for module in modules} <= set(names)


def test_it_holds_nothing_else(names):
    inside = [Path(name).relative_to("cvdgs") for name in names if name.startswith("cvdgs/")]
    outside = {name.split("/")[0] for name in names if not name.startswith("cvdgs/")}
    assert all(name.endswith(".dist-info") for name in outside)
    assert {path.parts[0] for path in inside if len(path.parts) > 1} == PARTS
    lists = {path.name for path in ROOT.glob("requirements*.txt")}
    assert {path.name for path in inside if len(path.parts) == 1} == FILES | lists
    assert {path.suffix for path in inside if len(path.parts) > 1} <= DATA
    assert not [path for path in inside if "__pycache__" in path.parts or "tests" in path.parts]
