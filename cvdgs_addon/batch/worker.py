"""Entry of the process that makes pictures of a batch: one JSON request on stdin, events on stdout.

    python cvdgs_addon/batch/worker.py                                            with the bpy wheel
    blender -b --factory-startup -P cvdgs_addon/batch/worker.py --

    {"job": "frames", "out": "DIR", "arguments": {...}, "threads": N}       N 0: all processors
    {"job": "video" | "sheet", "out": "DIR", "arguments": {...}}
    {"job": "previews", "out": "DIR", "arguments": {"previews": [...], "width": PIXELS}}
    {"job": "try-eevee"}                                 renders one small picture; ends in one way or another

The arguments are those of ``core/rendering/requests.py``. Events and exit codes: see `worker_process`.
"""

from __future__ import annotations

import contextlib
import json
import sys
from pathlib import Path
from typing import Any, NoReturn


def main() -> NoReturn:
    """Do the job and end the process."""
    from cvdgs.cvdgs_addon.worker_process import serve

    serve(lambda: json.loads(sys.stdin.readline()), _perform, _clean_up)


def _perform(request: dict[str, Any], reporter: Any) -> dict[str, Any]:
    from cvdgs.cvdgs_addon.worker_process import limit_cpu_affinity

    with limit_cpu_affinity(int(request.get("threads") or 0)):
        from cvdgs.cvdgs_addon.batch import jobs  # and with them Blender

    return jobs.perform(request, reporter)


def _clean_up(request: dict[str, Any]) -> None:
    from cvdgs.cvdgs_addon.batch import jobs

    for path in jobs.half_made(request):
        with contextlib.suppress(OSError):
            path.unlink(missing_ok=True)


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "core"))
    import bootstrap

    bootstrap.load(script=__file__)
    main()
