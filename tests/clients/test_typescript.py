"""The client for pages and Node, under Node, against the real front."""

import os
import subprocess

from tests.made_clients import TYPESCRIPT, node_tools
from tests.waiting import PATIENCE_S, wait_for


def test_client(service):
    node_tools()
    environment = os.environ | {"HAPTIX_SERVICE": str(service.access.folder)}
    for test in sorted((TYPESCRIPT / "test").glob("*.test.js")):  # one by one: there is one lease
        done = subprocess.run(
            ["node", test], capture_output=True, text=True, timeout=PATIENCE_S, env=environment
        )
        assert done.returncode == 0, done.stdout[-6000:]
    # 40 px from the element's corner, at 4 px/mm from (10, 5) mm
    reports = service.engine.reports
    wait_for(lambda: (20.0, 5.0) in [(report.x_mm, report.y_mm) for report in reports])
    by_mm = wait_for(lambda: next((one for one in reports if one.touch_id == 5), None))
    assert by_mm[2:] == (3.0, 4.0, "down", 0.5, None)
