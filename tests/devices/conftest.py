"""Tests through real stacks: their harness is importable, and CI does not let them skip."""

import os
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

#: "1" where these tests must run, as in CI: a skip is a failure there.
REQUIRED = "HAPTIX_REQUIRE_DEVICES"


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item, call):
    report = yield
    if report.skipped and os.environ.get(REQUIRED) == "1":
        report.outcome = "failed"
        why = report.longrepr[2] if isinstance(report.longrepr, tuple) else report.longrepr
        report.longrepr = f"{REQUIRED}=1, so this must run, but: {why}"
    return report
