"""Write docs/licences.md, or check it: the licence of every package that is installed with cvdgs.

    .venv/bin/python scripts/licences.py            # write the page
    .venv/bin/python scripts/licences.py --check    # say whether the page is up to date, and write nothing

Exit codes: 0 done, 2 a licence that is not free or not compatible with ours, or a page that is out of date.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "core"))
import bootstrap

bootstrap.load()
from cvdgs.core.arguments import exit_code  # noqa: E402
from cvdgs.core.environment import REQUIREMENTS, TORCH_REQUIREMENTS  # noqa: E402
from cvdgs.core.errors import InputError  # noqa: E402
from cvdgs.core.licences import Licence, licences_of, listed_packages  # noqa: E402

PAGE = bootstrap.ROOT / "docs" / "licences.md"
DEVELOPMENT_REQUIREMENTS = bootstrap.ROOT / "requirements-dev.txt"

_HEAD = """\
# Licences

cvdgs is GPL-3.0-or-later. It ships no code of others; these packages are installed beside it, by exact version and
hash (`requirements*.txt`). The page is written by `make licences`, from what the packages say of themselves, and
`make licences` fails on a licence that is not free or not compatible with ours.
"""
_CUDA = """\
## With an NVIDIA card

On Linux, torch comes as a build with CUDA unless pip is told to take another. That build loads the packages of
`requirements-cuda.txt`. Most of them are NVIDIA's and not free software: NVIDIA's own terms hold for them. cvdgs does
not ship them and does not need them. Warp (`warp-lang`, Apache-2.0) contains NVIDIA's runtime compiler under NVIDIA's
terms; on a CPU it is not used.
"""


def page() -> str:
    """The text of the page.

    Raises:
        InputError: a licence cannot be combined with ours.
    """
    worker = licences_of([*listed_packages(REQUIREMENTS), *listed_packages(TORCH_REQUIREMENTS)])
    development = licences_of(listed_packages(DEVELOPMENT_REQUIREMENTS))
    for entry in [*worker, *development]:
        if not entry.is_compatible:
            what = f"the licence '{entry.licence}' is not known to be free and compatible with GPL-3.0-or-later"
            raise InputError(what, where=entry.package, remedy="do without it, or add the licence to core/licences.py")
    parts = [_HEAD, "## The worker\n", table(worker), "## Blender's module, tests and lint\n", table(development)]
    return "\n".join([*parts, _CUDA])


def table(licences: list[Licence]) -> str:
    """One package a line."""
    # A build's local label differs from machine to machine.
    rows = [f"| {entry.package} | {entry.version.partition('+')[0]} | {entry.licence} |" for entry in licences]
    return "\n".join(["| package | version | licence |", "|---|---|---|", *rows]) + "\n"


def main() -> int:
    """Parse the command line, write or check; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true", help="compare with the page instead of writing it")
    check = parser.parse_args().check

    def work() -> None:
        text = page()
        if not check:
            PAGE.write_text(text, encoding="utf-8")
        elif PAGE.read_text(encoding="utf-8") != text:
            raise InputError("is out of date", where=PAGE, remedy="run 'make licences'")

    return exit_code("licences.py", work)


if __name__ == "__main__":
    sys.exit(main())
