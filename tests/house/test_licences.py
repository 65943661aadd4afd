"""What is installed beside cvdgs is free and compatible with its licence, and the page says so."""

import subprocess
import sys

import pytest

from cvdgs.core.bootstrap import ROOT
from cvdgs.core.runtime.environment import CUDA_REQUIREMENTS, LISTED_PYTHONS
from cvdgs.scripts.licences import is_compatible, licences_of, listed_packages


@pytest.mark.parametrize("path", sorted(ROOT.glob("requirements*.txt")), ids=lambda path: path.name)
def test_what_is_installed_is_free_and_compatible(path):
    if path != CUDA_REQUIREMENTS:  # NVIDIA's, which nothing needs
        assert not [entry for entry in licences_of(listed_packages(path)) if not is_compatible(entry[2])]


@pytest.mark.skipif(
    sys.platform != "linux" or sys.version_info[:2] != LISTED_PYTHONS[0],
    reason="the page lists what is installed on Linux for the first of the listed Pythons",
)
def test_the_page_is_what_the_command_writes():
    command = [sys.executable, ROOT / "scripts" / "licences.py", "--check"]
    result = subprocess.run(command, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr


@pytest.mark.parametrize(
    ("text", "compatible"),
    [
        ("MIT", True),
        ("Apache-2.0 AND (BSD-3-Clause AND MIT)", True),
        ("LicenseRef-Proprietary OR GPL-3.0-or-later", True),
        ("MIT AND LicenseRef-Proprietary", False),
        ("BSD-3-Clause", True),
        ("BSD-4-Clause", False),
        ("Apache-2.0 AND CNRI-Python", False),
        ("GPL-2.0-only", False),
        ("CC-BY-NC-4.0", False),
        ("Free for non-commercial use", False),
        ("MITX", False),
    ],
)
def test_a_licence_is_compatible_when_one_alternative_is_in_all_its_parts(text, compatible):
    assert is_compatible(text) is compatible
