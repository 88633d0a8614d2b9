"""Links and touchscreens through a real kernel, libusb, hidapi and evdev: `make test-devices`.

The checks themselves run in a Linux guest, see guest/README.md; here is one test for each.
"""

import json
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from importlib.util import find_spec
from pathlib import Path

import pytest

from firmware_io import own_thread
from firmware_io.firmware.core import compiled
from tests.devices.guest.machine import NoMachineError, run_in_guest

pytestmark = pytest.mark.devices

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
#: Guests side by side; each takes one processor.
GUESTS = 2
MODULES = """
import tests.chromium
from firmware_io import list_devices
from tests.devices.guest.run_checks import load_once
load_once()
list_devices()
"""
#: Of one check, by the guest's own clock, which stands while this machine keeps the guest waiting.
CHECK_LIMIT_S = 60.0 * max(1, int(os.environ.get("HAPTIX_UNPLUGS", "2")) // 2)
#: Of a guest with all its checks: some minutes on a quiet machine. It only ends what hangs.
LIMIT_S = 2400.0


def names_of_checks():
    """All checks; a skip where a library that they import is missing."""
    needed = ("usb", "hidraw", "hid", "cffi", "evdev", "serial", "nidaqmx")
    missing = [name for name in needed if find_spec(name) is None]
    if missing:
        return [pytest.param("", marks=pytest.mark.skip(f"missing modules: {missing}"))]
    from tests.devices.guest.run_checks import CHECKS

    return list(CHECKS)


@pytest.fixture(scope="module")
def results(request, tmp_path_factory):
    """The result of each check that is wanted, by name, and what the guests said."""
    wanted = [
        item.callspec.params["name"]
        for item in request.session.items
        if item.path == Path(__file__) and hasattr(item, "callspec")
    ]
    # The guest reads compiled libraries and modules, but can keep none.
    compiled()
    own_thread.compiled()
    subprocess.run([sys.executable, "-c", MODULES], check=True, cwd=ROOT)
    shares = [share for n in range(GUESTS) if (share := wanted[n::GUESTS])]
    folders = [tmp_path_factory.mktemp("guest") for _ in shares]
    try:
        with ThreadPoolExecutor(GUESTS) as pool:
            runs = list(pool.map(_run, shares, folders))
    except NoMachineError as error:
        pytest.skip(str(error))
    found = {one["name"]: one for run in runs for one in map(json.loads, run.results)}
    return found, [f"exit code {run.exit_code}\n{run.console[-3000:]}" for run in runs]


def _run(names, folder):
    environment = {
        "HOME": str(Path.home()),
        "PATH": "/usr/sbin:/usr/bin:/sbin:/bin",
        "PYTHONPATH": str(ROOT),
        "PYTHONDONTWRITEBYTECODE": "1",
        "OMP_NUM_THREADS": "1",
        "CHECK_LIMIT_S": f"{CHECK_LIMIT_S:g}",
        # All that the guest may write to.
        "TMPDIR": "/run",
    }
    passed = ("CC", "XDG_CACHE_HOME", "HAPTIX_UNPLUGS")
    kept = {key: os.environ[key] for key in passed if key in os.environ}
    command = [sys.executable, "-m", "tests.devices.guest.run_checks", *names]
    return run_in_guest(command, {**environment, **kept}, folder, LIMIT_S)


@pytest.mark.parametrize("name", names_of_checks())
def test_through_a_real_kernel(name, results, record_property):
    found, consoles = results
    if name not in found:
        pytest.fail("no guest came to this check; their consoles:\n" + "\n".join(consoles))
    result = found[name]
    assert result["passed"], result["why"]
    record_property("seconds", result["seconds"])
    for key, value in result["figures"].items():
        record_property(key, value)
    print(json.dumps({"seconds": result["seconds"], **result["figures"]}))  # noqa: T201
