"""The client for pages and Node, under Node, against the real front."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

CLIENT = Path(__file__).parents[2] / "clients" / "typescript"


@pytest.fixture(scope="module")
def node():
    found = shutil.which("node")
    if found is None or not (CLIENT / "node_modules" / "ws").exists():
        pytest.skip("needs node, and npm ci in clients/typescript")
    return found


def test_client(node, service):
    environment = os.environ | {"HAPTIX_SERVICE": str(service.access._folder)}
    for test in sorted((CLIENT / "test").glob("*.test.js")):  # one by one: there is one lease
        done = subprocess.run(
            [node, test], capture_output=True, text=True, timeout=60, env=environment
        )
        assert done.returncode == 0, done.stdout[-6000:]
    # 40 px from the element's corner, at 4 px/mm from (10, 5) mm
    assert (20.0, 5.0) in [(report.x_mm, report.y_mm) for report in service.engine.reports]
    by_mm = next(report for report in service.engine.reports if report.touch_id == 5)
    assert by_mm[2:] == ("down", 3.0, 4.0, 0.5, None)
