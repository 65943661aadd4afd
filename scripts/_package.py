"""Makes this very tree importable as ``cvdgs`` for the scripts, whatever its folder is called and whatever is installed."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def load() -> None:
    """Put the package that this script belongs to into ``sys.modules`` as ``cvdgs``; does nothing when it is there."""
    loaded = sys.modules.get("cvdgs")
    if loaded is not None and Path(loaded.__file__ or "").resolve().parent == ROOT:
        return
    spec = importlib.util.spec_from_file_location("cvdgs", ROOT / "__init__.py", submodule_search_locations=[str(ROOT)])
    assert spec and spec.loader
    package = importlib.util.module_from_spec(spec)
    sys.modules["cvdgs"] = package
    spec.loader.exec_module(package)
