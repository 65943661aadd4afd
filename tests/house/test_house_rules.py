"""What no file of the house may do, whichever side of the walls it is on; and that the drawn layout is the real one."""

import ast
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from cvdgs.core.bootstrap import ROOT

FOLDERS = ("core", "cvdgs_addon", "operators", "scripts", "ui")
CODE = sorted(path for folder in FOLDERS for path in (ROOT / folder).rglob("*.py"))
LONGEST_MODULE = 400  # lines
LONGEST_OPERATION = 25  # lines of an operator's or a panel's method that Blender calls
LONGEST_DRAWING = 35
CALLED_BY_BLENDER = ("execute", "invoke", "modal", "poll", "check")
FORBIDDEN_CALLS = {
    *("eval", "exec", "compile", "__import__"),
    *("os.system", "os.popen", "torch.load", "np.memmap"),
    *(f"{module}.{name}" for module in ("pickle", "marshal", "shelve", "dill") for name in ("load", "loads", "open")),
}
MUTATORS = {"append", "extend", "add", "update", "pop", "popitem", "clear", "insert", "remove", "setdefault", "discard"}
MUTABLE = (ast.List, ast.Dict, ast.Set, ast.ListComp, ast.DictComp, ast.SetComp)

each_module = pytest.mark.parametrize("path", CODE, ids=lambda path: str(path.relative_to(ROOT)))


def parse(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def calls(tree: ast.AST) -> list[ast.Call]:
    return [node for node in ast.walk(tree) if isinstance(node, ast.Call)]


@each_module
def test_a_module_says_first_what_it_is_for(path):
    text = path.read_text(encoding="utf-8")
    assert not text or ast.get_docstring(ast.parse(text))


@each_module
def test_no_module_is_too_long_to_be_read_at_once(path):
    assert len(path.read_text(encoding="utf-8").splitlines()) <= LONGEST_MODULE


@each_module
def test_no_data_is_run_as_code_and_no_command_goes_through_a_shell(path):
    for call in calls(parse(path)):
        name = ast.unparse(call.func)
        assert name not in FORBIDDEN_CALLS, f"line {call.lineno}: {name}"
        for keyword in call.keywords:
            refused = keyword.arg in ("shell", "allow_pickle") and getattr(keyword.value, "value", True)
            assert not refused, f"line {call.lineno}: {keyword.arg}"


@each_module
def test_a_refusal_says_what_to_do(path):
    """Behind a dash, so it begins small and needs no full stop. What `complain` is given is no refusal."""
    tree = parse(path)
    shown = {id(part) for call in calls(tree) if ast.unparse(call.func) == "complain" for part in call.args}
    for call in calls(tree):
        if ast.unparse(call.func) != "InputError" or id(call) in shown:
            continue
        given = {keyword.arg: keyword.value for keyword in call.keywords}
        assert "remedy" in given, f"line {call.lineno}: no remedy"
        for text in [part for part in (*call.args, given["remedy"]) if isinstance(part, ast.Constant)]:
            assert text.value, f"line {call.lineno}: nothing is said"
            assert not text.value.endswith("."), f"line {call.lineno}: {text.value}"
        if isinstance(given["remedy"], ast.Constant):
            assert given["remedy"].value[0].islower(), f"line {call.lineno}: {given['remedy'].value}"


@each_module
def test_durations_are_not_taken_from_the_clock_on_the_wall(path):
    """It jumps. A moment for a reader may come from it: a row of a log, the date of a page."""
    for node in ast.walk(parse(path)):
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Sub):
            assert not [call for call in calls(node) if ast.unparse(call.func) in ("time.time", "datetime.now")]


@each_module
def test_nothing_changes_what_belongs_to_a_whole_module(path):
    tree = parse(path)
    assert not [node.names for node in ast.walk(tree) if isinstance(node, ast.Global)]
    shared = {name for statement in tree.body for name in mutable_names(statement)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr in MUTATORS:
            assert not is_one_of(node.func.value, shared), f"line {node.lineno}: {ast.unparse(node.func)}"
        if isinstance(node, ast.Assign | ast.Delete | ast.AugAssign):
            for target in [node.target] if isinstance(node, ast.AugAssign) else node.targets:
                changed = target.value if isinstance(target, ast.Subscript) else None
                assert not is_one_of(changed, shared), f"line {node.lineno}: {ast.unparse(target)}"


def mutable_names(statement: ast.stmt) -> list[str]:
    """The names that a statement of a module binds to a list, dictionary or set."""
    if not isinstance(statement, ast.Assign | ast.AnnAssign) or not isinstance(statement.value, MUTABLE):
        return []
    targets = statement.targets if isinstance(statement, ast.Assign) else [statement.target]
    return [target.id for target in targets if isinstance(target, ast.Name)]


def is_one_of(node: ast.expr | None, names: set[str]) -> bool:
    return isinstance(node, ast.Name) and node.id in names


@pytest.mark.parametrize(
    "path",
    [path for path in CODE if path.is_relative_to(ROOT / "operators") or path.is_relative_to(ROOT / "ui")],
    ids=lambda path: str(path.relative_to(ROOT)),
)
def test_operators_and_panels_are_thin(path):
    tree = parse(path)
    imported = [alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names]
    assert "numpy" not in imported
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            length = (node.end_lineno or 0) - node.lineno + 1
            assert length <= (LONGEST_OPERATION if node.name in CALLED_BY_BLENDER else LONGEST_DRAWING), node.name


@pytest.mark.parametrize(
    "path", sorted((ROOT / "scripts").glob("[!_]*.py")), ids=lambda path: str(path.relative_to(ROOT))
)
def test_a_script_makes_the_tree_importable_the_one_way(path):
    text = path.read_text(encoding="utf-8")
    assert "bootstrap.load(" in text
    assert not re.search(r"sys\.path\.(append|extend)", text)


def test_no_file_names_a_machine_of_ours():
    """Neither its folders nor its servers: what is here has to work anywhere."""
    # Written apart, so that this file does not hold them itself.
    folders = [f"/{name}/" for name in ("work", "farm", "root")]
    if shutil.which("git") is None:
        pytest.skip("there is no git")
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True)
    if listed.returncode != 0:
        pytest.skip("this is no checkout")
    for name in filter(None, listed.stdout.split("\0")):
        path = ROOT / name
        if path.is_file() and b"\0" not in (content := path.read_bytes()):
            text = content.decode("utf-8", "replace")
            assert not [folder for folder in folders if re.search(rf"(?<![\w./}}*-]){folder}", text)], name


def test_contributing_draws_the_packages_that_there_are():
    (drawing,) = re.findall(r"```\n(\.\n.*?)```", (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8"), re.DOTALL)
    packages = {path.parent.relative_to(ROOT).as_posix() for path in CODE if path.name == "__init__.py"}
    packages |= {folder for folder in FOLDERS if (ROOT / folder).is_dir()}
    drawn = drawn_folders(drawing)
    assert {folder for folder in drawn if (ROOT / folder).is_dir()} == drawn
    assert packages <= drawn
    assert {"tests", "docs"} <= drawn


def drawn_folders(drawing: str) -> set[str]:
    """The folders of a tree drawn with lines: each level is four characters wide, a folder ends with a slash."""
    found, above = set(), []
    for indent, name in re.findall(r"^((?:[│ ] {3})*)[├└]── (\S+)/", drawing, re.MULTILINE):
        above[len(indent) // 4 :] = [name]
        found.add("/".join(above))
    return found
