"""Install the listed packages into the environment whose Python runs this: what `make venv` does.

    .venv/bin/python scripts/install_requirements.py                           # the worker's, requirements.txt
    .venv/bin/python scripts/install_requirements.py requirements-dev.txt      # and what tests, lint and Blender need

Every file is checked by its hash. Exit codes: 0 done, 2 a file cannot be had or is another one.
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "core"))
import bootstrap

bootstrap.load()
from cvdgs.core.errors import InputError
from cvdgs.core.runtime.cli import ConsoleReporter, OneLineParser, exit_code
from cvdgs.core.runtime.environment import LISTED_PYTHONS, REQUIREMENTS, install_locked


def main() -> int:
    """Parse the command line and install; returns the exit code."""
    parser = OneLineParser(description=__doc__.splitlines()[0])
    parser.add_argument("list", nargs="?", type=Path, default=REQUIREMENTS, metavar="FILE", help="(requirements.txt)")

    def work() -> None:
        requirements = parser.parse_args().list
        if sys.version_info[:2] not in LISTED_PYTHONS:
            version = ".".join(map(str, sys.version_info[:2]))
            remedy = "install Python 3.11 or 3.13, and type 'make venv PYTHON=python3.13'"
            raise InputError(f"the lists are not for Python {version}", where=sys.executable, remedy=remedy)
        if not requirements.is_file():
            raise InputError("there is no such list", where=requirements, remedy="name one of requirements*.txt")
        install_locked(Path(sys.executable), ConsoleReporter(sys.stderr), requirements, log=lambda _: None)

    return exit_code("install_requirements.py", work)


if __name__ == "__main__":
    sys.exit(main())
