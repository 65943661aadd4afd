"""The doctor, asked about real interpreters: an empty one, the project's, Blender 4.5's, and what is no Python."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from cvdgs.core import bootstrap
from cvdgs.core.bootstrap import ROOT
from cvdgs.core.doctor.checks import cuda_finding
from cvdgs.core.doctor.console import format_finding
from cvdgs.core.doctor.interpreters import Finding, State

BPY45 = ROOT / ".venv-bpy45" / "bin" / "python"


def ask_doctor(*options: str, python: Path | str = sys.executable, tree: Path = ROOT, **variables: str):
    """The finished process of ``run.py --doctor``."""
    command = [str(python), str(tree / "scripts" / "run.py"), "--doctor", *options]
    environment = {**os.environ, **variables}
    return subprocess.run(command, capture_output=True, text=True, env=environment, timeout=200)


def states(process) -> dict[str, str]:
    document = json.loads(process.stdout)
    assert document["ready"] == (process.returncode == 0)
    return {finding["name"]: finding["state"] for finding in document["findings"]}


@pytest.fixture(scope="module")
def empty_python(tmp_path_factory) -> Path:
    """An interpreter with the standard library and nothing else, not even pip."""
    folder = tmp_path_factory.mktemp("empty")
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", folder], check=True)
    return folder / "bin" / "python"


@pytest.fixture
def fresh_tree(tmp_path) -> Path:
    """A copy of the code alone, as if just unpacked: there is no environment in it."""
    tree = tmp_path / "tree"
    for part in ("core", "scripts"):
        shutil.copytree(ROOT / part, tree / part, ignore=shutil.ignore_patterns("showroom", "weights", "__pycache__"))
    shutil.copy(ROOT / "__init__.py", tree)
    return tree


@pytest.mark.skipif(sys.platform == "win32", reason="has no such limits")
def test_disks_on_which_no_temporary_file_fits_are_a_finding(tmp_path):
    import resource  # of POSIX

    program = "from cvdgs.core.doctor.checks import _temporary_files; print(_temporary_files())"
    process = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0)),
    )
    assert process.returncode == 0, process.stderr
    assert "MISSING" in process.stdout
    assert "TMPDIR" in process.stdout


def test_the_projects_environment_is_ready():
    process = ask_doctor("--json")
    assert process.returncode == 0, process.stdout + process.stderr
    found = states(process)
    needed = ("worker", "torch", "warp-lang", "pycolmap", "OpenImageIO", "kernels", "Blender", "cores", "memory")
    assert {found[name] for name in needed} == {"ok"}


def test_an_empty_python_starts_it_and_is_told_what_a_worker_lacks(empty_python):
    process = ask_doctor("--json", python=empty_python, CVDGS_PYTHON=str(empty_python))
    assert process.returncode == 2
    assert process.stderr == ""
    found = states(process)
    assert found["worker"] == "ok"
    assert {found[name] for name in ("numpy", "torch", "warp-lang", "pycolmap", "Blender")} == {"missing"}
    assert found["distributed"] == "note"


def test_a_fresh_checkout_is_told_how_to_make_the_environment(empty_python, fresh_tree):
    process = ask_doctor(python=empty_python, tree=fresh_tree, CVDGS_PYTHON="")
    assert process.returncode == 2
    assert "no Python with torch and Warp found" in process.stdout
    assert f"-> run 'make venv' in {fresh_tree}" in process.stdout
    assert "-> set up the worker first" in process.stdout
    assert process.stdout.splitlines()[-1].startswith("Missing: worker")


def test_an_environment_that_lacks_something_is_made_again_without_touching_results(empty_python, fresh_tree):
    environment = fresh_tree / ".venv"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", environment], check=True)
    process = ask_doctor(python=empty_python, tree=fresh_tree, CVDGS_PYTHON="")
    assert f"-> delete {environment} and run 'make venv' in {fresh_tree}" in process.stdout
    assert "clean" not in process.stdout  # that deletes out/ as well


@pytest.mark.skipif(os.name != "posix", reason="needs sh")
def test_libraries_of_the_bpy_module_are_asked_for_unless_there_is_a_blender(empty_python, fresh_tree, tmp_path):
    (fresh_tree / "scripts" / "system_libraries.sh").write_text("echo libgone6\n")
    without = ask_doctor(python=empty_python, tree=fresh_tree, CVDGS_PYTHON="", CVDGS_BLENDER="")
    assert "libgone6" in without.stdout
    assert without.stdout.splitlines()[-1].startswith("Missing: worker, Blender, libraries")
    blender = tmp_path / "blender"
    blender.write_text("#!/bin/sh\necho Blender 9.9\n")
    blender.chmod(0o755)
    process = ask_doctor("--json", python=empty_python, tree=fresh_tree, CVDGS_PYTHON="", CVDGS_BLENDER=str(blender))
    found = states(process)
    assert found["Blender"] == "ok"
    assert "libraries" not in found


@pytest.mark.skipif(not BPY45.exists(), reason="needs .venv-bpy45")
def test_blender_is_found_where_torch_is_not():
    found = states(ask_doctor("--json", CVDGS_PYTHON=str(BPY45), python=BPY45))
    assert found["Blender"] == "ok"
    assert found["torch"] == "missing"


@pytest.mark.parametrize(
    ("body", "words"),
    [("echo hello", "does not behave like a Python interpreter"), ("echo broken >&2; exit 3", "fails (broken)")],
    ids=["babbles", "fails"],
)
def test_a_program_that_is_no_python_is_one_line(empty_python, tmp_path, body, words):
    program = tmp_path / "program"
    program.write_text(f"#!/bin/sh\n{body}\n")
    program.chmod(0o755)
    process = ask_doctor(python=empty_python, CVDGS_PYTHON=str(program))
    assert process.returncode == 2
    assert "Traceback" not in process.stdout + process.stderr
    assert f"{program}: {words}" in process.stdout.splitlines()[1]


def test_a_run_with_a_python_that_lacks_packages_points_to_the_doctor(empty_python, tmp_path):
    command = [sys.executable, ROOT / "scripts" / "run.py", ROOT / "core" / "demo" / "showroom", "--out", "out"]
    command.append("--no-blend")
    environment = {**os.environ, "CVDGS_PYTHON": str(empty_python)}
    process = subprocess.run(command, capture_output=True, text=True, env=environment, cwd=tmp_path, timeout=100)
    assert process.returncode == 2, process.stderr
    message = process.stderr.splitlines()[-1]
    assert f"{empty_python} lacks a package" in message
    assert "run.py --doctor" in message
    assert not list(tmp_path.rglob("out/*"))


def test_a_blender_module_that_cannot_be_imported_is_told_before_the_training(empty_python, tmp_path):
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", tmp_path / "venv"], check=True)
    (packages,) = (tmp_path / "venv").glob("lib/python*/site-packages")
    (packages / "bpy.py").write_text("raise ImportError('libgone.so.6: cannot open')")
    (packages / "bpy-5.dist-info").mkdir()
    (packages / "bpy-5.dist-info" / "METADATA").write_text("Metadata-Version: 2.1\nName: bpy\nVersion: 5\n")
    python = tmp_path / "venv" / "bin" / "python"
    command = [empty_python, ROOT / "scripts" / "run.py", ROOT / "core" / "demo" / "showroom", "--out", "out"]
    environment = {**os.environ, "CVDGS_PYTHON": str(python), "CVDGS_BLENDER": ""}
    process = subprocess.run(command, capture_output=True, text=True, env=environment, cwd=tmp_path, timeout=100)
    assert process.returncode == 2, process.stderr
    message = process.stderr.splitlines()[-1]
    assert "libgone.so.6" in message
    assert "--no-blend" in message
    assert not (tmp_path / "out").exists()


def test_a_package_that_is_broken_does_not_hide_the_others(tmp_path, empty_python):
    for name in ("torch", "scipy"):
        (tmp_path / f"{name}.py").write_text(
            "raise ImportError('libgone.so.1: cannot open')" if name == "torch" else ""
        )
        folder = tmp_path / f"{name}-1.dist-info"
        folder.mkdir()
        (folder / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1\n")
    python = tmp_path / "python"
    path = f"import sys; sys.path.insert(1, {str(tmp_path)!r})"
    runner = f"{path}; import runpy; sys.argv.pop(0); runpy.run_path(sys.argv[0], run_name='__main__')"
    python.write_text(f'#!/bin/sh\nexec {empty_python} -c "{runner}" "$@"\n')
    python.chmod(0o755)
    process = ask_doctor("--json", python=empty_python, CVDGS_PYTHON=str(python))
    findings = {finding["name"]: finding for finding in json.loads(process.stdout)["findings"]}
    assert findings["torch"]["state"] == "missing"
    assert "libgone.so.1" in findings["torch"]["found"]
    assert findings["scipy"] == {"name": "scipy", "state": "ok", "found": "1", "remedy": ""}


def test_a_remedy_stands_under_what_it_mends():
    text = format_finding(Finding("torch", State.MISSING, "is not installed", "run 'make venv'"))
    first, second = text.splitlines()
    assert first.split() == ["missing", "torch", "is", "not", "installed"]
    assert second.strip() == "-> run 'make venv'"


def test_a_reader_who_leaves_early_is_not_told_of_broken_pipes(empty_python):
    command = [empty_python, str(ROOT / "scripts" / "run.py"), "--doctor"]
    environment = {**os.environ, "CVDGS_PYTHON": str(empty_python)}
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment)
    assert process.stdout is not None
    process.stdout.readline()
    process.stdout.close()
    assert process.wait(timeout=100) == 2
    assert process.stderr is not None
    assert process.stderr.read() == ""


def test_a_python_that_is_too_old_is_told_so_in_one_line(monkeypatch, capsys):
    monkeypatch.setattr(sys, "version_info", (3, 9, 18))
    with pytest.raises(SystemExit) as stopped:
        bootstrap.load()
    assert stopped.value.code == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_a_python_that_lacks_what_a_script_needs_is_told_so_in_one_line(capsys):
    with pytest.raises(SystemExit) as stopped:
        bootstrap.load(modules=("json", "no_such_module"))
    assert stopped.value.code == 2
    said = capsys.readouterr().err
    assert "has no no_such_module" in said
    assert said.count("\n") == 1


@pytest.mark.parametrize(
    ("devices", "in_torch", "state", "words"),
    [
        (["NVIDIA H200"], True, State.OK, "NVIDIA H200"),
        (["NVIDIA H200"], False, State.NOTE, "torch cannot use the CUDA device"),
        ([], False, State.NOTE, "no CUDA device found; the CPU is used"),
    ],
)
def test_a_card_counts_where_both_libraries_can_use_it(devices, in_torch, state, words):
    found = cuda_finding({"cuda": devices, "cuda_in_torch": in_torch, "cuda_versions": [[13, 0], [13, 4]]})
    assert found.state == state
    assert words in found.found


def test_a_program_that_the_system_cannot_run_is_a_finding_and_no_traceback(empty_python, tmp_path):
    program = tmp_path / "python"
    program.write_text("an interpreter for another machine")
    program.chmod(0o755)
    process = ask_doctor(python=empty_python, CVDGS_PYTHON=str(program), CVDGS_BLENDER="")
    assert process.returncode == 2
    assert not process.stderr
    assert f"{program}: cannot be run (Exec format error)" in process.stdout
    assert "Missing: worker" in process.stdout
