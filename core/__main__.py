"""Entry of the worker process: ``python core/__main__.py`` with one JSON request on stdin. See `worker`."""

import importlib.util
import sys
from pathlib import Path

if __name__ == "__main__":
    root = Path(__file__).resolve().parent.parent
    # Started as a file, Python puts core/ first on the path, where our module names would hide others'.
    sys.path[:] = [entry for entry in sys.path if Path(entry or ".").resolve() != root / "core"]
    # Load this very tree as `cvdgs`, whatever its folder is called and whatever is installed.
    spec = importlib.util.spec_from_file_location("cvdgs", root / "__init__.py", submodule_search_locations=[str(root)])
    assert spec is not None
    assert spec.loader is not None
    package = importlib.util.module_from_spec(spec)
    sys.modules["cvdgs"] = package
    spec.loader.exec_module(package)
    from cvdgs.core.worker import main

    sys.exit(main())
