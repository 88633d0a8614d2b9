"""Hostile or clumsy ways in: the served driver, the compiled library, a fork, foreign values."""

import os
import socket
import subprocess
import sys
import textwrap
import threading
from contextlib import suppress

import numpy as np
import pytest

import firmware_io
from firmware_io import DeviceBusyError, DeviceError, MockDriver, Playback, WaveSource, open_device
from firmware_io.links.tcp import answer_to, challenge
from firmware_io.serve import DriverServer
from tests.waiting import PATIENCE_S


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
    assert server.wait(PATIENCE_S) in (0, 128 + 15)
    assert np.abs(np.load(record)).max() > 45.0


def test_a_record_is_a_regular_file_of_any_name(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    server = run_server("--record", str(tmp_path / "pipe"))
    assert (server.wait(PATIENCE_S), "no regular file" in server.stderr.read()) == (1, True)
    target = tmp_path / "there"
    target.write_bytes(b"old")
    target.chmod(0o640)
    (tmp_path / "link").symlink_to(target)
    server = run_server("--record", str(tmp_path / "link"))
    server.stdout.readline()
    server.terminate()
    server.wait(PATIENCE_S)
    assert np.load(target).ndim == 1 and target.stat().st_mode & 0o777 == 0o640


def test_a_server_beyond_this_machine_needs_a_token():
    server = run_server("--host", "0.0.0.0")
    assert server.wait(PATIENCE_S) == 1
    assert "--token-file" in server.stderr.read()


def test_a_token_lets_in_only_those_who_know_it(tmp_path, monkeypatch):
    for name, text in (("right", "s3cret\n"), ("wrong", "s3cre")):
        (tmp_path / name).write_text(text)
    with DriverServer(MockDriver(pace="real"), token="s3cret") as server:
        for selector in ("", f",token_file={tmp_path}/wrong"):
            with pytest.raises(DeviceBusyError, match="token_file"):
                open_device(server.address + selector)
        open_device(server.address + f",token_file={tmp_path}/right").close()
        monkeypatch.setenv("HAPTIX_DRIVER_TOKEN", "s3cret")
        open_device(server.address).close()


def test_an_address_has_no_token_and_no_error_quotes_one(tmp_path):
    with pytest.raises(DeviceError, match="token_file") as caught:
        open_device("tcp:127.0.0.1:7420,token=s3cret")
    assert "s3cret" not in str(caught.value)
    with pytest.raises(DeviceError, match="cannot read"):
        open_device(f"tcp:127.0.0.1:7420,token_file={tmp_path}/none")


def test_silent_strangers_do_not_keep_others_out(served):
    strangers = [socket.create_connection(("127.0.0.1", served.port)) for _ in range(100)]
    open_device(served.address).close()
    for stranger in strangers:
        stranger.close()


def arming(monkeypatch):
    """What a host sends that arms, without waiting for any answer."""
    spoken = []
    driver = MockDriver(pace="real", kept_s=1.0)
    receive = driver.receive

    def receives(data):
        spoken.append(data)
        receive(data)

    monkeypatch.setattr(driver, "receive", receives)
    with DriverServer(driver) as server, open_device(server.address) as device:
        device.arm()
    return b"".join(spoken)


def test_a_page_of_the_web_arms_nothing(monkeypatch):
    """A browser sends what a page wants to any port, but tells the page no word of the answer."""
    frames = arming(monkeypatch)
    driver = MockDriver(pace="real", kept_s=1.0)
    heard = []
    monkeypatch.setattr(driver, "receive", heard.append)
    posts = [
        b"POST / HTTP/1.1\r\nHost: 127.0.0.1:7420\r\nContent-Type: text/plain\r\n\r\n" + frames,
        frames,
        b"0" * 64 + b"\n" + frames,
        answer_to(challenge(), "") + frames,  # of a challenge that it has seen elsewhere
    ]
    with DriverServer(driver) as server:
        for post in posts:
            with socket.create_connection(("127.0.0.1", server.port)) as page:
                page.sendall(post)
                page.settimeout(PATIENCE_S)
                with suppress(ConnectionError):
                    while page.recv(4096):
                        pass  # the challenge, then the end
    assert heard == []


@pytest.mark.parametrize("port", ["\u00b2", "0", "65536", "-1", "7_4", ""])
def test_a_port_that_is_none(port):
    with pytest.raises(DeviceError, match="host and a port"):
        open_device(f"tcp:127.0.0.1:{port}")


@pytest.mark.parametrize("host", ["..", "x" * 300, "\ud800"])
def test_a_name_that_no_host_has(host):
    with pytest.raises(DeviceError, match="No server listens"):
        open_device(f"tcp:{host}:7420")


@pytest.mark.parametrize("horizon_s", ["0.1", None, [0.1], 1 + 2j])
def test_a_horizon_that_is_no_number(horizon_s):
    source = WaveSource(lambda first, count: np.zeros(count))
    with open_device("mock:pace=real") as device, pytest.raises(DeviceError, match="horizon_s"):
        Playback(device, source, horizon_s=horizon_s)


def test_a_limit_beyond_every_float():
    with pytest.raises(firmware_io.LimitError, match="capacitance_f"):
        firmware_io.DriveLimits(capacitance_f=10**400)


# --- forks and threads ---------------------------------------------------------------------------

FORK = """
    import os, sys, time
    import numpy as np
    import firmware_io

    device = firmware_io.open_device(sys.argv[1])
    wave = firmware_io.WaveSource(lambda first, count: 20 * np.sin((first + np.arange(count)) / 20))
    with firmware_io.Playback(device, wave) as playback:
        child = os.fork()
        if child == 0:
            sys.exit(0)  # with every finaliser, as a program's worker may
        os.waitpid(child, 0)
        while playback.stats.samples_played < 24_000:
            time.sleep(0.01)
            playback.touch()  # raises what ended it
    print(playback.stats.samples_played)
    device.close()
"""


def test_a_forked_child_ends_nothing_of_its_parent(served):
    program = [sys.executable, "-c", textwrap.dedent(FORK), served.address]
    done = subprocess.run(program, capture_output=True, text=True, timeout=PATIENCE_S)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) >= 24_000


def test_start_and_stop_from_many_threads():
    device = open_device("mock:pace=real")
    playback = Playback(device, WaveSource(lambda first, count: np.zeros(count)))
    raised = []

    def hurry():
        for _ in range(20):
            try:
                playback.start()
                playback.stop()
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
