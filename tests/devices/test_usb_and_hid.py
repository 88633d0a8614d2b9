"""USB and HID links through a real kernel, libusb and hidapi: `make test-devices`.

The checks themselves run in a Linux guest, see usb_guest/README.md; here is one test for each.
"""

import json
import os
import sys
import time
import warnings
from concurrent.futures import ThreadPoolExecutor
from importlib.util import find_spec
from pathlib import Path

import pytest
from usb_guest.machine import NoMachineError, run_in_guest

from firmware_io.firmware.build import find_compiler, library

pytestmark = pytest.mark.devices

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
#: Guests side by side; each takes one processor.
GUESTS = 2
#: For everything, a second attempt included.
LIMIT_S = float(os.environ.get("HAPTIX_GUEST_LIMIT_S", "285"))


def names_of_checks():
    """All checks; a skip where a library that they import is missing."""
    missing = [name for name in ("usb", "hidraw", "hid", "cffi") if find_spec(name) is None]
    if missing:
        return [pytest.param("", marks=pytest.mark.skip(f"missing modules: {missing}"))]
    from usb_guest import checks_content, checks_faults, checks_opening  # noqa: F401
    from usb_guest.ways import CHECKS

    return list(CHECKS)


@pytest.fixture(scope="module")
def results(request, tmp_path_factory):
    """The results of each check that is wanted, by name, and what the guests said.

    Whatever failed, or was not come to, is tried once more in new guests: on a busy machine a guest
    may stand still for seconds, which no time limit of USB forgives.
    """
    wanted = [
        item.callspec.params["name"]
        for item in request.session.items
        if item.path == Path(__file__) and hasattr(item, "callspec")
    ]
    if find_compiler() is not None:
        library()  # the guest can read this cache, but not write to it
    found, consoles = {}, []
    end_s = time.monotonic() + LIMIT_S
    for share_of_time in (0.75, 1.0):
        missing = [name for name in wanted if not has_passed(found.get(name))]
        shares = [share for n in range(GUESTS) if (share := missing[n::GUESTS])]
        try:
            with ThreadPoolExecutor(GUESTS) as pool:
                folders = [tmp_path_factory.mktemp("guest") for _ in shares]
                limit_s = share_of_time * (end_s - time.monotonic())
                runs = list(pool.map(_run, shares, folders, len(shares) * [limit_s]))
        except NoMachineError as error:
            pytest.skip(str(error))
        for run in runs:
            for result in map(json.loads, run.results):
                found.setdefault(result["name"], []).append(result)
            consoles.append(f"exit code {run.exit_code}\n{run.console[-3000:]}")
    return found, consoles


def has_passed(attempts):
    return bool(attempts) and attempts[-1]["passed"]


def _run(names, folder, limit_s):
    environment = {
        "HOME": str(Path.home()),
        "PATH": "/usr/sbin:/usr/bin:/sbin:/bin",
        "PYTHONPATH": f"{ROOT}:{HERE}",
        "PYTHONDONTWRITEBYTECODE": "1",
        "OMP_NUM_THREADS": "1",
        "CHECK_LIMIT_S": f"{limit_s / 3:g}",
        # All that the guest may write to.
        "TMPDIR": "/run",
    }
    kept = {key: os.environ[key] for key in ("CC", "XDG_CACHE_HOME") if key in os.environ}
    command = [sys.executable, "-m", "usb_guest.run_checks", *names]
    return run_in_guest(command, {**environment, **kept}, folder, limit_s)


@pytest.mark.parametrize("name", names_of_checks())
def test_through_a_real_kernel(name, results, record_property):
    found, consoles = results
    if name not in found:
        pytest.fail("no guest came to this check; their consoles:\n" + "\n".join(consoles))
    *before, result = found[name]
    assert result["passed"], result["why"]
    for attempt in before:
        warnings.warn(f"passed only at the second attempt, after {attempt['why']}", stacklevel=1)
    record_property("seconds", result["seconds"])
    for key, value in result["figures"].items():
        record_property(key, value)
    print(json.dumps({"seconds": result["seconds"], **result["figures"]}))  # noqa: T201
