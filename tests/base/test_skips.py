"""The line that says which skipped tests could run, and by which command."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.skips import BROUGHT, summary

ROOT = Path(__file__).parents[2]


def test_each_thing_is_named_once_with_its_tests_and_the_one_command():
    reasons = [
        *["Skipped: needs Debian's chromium: bash scripts/setup-devices.sh"] * 3,
        "Skipped: no chromium: setup-devices.sh",
        "Skipped: needs mono-mcs, mono-runtime and libnewtonsoft-json5.0-cil of Debian",
        "Skipped: arm-none-eabi-gcc is missing (apt install gcc-arm-none-eabi qemu-system-arm)",
        "Skipped: needs a GPU that torch can use",
    ]
    line = summary(reasons)
    assert line.startswith("skipped for want of a browser (4), Mono (1), an ARM compiler")
    assert line.count("bash scripts/setup-devices.sh") == 1
    assert "1 for other reasons" in line
    assert "\n" not in line


def test_nothing_skipped_needs_no_line():
    assert summary([]) == ""


def test_all_that_is_promised_is_what_a_test_lacks_and_what_the_script_brings():
    told = "\n".join(path.read_text(encoding="utf-8") for path in (ROOT / "tests").rglob("*.py"))
    reasons = re.findall(r"(?:skip\(|reason=)f?\"([^\"]+)", told)
    script = (ROOT / "scripts" / "setup-devices.sh").read_text(encoding="utf-8")
    packages = ["chromium", "mono-mcs", "gcc-arm-none-eabi", "nodejs", "gcc ", "jackd2", "xvfb"]
    for words, package in zip(BROUGHT.values(), packages, strict=True):
        assert any(re.search(words, reason.lower()) for reason in reasons), words
        assert package in script


@pytest.mark.slow  # a process of pytest; the line is tested above
def test_a_run_ends_with_it(tmp_path):
    (tmp_path / "test_one.py").write_text(
        "import pytest\n@pytest.mark.parametrize('at', range(7))\n"
        "def test_of_a_page(at):\n    pytest.skip('no chromium')\n",
        encoding="utf-8",
    )
    command = [sys.executable, "-m", "pytest", "-q", "-p", "tests.conftest", "-c",
               ROOT / "pyproject.toml", "--rootdir", tmp_path, tmp_path]  # fmt: skip
    # CI makes a failure of each skip.
    others = {name: value for name, value in os.environ.items() if name != "HAPTIX_NO_SKIPS"}
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, cwd=ROOT, env=others
    )
    assert "skipped for want of a browser (7): bash" in done.stdout
    assert done.stdout.count("chromium") == 0  # none of the seven lines
