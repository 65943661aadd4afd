"""What ``cvdgs.core`` offers to Python programs: names that are there, and examples that work."""

import ast
import doctest
import subprocess
import sys

import pytest

import cvdgs.core
from cvdgs.core.bootstrap import ROOT


@pytest.mark.parametrize("name", ["simulate", "fit_lut", "Rasterizer"])
def test_the_example_in_the_docstring_works(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (example,) = doctest.DocTestFinder(recurse=False).find(getattr(cvdgs.core, name), name)
    result = doctest.DocTestRunner().run(example)
    assert result.attempted > 2
    assert result.failed == 0


def test_every_public_name_is_what_its_module_calls_it():
    for name in cvdgs.core.__all__:
        assert getattr(cvdgs.core, name).__name__ == name
    assert set(cvdgs.core.__all__) <= set(dir(cvdgs.core))


def test_type_checkers_are_told_the_same_names():
    tree = ast.parse((ROOT / "core" / "__init__.py").read_text(encoding="utf-8"))
    declared = {
        alias.asname: f".{node.module}"
        for statement in tree.body
        if isinstance(statement, ast.If)
        for node in statement.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert declared == cvdgs.core._MODULE_OF


def test_importing_the_package_loads_no_library():
    program = "import sys, cvdgs.core; print(sorted({'torch', 'warp', 'numpy', 'pycolmap'} & set(sys.modules)))"
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "[]"


def test_an_unknown_name_is_refused_as_by_any_module():
    with pytest.raises(AttributeError, match="'simulated'"):
        _ = cvdgs.core.simulated
    with pytest.raises(ImportError, match="simulated"):
        from cvdgs.core import simulated  # noqa: F401
