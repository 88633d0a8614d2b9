"""A connection whose packets are dropped: nothing closes it, and the output must not stay on.

The front and a client run in a network of their own, whose loopback is taken down and up again.
"""

import subprocess
import sys
import textwrap

import pytest

from tests.waiting import PATIENCE_S

pytestmark = pytest.mark.slow  # silence without a network is tested with the sessions

SCRIPT = """
    import subprocess, sys, time
    from pathlib import Path
    import haptix.service.client.connection
    from tests.service.service_under_test import Service
    from tests.waiting import wait_for

    def loopback(state):
        subprocess.run(["ip", "link", "set", "lo", state], check=True)

    loopback("up")
    service = Service(Path(sys.argv[1]))
    address = f"ws://127.0.0.1:{service.port}/v1/session"
    client = haptix.service.client.connection.connect("far", address, service.access.native)
    try:
        client.acquire()
        client.arm()
        assert service.hub.control.output.state == "armed"
        wait_for(lambda: service.engine.when("arm"))
        loopback("down")
        began_s = time.monotonic()
        wait_for(lambda: service.engine.when("sleep"))
        took_s = service.engine.when("sleep")[0] - began_s
        # Real time is the subject: silence is measured on the clock on the wall. The last ping that
        # was answered may be 0.1 s old; then 0.4 s, a tick, and seconds of a busy machine.
        assert took_s < 0.1 + 0.4 + 0.02 + 5.0, took_s
        assert service.hub.control.output.state == "asleep"
        loopback("up")
        wait_for(lambda: service.engine.when("wake"))  # the system sends again, ever later
        assert client.ask("inventory").devices
        assert service.hub.control.output.state == "armed"
    finally:
        loopback("up")
        client.close()
        service.close()
"""


@pytest.mark.optional
def test_packets_are_dropped_and_come_again(tmp_path):
    lone = ["unshare", "--map-root-user", "--net"]
    if subprocess.run([*lone, "ip", "link"], capture_output=True).returncode:
        pytest.skip("needs namespaces of the system, and Debian's iproute2")
    script = textwrap.dedent(SCRIPT)
    command = [*lone, sys.executable, "-c", script, str(tmp_path / "service")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S)
    assert done.returncode == 0, done.stderr
