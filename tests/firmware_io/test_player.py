"""The player in C, function by function."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent
WIRE = HERE.parents[1] / "firmware_io" / "firmware" / "haptix_wire.c"

pytestmark = pytest.mark.skipif(
    sys.platform == "win32" or shutil.which("cc") is None, reason="needs a compiler of C"
)


def test_samples_of_a_revision_that_came_too_late_count_as_they_were_driven(tmp_path):
    program = tmp_path / "late_revision"
    sources = (HERE / "player" / "late_revision.c", WIRE)
    subprocess.run(["cc", "-Wall", "-Wextra", *sources, "-lm", "-o", program], check=True)
    refused, half, obeyed = subprocess.check_output([program], text=True).splitlines()
    assert refused.split() == ["1"] * 10
    assert half.split() == [*"1111222111"]
    assert obeyed.split() == [*"1111233311"]
