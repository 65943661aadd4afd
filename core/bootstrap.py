"""Makes this very tree importable as ``cvdgs``, whatever its folder is called. Standard library only.

For files that are started by their path, before there is a package:

    sys.path.insert(0, str(ROOT / "core"))
    import bootstrap

    bootstrap.load()
"""

from __future__ import annotations

import importlib.util
import io
import os
import sys
from collections.abc import Collection
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
OLDEST_PYTHON = (3, 11)


def require_python(oldest: tuple[int, int] = OLDEST_PYTHON) -> None:
    """End the process with a line and exit code 2 where Python is too old for the imports to come."""
    if sys.version_info >= oldest:
        return
    wanted, best = ".".join(map(str, oldest)), ".".join(map(str, OLDEST_PYTHON))
    found = ".".join(map(str, sys.version_info[:3]))
    print(f"{sys.executable}: Python {found} is too old ({wanted} is needed) - try python{best}", file=sys.stderr)
    sys.exit(2)


def require_modules(names: Collection[str]) -> None:
    """End the process with a line and exit code 2 where Python lacks one of these modules."""
    missing = [name for name in names if importlib.util.find_spec(name) is None]
    if missing:
        made = "'make venv' makes .venv/bin/python, which has it"
        print(f"{sys.executable}: this Python has no {missing[0]} - {made}", file=sys.stderr)
        sys.exit(2)


def _print_anywhere() -> None:
    """Let what is printed get lost, instead of failing, where Python was started without stdout or stderr.

    Services and schedulers close them, and Windows gives none to a program without a console.
    """
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):  # in the order of the descriptors they take
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode, encoding="utf-8"))  # noqa: SIM115


def _show_any_name() -> None:
    """Write as an escape sequence what the encoding of stdout lacks, as Python does on stderr, instead of failing.

    Where stdout is a file or a pipe, Windows' encoding has some 200 characters; names of files have any.
    """
    if isinstance(sys.stdout, io.TextIOWrapper) and sys.stdout.errors == "strict":
        sys.stdout.reconfigure(errors="backslashreplace")


def load(oldest: tuple[int, int] = OLDEST_PYTHON, *, script: str = "", modules: Collection[str] = ()) -> None:
    """Put the package that this file belongs to into ``sys.modules`` as ``cvdgs``, and take ``core/`` off the path.

    On the path, the modules of ``core/`` would hide others of the same names. From then on, any text can be printed.

    Args:
        oldest: Python for what the script imports; ends the process where this one is older.
        script: file in a package of ours that Python was started with. Python puts its folder on the path: taken off.
        modules: of other packages that the script imports; ends the process where one is missing.
    """
    _print_anywhere()
    require_python(oldest)
    require_modules(modules)
    _show_any_name()
    hiding = {ROOT / "core", *([Path(script).resolve().parent] if script else [])}
    sys.path[:] = [entry for entry in sys.path if Path(entry or ".").resolve() not in hiding]
    loaded = sys.modules.get("cvdgs")
    if loaded is not None and Path(loaded.__file__ or "").resolve().parent == ROOT:
        return
    spec = importlib.util.spec_from_file_location("cvdgs", ROOT / "__init__.py", submodule_search_locations=[str(ROOT)])
    assert spec is not None
    assert spec.loader is not None
    package = importlib.util.module_from_spec(spec)
    sys.modules["cvdgs"] = package
    spec.loader.exec_module(package)
