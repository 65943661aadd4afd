"""Write docs/licences.md, or check it: the licence of every package that is installed with cvdgs.

    .venv/bin/python scripts/licences.py            # write the page
    .venv/bin/python scripts/licences.py --check    # say whether the page is up to date, and write nothing

pip-licenses reads the packages' metadata. Exit codes: 0 done, 2 a licence that is not free or not compatible with ours,
or a page that is out of date.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "core"))
import bootstrap

bootstrap.load(modules=("piplicenses",))
from cvdgs.core.errors import InputError
from cvdgs.core.runtime.cli import exit_code
from cvdgs.core.runtime.environment import REQUIREMENTS, TORCH_REQUIREMENTS

PAGE = bootstrap.ROOT / "docs" / "licences.md"
DEVELOPMENT_REQUIREMENTS = bootstrap.ROOT / "requirements-dev.txt"

# Free, and compatible with GPL-3.0-or-later by the list of licences of the Free Software Foundation.
COMPATIBLE = (
    r"0BSD|([23]-Clause )?BSD|BSD[- ][23][- ]Clause( License)?|BSD License|MIT( License)?|MIT-CMU|HPND|ISC|Zlib|"
    r"Unlicense|CC0-1\.0|Apache[- ]2\.0( WITH LLVM-exception)?|Apache Software License|BSL-1\.0|PSF-2\.0|"
    # OpenUSD's: Apache 2.0 but for its section on trademarks.
    r"LicenseRef-TOST-1\.0|"
    r"Python Software Foundation License|MPL-2\.0|Mozilla Public License 2\.0 \(MPL 2\.0\)|"
    r"L?GPL-(2\.[01]|3\.0)-or-later|L?GPL-3\.0(-only)?|GNU General Public License v3 or later \(GPLv3\+\)"
)
_ENTRY = re.compile(r"^([\w.-]+)==", re.MULTILINE)

_HEAD = """\
# Licences

cvdgs is GPL-3.0-or-later. It ships no third-party code; these packages are installed beside it, by exact version and
hash (`requirements*.txt`). `make licences` writes this page from the packages' own metadata and fails on a licence that
is not free or not compatible with ours.
"""
_CUDA = """\
## With an NVIDIA card

On Linux, torch comes as a build with CUDA unless pip is told to take another. That build loads the packages of
`requirements-cuda.txt`. Most of them are NVIDIA's and not free software: NVIDIA's own terms hold for them. cvdgs does
not ship them and does not need them. Warp (`warp-lang`, Apache-2.0) contains NVIDIA's runtime compiler under NVIDIA's
terms; on a CPU it is not used.
"""


def listed_packages(requirements: Path) -> list[str]:
    """The packages of a requirements file, without those of the files that it includes."""
    return list(dict.fromkeys(_ENTRY.findall(requirements.read_text(encoding="utf-8"))))  # one may be there per Python


def licences_of(packages: list[str]) -> list[tuple[str, str, str]]:
    """Name, version and licence of the packages that are installed here; others are for other systems."""
    command = [sys.executable, "-m", "piplicenses", "--format=json", "--from=mixed", "--with-system"]
    found = json.loads(subprocess.run([*command, "--packages", *packages], capture_output=True, check=True).stdout)
    order = {re.sub(r"[-_.]+", "-", name).lower(): place for place, name in enumerate(packages)}
    found.sort(key=lambda entry: order[re.sub(r"[-_.]+", "-", entry["Name"]).lower()])
    return [(entry["Name"], entry["Version"], _as_expression(entry["License"])) for entry in found]


def _as_expression(licence: str) -> str:
    """What pip-licenses says as an SPDX-like expression: it separates classifiers, all of which hold, by semicolons."""
    return " AND ".join(part for part in licence.split("; ") if part != "DFSG approved")


def is_compatible(licence: str) -> bool:
    """Whether one of the alternatives that an SPDX expression offers consists of `COMPATIBLE` licences."""
    if re.fullmatch(COMPATIBLE, licence):
        return True
    return any(
        all(re.fullmatch(COMPATIBLE, part.strip("( )")) for part in alternative.split(" AND "))
        for alternative in licence.split(" OR ")
    )


def page() -> str:
    """The text of the page.

    Raises:
        InputError: a licence cannot be combined with ours.
    """
    worker = licences_of([*listed_packages(REQUIREMENTS), *listed_packages(TORCH_REQUIREMENTS)])
    development = licences_of(listed_packages(DEVELOPMENT_REQUIREMENTS))
    for package, _, licence in [*worker, *development]:
        if not is_compatible(licence):
            what = f"the licence '{licence}' is not known to be free and compatible with GPL-3.0-or-later"
            raise InputError(what, where=package, remedy="remove it, or add the licence to scripts/licences.py")
    parts = [_HEAD, "## The worker\n", table(worker), "## Blender's module, tests and lint\n", table(development)]
    return "\n".join([*parts, _CUDA])


def table(licences: list[tuple[str, str, str]]) -> str:
    """One package a line."""
    # A build's local label differs from machine to machine.
    rows = [f"| {package} | {version.partition('+')[0]} | {licence} |" for package, version, licence in licences]
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
