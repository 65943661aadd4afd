"""Entry of the Blender process that takes times: one JSON request on stdin, events on stdout.

    {"job": "time-import", "out": "DIR", "arguments": {"file": "NAME", "rounds": N}}    for ``benchmark.py files``
    {"job": "time-stills", "out": "RUN", "arguments": {...}}                      for ``benchmark.py display``

The arguments are those of `in_blender`. Events and exit codes: see ``cvdgs_addon/worker_process.py``.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any, NoReturn

PATH = Path(__file__)


def main() -> NoReturn:
    """Do the job and end the process."""
    from cvdgs.cvdgs_addon.worker_process import serve

    serve(lambda: json.loads(sys.stdin.readline()), _perform, lambda _: None)


def _perform(request: dict[str, Any], reporter: Any) -> dict[str, Any]:
    from cvdgs.scripts.benchmarks.timing.in_blender import perform

    return perform(request, reporter)


if __name__ == "__main__":
    sys.path.insert(0, str(PATH.resolve().parents[3] / "core"))
    import bootstrap

    bootstrap.load(script=__file__)
    main()
