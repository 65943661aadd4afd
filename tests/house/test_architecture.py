"""The walls of the house: which side may import what."""

import ast
import sys
import tomllib
from pathlib import Path

import pytest

from cvdgs.core.bootstrap import ROOT

WORKER_ONLY = {"torch", "warp", "kornia", "colour", "pycolmap", "scipy", "safetensors"}
# Started by any Python, Blender's included, before an environment is known.
STANDARD_LIBRARY_ONLY = (
    *("__main__", "bootstrap", "errors", "settings", "files/untrusted", "pipeline/launch", "photographs/front"),
    *("batch/*", "rendering/*", "runs/*", "runtime/*", "doctor/*"),
)
# Run by an interpreter that may have more; an engine that an optional package brings; zstandard and USD, if there.
EXCEPTIONS = {
    *("doctor/probe", "runtime/threads", "batch/dask", "splats/io/spz", "splats/io/usd"),
    *("batch/page_markup", "runs/report_page"),
}
NUMPY_ONLY = (
    *("files/ply", "capture/model", "capture/folder", "color/matrices", "color/machado2009", "color/srgb"),
    *("splats/gaussians", "splats/scene_frame", "splats/io/*", "splats/web/*", "splats/strategy/*"),
)
# The rooms of core/, from the ground up: none imports from one above it.
FLOORS = (
    {"bootstrap", "errors", "demo"},
    {"files", "scale_reference"},
    {"settings"},
    {"runs"},
    {"color", "runtime"},
    {"intake"},
    {"capture", "doctor", "enhance", "rendering"},
    {"consistency"},
    {"splats"},
    {"evaluate"},
    {"photographs", "pipeline"},
    {"batch"},
    {"worker", "__main__", "__init__"},
)


def imported_packages(path: Path) -> set[str]:
    """Top-level names of the absolute imports anywhere in a file."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            names.add(node.module.partition(".")[0])
    return names


def files(*folders: str) -> list[Path]:
    return [path for folder in folders for path in sorted((ROOT / folder).rglob("*.py"))]


@pytest.mark.parametrize("path", files("core"), ids=lambda p: str(p.relative_to(ROOT)))
def test_the_core_does_not_know_blender(path):
    assert not imported_packages(path) & {"bpy", "mathutils", "gpu", "bl_ext"}


@pytest.mark.parametrize("path", files("cvdgs_addon", "operators", "ui"), ids=lambda p: str(p.relative_to(ROOT)))
def test_blenders_side_does_not_need_the_workers_libraries(path):
    assert not imported_packages(path) & WORKER_ONLY


def modules(*patterns: str) -> list[Path]:
    """Those of core/ that match, without the exceptions."""
    found = [path for pattern in patterns for path in sorted((ROOT / "core").glob(f"{pattern}.py"))]
    assert len(found) >= len(patterns)
    return [path for path in found if str(path.relative_to(ROOT / "core").with_suffix("")) not in EXCEPTIONS]


@pytest.mark.parametrize("path", modules(*STANDARD_LIBRARY_ONLY), ids=lambda p: str(p.relative_to(ROOT)))
def test_what_any_python_starts_needs_the_standard_library_alone(path):
    assert imported_packages(path) <= set(sys.stdlib_module_names) | {"cvdgs", "bootstrap"}


@pytest.mark.parametrize("path", modules(*NUMPY_ONLY), ids=lambda p: str(p.relative_to(ROOT)))
def test_what_blender_shares_with_the_core_needs_numpy_alone(path):
    assert imported_packages(path) <= set(sys.stdlib_module_names) | {"numpy"}


def room_of(parts: tuple[str, ...]) -> str:
    """The room, or the loose module, of a module of core/ given by its parts below core/."""
    return parts[0] if parts else "__init__"


@pytest.mark.parametrize("path", files("core"), ids=lambda p: str(p.relative_to(ROOT)))
def test_no_import_runs_up_from_a_room_to_one_above_it(path):
    floor_of = {room: floor for floor, rooms in enumerate(FLOORS) for room in rooms}
    module = path.relative_to(ROOT / "core").with_suffix("").parts
    own = room_of(module)
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if not isinstance(node, ast.ImportFrom) or not node.level:
            continue
        start = module[: len(module) - node.level] if node.level <= len(module) else None
        if start is None:  # out of core/: the package itself, for its version
            continue
        base = (*start, *(node.module.split(".") if node.module else ()))
        for target in {room_of(base) if base else alias.name for alias in node.names}:
            assert target == own or floor_of[target] < floor_of[own], f"{own} imports {target}"


def test_hardly_anything_lies_loose_at_the_top_of_the_core():
    loose = {path.stem for path in (ROOT / "core").glob("*.py")} - {"__init__", "__main__"}
    assert len(loose) <= 5
    assert {path.name for path in (ROOT / "core").iterdir() if path.is_dir()} - {"__pycache__"} <= set().union(*FLOORS)


@pytest.mark.parametrize(
    "path", files("core", "cvdgs_addon", "operators", "ui"), ids=lambda p: str(p.relative_to(ROOT))
)
def test_the_package_imports_itself_relatively(path):
    if path.name in ("__main__.py", "worker.py"):
        pytest.skip("loads the package under its own name first")
    assert "cvdgs" not in imported_packages(path)


def test_every_package_is_installed():
    listed = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools"]["packages"]
    folders = {
        path.parent for path in files("core", "cvdgs_addon", "operators", "scripts", "ui") if path.stem == "__init__"
    }
    assert set(listed) == {"cvdgs", *(".".join(("cvdgs", *folder.relative_to(ROOT).parts)) for folder in folders)}
