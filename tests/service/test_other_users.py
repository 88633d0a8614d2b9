"""Another user of this machine reads none of the service's files, wherever the folder is."""

import asyncio
import os
import subprocess
import tempfile
from hashlib import sha256
from pathlib import Path

import pytest

from haptix.service.front.access import Access
from haptix.service.front.assets import AssetStore

NOBODY = 65534


async def chunks(content):
    yield content


@pytest.mark.optional
def test_nobody_reads_tokens_and_assets():
    if os.getuid() != 0:
        pytest.skip("needs root, to become another user")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "service"
        folder.mkdir(mode=0o755)  # it was there before, and is open
        folder.chmod(0o755)
        Path(name).chmod(0o755)
        (folder / "open").write_text("x")
        access = Access(7421, folder)
        access.pair(access.code(), "https://example.org", "page")
        store = AssetStore(folder / "assets")
        content = b"a photograph"
        assert asyncio.run(store.put(sha256(content).hexdigest(), ".png", chunks(content)))
        files = [path for path in folder.rglob("*") if path.is_file() and path.name != "open"]
        assert {path.name for path in files} >= {"service.json", "tokens.json"} and len(files) == 3
        for path in [*files, folder / "open"]:
            told = subprocess.run(["cat", path], user=NOBODY, group=NOBODY, capture_output=True)
            assert (told.returncode == 0) == (path.name == "open"), path
