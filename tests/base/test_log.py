"""The log: nobody waits for it, what is missing is told, and it holds no secret."""

import errno
import io
import logging
import os
import re
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from firmware_io import Playback, open_device
from firmware_io.playback import WaveSource
from haptix.base import log
from haptix.base.errors import InputError
from tests.waiting import PATIENCE_S

LINE = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{6} \d+ haptix\.room (INFO|DEBUG) (.*)")
room = logging.getLogger("haptix.room")


@pytest.fixture(autouse=True)
def _stops():
    yield
    log.stop()
    assert not room.isEnabledFor(logging.INFO)


def texts(path):
    """What the tests logged into a file."""
    found = (LINE.fullmatch(line) for line in path.read_text().splitlines())
    return [line[2] for line in found if line]


class Disk(io.StringIO):
    """A file whose writes wait for `goes_on`, or fail while it is `full`."""

    def __init__(self):
        super().__init__()
        self.goes_on, self.is_waiting = threading.Event(), threading.Event()
        self.goes_on.set()
        self.full = False

    def write(self, text):
        self.is_waiting.set()
        self.goes_on.wait()
        if self.full:
            raise OSError(errno.ENOSPC, "No space left on device")
        return super().write(text)


@pytest.fixture
def disk():
    disk = Disk()
    yield disk
    disk.goes_on.set()


@pytest.fixture
def on_disk(disk):
    running = log.Log("debug", log.LogOutput(disk))
    yield running
    disk.goes_on.set()
    running.close()


def until(is_so):
    """Wait for the log's thread."""
    for _ in range(10_000):
        if is_so():
            return
        time.sleep(0.01)
    raise AssertionError("the log's thread did not go on")


def told_missing(text):
    return [int(number) for number in re.findall(r"(\d+) records are missing here", text)]


def test_a_record_is_one_line_with_time_room_and_level(tmp_path):
    log.start("info", tmp_path / "a.log")
    room.info("armed at %g V", 150.0)
    room.debug("> 48580104")
    log.stop()
    assert texts(tmp_path / "a.log") == ["armed at 150 V"]
    log.start("debug", tmp_path / "a.log")
    room.debug("> %s", b"HX".hex())
    log.stop()
    assert texts(tmp_path / "a.log") == ["armed at 150 V", "> 4858"]


def test_off_there_is_nobody_to_log_to():
    assert not room.isEnabledFor(logging.INFO)
    assert not room.hasHandlers() or room.getEffectiveLevel() > logging.INFO


def test_a_disk_that_blocks_holds_nobody_up_and_what_it_missed_is_told(disk, on_disk):
    disk.goes_on.clear()
    room.info("first")
    disk.is_waiting.wait()
    count = log.MOST_WAITING + 100
    # In this thread: if a record waited for the disk, the test would never end.
    for number in range(count):
        room.debug("record %d", number)
    disk.goes_on.set()
    until(lambda: not on_disk.queuer.queue.qsize())
    room.info("after")
    on_disk.close()
    lines = disk.getvalue().splitlines()
    written = [line for line in lines if "record " in line and "records" not in line]
    assert written[0].endswith("record 0")
    assert told_missing(disk.getvalue()) == [count - len(written)]
    # Told where they are missing.
    at = next(place for place, line in enumerate(lines) if "missing here" in line)
    assert lines[at - 1].endswith(f"record {len(written) - 1}") and lines[at + 1].endswith("after")


def test_a_full_disk_is_told_once_there_is_room(disk, on_disk):
    room.info("before")
    until(lambda: "before" in disk.getvalue())
    disk.full = True
    for number in range(7):
        room.info("lost %d", number)
    until(lambda: on_disk.writer.output.lost == 7)
    disk.full = False
    room.info("after")
    on_disk.close()
    text = disk.getvalue()
    assert "lost" not in text and "before" in text
    assert told_missing(text) == [7] and "No space left on device" in text


def test_a_disk_that_never_comes_back_does_not_hold_up_the_end(disk, on_disk, monkeypatch, capsys):
    monkeypatch.setattr(log, "END_S", 0.01)
    disk.goes_on.clear()
    for _ in range(5):
        room.info("stuck")
    disk.is_waiting.wait()
    on_disk.close()
    assert re.search(r"the end of the log lacks \d+ records", capsys.readouterr().err)


def test_no_lock_is_between_threads_that_log(on_disk):
    """The audio's own thread logs while another holds every lock that the handler has."""
    on_disk.queuer.acquire()
    try:
        other = threading.Thread(target=room.info, args=("from the audio",), daemon=True)
        other.start()
        other.join(PATIENCE_S)  # it would wait for ever
        assert not other.is_alive()
    finally:
        on_disk.queuer.release()


def test_files_are_begun_anew_when_full(tmp_path, monkeypatch):
    monkeypatch.setattr(log, "FILE_BYTES", 2000)
    log.start("debug", tmp_path / "a.log")
    for number in range(400):
        room.debug("record %03d", number)
    log.stop()
    files = sorted(tmp_path.glob("a.log*"))
    assert len(files) == 1 + log.FILES_BEFORE
    assert all(path.stat().st_size <= 2000 for path in files)
    assert texts(tmp_path / "a.log")[-1] == "record 399"
    if os.name == "posix":
        assert {path.stat().st_mode & 0o777 for path in files} == {0o600}


def test_processes_that_log_to_one_file_have_one_each(tmp_path):
    """A service's processes: by the environment, and rotated by nobody else."""
    log.start("info", tmp_path / "a.log")
    code = "import haptix, logging; logging.getLogger('haptix.room').info('from the other')"
    subprocess.run([sys.executable, "-c", code], check=True)
    room.info("from here")
    log.stop()
    assert texts(tmp_path / "a.log") == ["from here"]
    assert texts(tmp_path / "a-2.log") == ["from the other"]


def test_what_a_record_quotes_makes_no_line_of_its_own(tmp_path):
    log.start("info", tmp_path / "a.log")
    room.info("client %s", "\x1b[2J\r")
    room.info("client %s", "x\n2026-01-01T00:00:00.000000 1 haptix.room INFO forged")
    log.stop()
    assert texts(tmp_path / "a.log") == ["client \\x1b[2J\\x0d", "client x"]


@pytest.mark.parametrize(
    "text",
    [
        "opens tcp:10.0.0.7:7420,token=Geheim",
        'got {"type": "hello", "token": "Geheim"}',
        "stores at s3://user:Geheim@example.org/a",
        "asks https://Geheim@example.org/a?x=1",
        "PASSWORD=Geheim",
    ],
)
def test_no_secret_is_written(tmp_path, text):
    log.start("info", tmp_path / "a.log")
    room.info("%s", text)
    log.stop()
    assert "***" in (tmp_path / "a.log").read_text()
    assert "Geheim" not in (tmp_path / "a.log").read_text()


def test_what_cannot_be_is_refused(tmp_path):
    with pytest.raises(InputError, match="'loud'"):
        log.start("loud")
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot write"):
        log.start("info", tmp_path / "file" / "a.log")


def test_a_wrong_environment_is_a_warning(monkeypatch):
    monkeypatch.setenv(log.VARIABLE, "loud")
    with pytest.warns(UserWarning, match="HAPTIX_LOG"):
        log.start_as_environment_says()


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full")
def test_a_program_on_a_full_disk_says_so_at_its_end():
    code = "import haptix, logging; logging.getLogger('haptix.room').info('x'); raise SystemExit(3)"
    environment = os.environ | {log.VARIABLE: "info,/dev/full"}
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=environment
    )
    assert done.returncode == 3
    assert done.stderr == (
        "haptix: the end of the log lacks 2 records: [Errno 28] No space left on device\n"
    )


def played():
    """What a driver plays of half a second of a stream, in its own time."""
    device = open_device("mock:pace=stepped")
    tone = WaveSource(lambda first, count: 50.0 * np.sin(0.01 * np.arange(first, first + count)))
    with Playback(device, tone) as playback:
        for _ in range(10):
            playback.touch()
            playback.run_until(device.clock() + 0.05)
        stats = playback.stats
    output_v = device.mock.output_v
    device.close()
    return output_v, stats


@pytest.mark.parametrize("fault", ["blocks", "is full"])
def test_a_stream_goes_on_whatever_the_disk_does(disk, on_disk, monkeypatch, fault):
    on_disk.close()
    expected, _ = played()
    monkeypatch.setattr(log, "MOST_WAITING", 50)
    slow = log.Log("debug", log.LogOutput(disk))
    if fault == "blocks":
        disk.goes_on.clear()
    else:
        disk.full = True
    output_v, stats = played()
    assert stats.underruns == 0
    np.testing.assert_array_equal(output_v, expected)
    if fault == "blocks":
        assert slow.queuer.dropped > 50
    else:
        until(lambda: not slow.queuer.queue.qsize())
        assert slow.writer.output.lost > 50 or slow.queuer.dropped > 50
    disk.full = False
    disk.goes_on.set()
    slow.close()
    lost = slow.queuer.dropped + slow.writer.output.lost
    assert sum(told_missing(disk.getvalue())) == lost
