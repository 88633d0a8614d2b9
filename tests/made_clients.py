"""What the tests of clients and pages take from Node: the tools, and the files that are made."""

import shutil
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
TYPESCRIPT = ROOT / "clients" / "typescript"
CSHARP = ROOT / "clients" / "csharp"


def node_tools() -> Path:
    """Return the folder of the packages for Node; skip where it is not there."""
    tools = TYPESCRIPT / "node_modules"
    if shutil.which("node") is None or not tools.exists():
        pytest.skip("needs Node 20: make clients")
    return tools


@cache
def make_clients() -> None:
    """Make the clients' types and messages, where they are not those of today's schema."""
    node_tools()
    done = subprocess.run(
        [sys.executable, ROOT / "scripts" / "make-clients.py"], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
