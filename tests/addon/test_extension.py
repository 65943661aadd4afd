"""The extension's zip: built by Blender's own tool, complete, free of what is not needed, and loadable by Blender."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

import cvdgs
from cvdgs.core.runtime.process import find_python

ROOT = Path(cvdgs.__file__).parent
BUILDER = ROOT / "scripts" / "build_extension.py"

INSTALL = """
import importlib, json, os, sys
import bpy, addon_utils
name = "bl_ext.user_default.cvdgs"
operators = bpy.ops.extensions
handlers = bpy.app.handlers
def installed():
    return os.path.isdir(os.path.join(bpy.utils.user_resource("EXTENSIONS"), "user_default", "cvdgs"))
def classes():
    return sorted(known for known in dir(bpy.types) if known.startswith(("CVDGS_", "cvdgs")))
def install():
    operators.package_install_files(filepath=sys.argv[1], repo="user_default", enable_on_install=False)
found = {}
before = len(handlers.load_post)
for attempt in range(2):
    install()
    found["installed"] = installed()
    found["enabled"] = addon_utils.enable(name, default_set=True) is not None
    found["usable"] = bool(classes()) and bpy.ops.cvdgs.use_demo() == {"FINISHED"}
    found["package"] = importlib.import_module(name + ".cvdgs_addon.scene.convert").convert.__module__
    own = bpy.utils.extension_path_user(name, create=True)
    open(os.path.join(own, "environment"), "w").close()
    install()  # an upgrade, with the add-on enabled
    found["usable after an upgrade"] = bpy.ops.cvdgs.use_demo() == {"FINISHED"}
    found["own files after an upgrade"] = os.listdir(own)
    addon_utils.disable(name, default_set=True)
    found["left when disabled"] = [
        *classes(), *(["property"] if hasattr(bpy.types.Scene, "cvdgs") else []), *handlers.load_post[before:]
    ]
    repository = [entry.module for entry in bpy.context.preferences.extensions.repos].index("user_default")
    operators.package_uninstall(repo_index=repository, pkg_id="cvdgs")
    found["left when uninstalled"] = [installed(), os.path.exists(own)]
print(json.dumps(found, default=str), flush=True)
os._exit(0)
"""


@pytest.fixture(scope="module")
def extension(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("dist")
    name = f"left_over_{os.getpid()}.py"
    names = (f"__pycache__/{name}c", f".{name}.swp", f"._{name}", f"#{name}#", f"{name}~", f"{name}.orig")
    left_overs = [ROOT / "ui" / name for name in names]
    left_overs[0].parent.mkdir(exist_ok=True)
    try:
        for path in left_overs:
            path.touch()
        result = subprocess.run([sys.executable, BUILDER, "--out", folder], capture_output=True, text=True)
    finally:
        for path in left_overs:
            path.unlink(missing_ok=True)
    assert result.returncode == 0, result.stderr
    (built,) = folder.iterdir()
    return built


@pytest.fixture(scope="module")
def installed(extension, tmp_path_factory) -> Path:
    """The folder that Blender unpacks the zip into."""
    folder = tmp_path_factory.mktemp("extensions") / "cvdgs"
    zipfile.ZipFile(extension).extractall(folder)
    return folder


def test_the_zip_holds_the_package_and_only_that(extension):
    names = zipfile.ZipFile(extension).namelist()
    assert {name.split("/")[0] for name in names} == {
        "blender_manifest.toml",
        "LICENSE",
        "__init__.py",
        "pyproject.toml",
        "requirements.txt",
        "requirements-torch.txt",
        "requirements-cuda.txt",
        "core",
        "cvdgs_addon",
        "operators",
        "ui",
    }
    assert {"core/__main__.py", "core/splats/io/ply.py", "cvdgs_addon/scene/worker.py"} <= set(names)
    assert not [name for name in names if "__pycache__" in name or "left_over" in name]


IMPORT_ALL = """
import importlib, os, pathlib, sys
root = pathlib.Path(sys.argv[1])
sys.path.insert(0, str(root / "core"))
import bootstrap
bootstrap.load()
for path in sorted((root / "core").rglob("*.py")):
    parts = path.relative_to(root).with_suffix("").parts
    importlib.import_module(".".join(("cvdgs", *(part for part in parts if part != "__init__"))))
assert pathlib.Path(sys.modules["cvdgs.core.worker"].__file__).is_relative_to(root)
sys.stdout.flush()
os._exit(0)
"""


def test_nothing_that_the_worker_imports_is_left_out(installed):
    result = subprocess.run([find_python(), "-I", "-c", IMPORT_ALL, installed], capture_output=True, text=True)
    assert result.returncode == 0, result.stderr


def test_the_worker_runs_from_the_zip_alone(installed):
    request = json.dumps({"job": "inspect", "capture": str(installed / "core" / "demo" / "showroom")})
    command = [find_python(), installed / "core" / "__main__.py"]
    alone = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    result = subprocess.run(
        command, input=f"{request}\n", capture_output=True, text=True, cwd=installed.parent, env=alone
    )
    assert result.returncode == 0, result.stderr
    assert json.loads(result.stdout.splitlines()[-1])["summary"]["views"] > 0


def test_manifest_and_package_have_one_version(extension):
    with zipfile.ZipFile(extension).open("blender_manifest.toml") as file:
        manifest = tomllib.load(file)
    assert manifest["version"] == cvdgs.__version__
    assert extension.name == f"cvdgs-{cvdgs.__version__}.zip"


def test_blender_installs_enables_upgrades_and_removes_it_twice_without_a_trace(extension, tmp_path):
    environment = {**os.environ, "BLENDER_USER_RESOURCES": str(tmp_path)}
    command = [sys.executable, "-c", INSTALL, str(extension)]
    result = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=120)
    assert result.returncode == 0, result.stderr
    assert json.loads(result.stdout.strip().splitlines()[-1]) == {
        "installed": True,
        "enabled": True,
        "usable": True,
        "package": "bl_ext.user_default.cvdgs.cvdgs_addon.scene.convert",
        "usable after an upgrade": True,
        "own files after an upgrade": ["environment"],
        "left when disabled": [],
        "left when uninstalled": [False, False],
    }


def test_a_manifest_that_blender_refuses_is_reported_in_one_line(tmp_path):
    tool = tmp_path / "tool.py"
    tool.write_text("import sys\nprint('Error:\\n  tagline too long')\nsys.exit(sys.argv[1] == 'build')\n")
    command = [sys.executable, BUILDER, "--out", tmp_path / "dist", "--tool", tool]
    result = subprocess.run(command, capture_output=True, text=True)
    assert result.returncode == 2
    assert result.stderr.count("\n") == 1
    assert "refused by Blender's 'build': Error: tagline too long" in result.stderr
    assert list((tmp_path / "dist").iterdir()) == []


def test_a_tool_that_is_not_there_is_not_blamed_on_the_manifest(tmp_path):
    command = [sys.executable, BUILDER, "--out", tmp_path / "dist", "--tool", tmp_path / "blender_ext.py"]
    result = subprocess.run(command, capture_output=True, text=True)
    assert result.returncode == 2
    assert f"build_extension.py: {tmp_path / 'blender_ext.py'}: no such file" in result.stderr
    assert not (tmp_path / "dist").exists()
