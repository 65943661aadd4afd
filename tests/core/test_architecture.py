"""The walls of the house: which side may import what."""

import ast
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
WORKER_ONLY = {"torch", "warp", "kornia", "colour", "pycolmap", "scipy", "safetensors"}
# Started by any Python, Blender's included, before an environment is known.
STANDARD_LIBRARY_ONLY = [
    "__main__",
    "arguments",
    "batch/arguments",
    "batch/batch_file",
    "batch/console",
    "batch/course",
    "batch/done",
    "batch/estimates",
    "batch/example",
    "batch/finished",
    "batch/flamenco",
    "batch/inspection",
    "batch/layer",
    "batch/local_pool",
    "batch/machine",
    "batch/model",
    "batch/openjd",
    "batch/outcome",
    "batch/plan",
    "batch/progress",
    "batch/run_task",
    "batch/table_reader",
    "batch/task",
    "batch/task_job",
    "batch/task_process",
    "batch/toml_lines",
    "batch/train",
    "batch/train_options",
    "bootstrap",
    "console",
    "devices",
    # But for what is run by an interpreter that may have more, to see whether it has.
    *(f"doctor/{path.stem}" for path in sorted((ROOT / "core/doctor").glob("*.py")) if path.stem != "probe"),
    "environment",
    "errors",
    "events",
    "faults",
    "front",
    "photographs/front",
    "job",
    "job_console",
    "licences",
    "parent",
    "pinhole",
    "priority",
    "processors",
    "progress",
    "report",
    "run_files",
    "run_folder",
    "settings",
    "turntables",
    "untrusted",
    "whole_file",
]
NUMPY_ONLY = [
    "ply_table",
    "splats/gaussians",
    "splats/ply",
    "splats/files",
    "splats/quantised",
    "splats/splat_file",
    "splats/scene_frame",
    "capture/model",
    "color/matrices",
    "color/simulated_bytes",
    "color/srgb",
    *(f"splats/strategy/{path.stem}" for path in sorted((ROOT / "core/splats/strategy").glob("*.py"))),
]


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


@pytest.mark.parametrize("name", STANDARD_LIBRARY_ONLY)
def test_what_any_python_starts_needs_the_standard_library_alone(name):
    assert imported_packages(ROOT / "core" / f"{name}.py") <= set(sys.stdlib_module_names) | {"cvdgs", "bootstrap"}


@pytest.mark.parametrize("name", NUMPY_ONLY)
def test_what_blender_shares_with_the_core_needs_numpy_alone(name):
    assert imported_packages(ROOT / "core" / f"{name}.py") <= set(sys.stdlib_module_names) | {"numpy"}


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
