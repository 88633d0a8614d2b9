"""Hostile or clumsy ways in: the served driver, the compiled library, a fork, foreign values."""

import os
import socket
import stat
import subprocess
import sys
import textwrap
import threading

import numpy as np
import pytest

import firmware_io
from firmware_io import DeviceBusyError, DeviceError, MockDriver, Playback, open_device
from firmware_io.firmware import build
from firmware_io.serve import DriverServer


@pytest.fixture
def served():
    with DriverServer(MockDriver(pace="real", kept_s=1.0)) as server:
        yield server


def test_a_served_driver_takes_the_next_host_at_once(served):
    for _ in range(300):
        open_device(served.address).close()


def test_a_second_host_is_still_refused(served):
    with open_device(served.address), pytest.raises(DeviceBusyError):
        open_device(served.address)


def run_server(*arguments):
    command = [sys.executable, "-m", "firmware_io.serve", "--port", "0", *arguments]
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env={**os.environ}
    )


@pytest.mark.parametrize("end", ["terminate", "interrupt", "hang up"])
def test_a_record_is_written_however_the_server_ends(tmp_path, end):
    record = tmp_path / "record.npy"
    server = run_server("--record", str(record))
    address = server.stdout.readline().strip()
    with open_device(address) as device:
        device.write(50 * np.sin(np.arange(4800) / 20))
    server.send_signal({"terminate": 15, "interrupt": 2, "hang up": 1}[end])
    assert server.wait(20) in (0, 128 + 15)
    assert np.abs(np.load(record)).max() > 45.0


def test_a_server_beyond_this_machine_needs_a_token():
    server = run_server("--host", "0.0.0.0")
    assert server.wait(20) == 1
    assert "--token" in server.stderr.read()


def test_a_token_lets_in_only_those_who_know_it():
    with DriverServer(MockDriver(pace="real"), token="s3cret") as server:
        for selector in ("", ",token=wrong"):
            with pytest.raises(DeviceBusyError, match="token"):
                open_device(server.address + selector)
        open_device(server.address + ",token=s3cret").close()


def test_a_silent_stranger_does_not_keep_others_out():
    with DriverServer(MockDriver(pace="real"), token="s3cret") as server:
        stranger = socket.create_connection(("127.0.0.1", server.port))
        open_device(server.address + ",token=s3cret").close()
        stranger.close()


@pytest.mark.parametrize("port", ["\u00b2", "0", "65536", "-1", "7_4", ""])
def test_a_port_that_is_none(port):
    with pytest.raises(DeviceError, match="host and a port"):
        open_device(f"tcp:127.0.0.1:{port}")


@pytest.mark.parametrize("host", ["..", "x" * 300, "\ud800"])
def test_a_name_that_no_host_has(host):
    with pytest.raises(DeviceError, match="No server listens"):
        open_device(f"tcp:{host}:7420")


@pytest.mark.parametrize("lead_s", ["0.025", None, [0.025], 1 + 2j])
def test_a_lead_that_is_no_number(lead_s):
    with open_device("mock:pace=real") as device, pytest.raises(DeviceError, match="lead_s"):
        Playback(device, lead_s=lead_s)


def test_a_limit_beyond_every_float():
    with pytest.raises(firmware_io.LimitError, match="capacitance_f"):
        firmware_io.DriveLimits(capacitance_f=10**400)


# --- the compiled firmware ---------------------------------------------------------------------


@pytest.fixture
def own_cache(tmp_path, monkeypatch):
    if build.find_compiler() is None:
        pytest.fail("a C compiler is needed: apt install gcc")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "haptix"


def plays(program="from firmware_io.firmware.opening import open_core"):
    """Whether a new process, in which no library is loaded yet, opens the compiled core."""
    code = textwrap.dedent(
        """
        from firmware_io import open_device
        with open_device("mock:") as device:
            device.write([1.0, 2.0, 1.0])
            print(device.mock.core)
        """
    )
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)


@pytest.mark.parametrize("damage", [b"", b"\x7fELF", b"no library at all"])
def test_a_damaged_library_is_built_again(own_cache, damage):
    assert plays().stdout == "c\n"
    (library,) = own_cache.glob("*.so")
    library.chmod(stat.S_IRUSR | stat.S_IWUSR)
    library.write_bytes(damage)
    done = plays()
    assert (done.stdout, done.stderr) == ("c\n", "")


def test_another_library_in_its_place_is_not_run(own_cache, tmp_path):
    assert plays().stdout == "c\n"
    (library,) = own_cache.glob("*.so")
    source = tmp_path / "planted.c"
    source.write_text("#include <stdlib.h>\n__attribute__((constructor)) void f(void){_Exit(7);}\n")
    planted = tmp_path / "planted.so"
    subprocess.run(["cc", "-shared", "-fPIC", "-o", planted, source], check=True)
    library.chmod(stat.S_IRUSR | stat.S_IWUSR)
    library.write_bytes(planted.read_bytes())
    done = plays()
    assert (done.returncode, done.stdout) == (0, "c\n")


@pytest.mark.skipif(os.getuid() != 0, reason="only root can give a folder to somebody else")
def test_a_cache_of_somebody_else_is_not_used(own_cache):
    own_cache.mkdir(parents=True)
    os.chown(own_cache, 12345, 12345)
    assert plays().stdout == "c\n"
    assert not list(own_cache.glob("*.so"))


def test_a_cache_that_others_may_write_is_not_used(own_cache):
    own_cache.mkdir(parents=True)
    own_cache.chmod(0o777)
    assert plays().stdout == "c\n"
    assert not list(own_cache.glob("*.so"))


# --- forks and threads ---------------------------------------------------------------------------

FORK = """
    import os, sys, time
    import numpy as np
    import firmware_io

    device = firmware_io.open_device(sys.argv[1])
    with firmware_io.Playback(device, lead_s=0.2) as playback:
        for block in range(10):
            playback.wait_for_room(960, 5.0)
            playback.put(20 * np.sin(np.arange(960) / 20))
            if block == 4:
                child = os.fork()
                if child == 0:
                    sys.exit(0)  # with every finaliser, as a program's worker may
                os.waitpid(child, 0)
    print(playback.stats.samples_played, playback.stats.underruns)
    device.close()
"""


def test_a_forked_child_ends_nothing_of_its_parent(served):
    program = [sys.executable, "-c", textwrap.dedent(FORK), served.address]
    done = subprocess.run(program, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split()[0] == "9600"


def test_start_and_stop_from_many_threads():
    device = open_device("mock:pace=real")
    playback = Playback(device)
    raised = []

    def hurry():
        for _ in range(20):
            try:
                playback.start()
                playback.stop(drain=False)
            except Exception as error:
                raised.append(error)

    threads = [threading.Thread(target=hurry) for _ in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    device.close()
    assert raised == []


def test_a_mock_in_real_time_keeps_the_last_minute_only():
    now = [0.0]
    driver = MockDriver(pace="real", clock=lambda: now[0])
    for _ in range(300):
        now[0] += 1.0
        assert driver.status.clock_ticks == round(now[0] * 48_000)
    assert 60.0 <= driver.output_v.size / 48_000 <= 62.0


@pytest.mark.parametrize("value", ["5", None, [5.0], True])
def test_a_ceiling_that_is_no_number(value):
    with open_device("mock:") as device, pytest.raises(firmware_io.HaptixError, match="ceiling_v"):
        device.lower_ceiling(value)


@pytest.mark.parametrize("name", ["carrier_hz", "lead_s", "watchdog_s", "status_s"])
def test_a_setting_that_is_no_number(name):
    device = open_device("mock:mode=envelope")
    with pytest.raises(DeviceError, match=name):
        device.set_up(**{name: "1"})
    device.close()
