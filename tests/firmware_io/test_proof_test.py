"""What a driver proves of itself, and the record that ``haptix doctor --proof-test`` keeps."""

import ctypes
import json
import mmap
import os
import sys

import numpy as np
import pytest
from typer.testing import CliRunner

from firmware_io import MockDriver, MockLink
from firmware_io.clock import SteppedClock
from firmware_io.firmware.core import compiled
from firmware_io.proof_test import proof_test
from haptix.tasks.cli.application import app


@pytest.mark.parametrize("full_scale_v", [20.0, 150.0, 200.0, 250.0, 1000.0])
def test_each_limit_trips_without_a_volt(full_scale_v):
    driver = MockDriver(pace="stepped", tests_itself=True, full_scale_v=full_scale_v)
    proofs = {proof.what: proof for proof in proof_test(MockLink(driver), driver.clock)}
    assert len(proofs) == 9
    assert all(proof.holds for proof in proofs.values()), proofs
    seen = [proof.seen.split(",")[0] for what, proof in proofs.items() if "ends" in what]
    assert seen == ["CEILING", "SLEW", "SEQUENCE", "SAMPLE_INDEX", "DAMAGED", "STARVED"]
    assert not driver.output[0].any()
    assert not driver.is_armed


class DeafDriver(MockDriver):
    def receive(self, data):
        """Hear nothing."""


def test_a_driver_that_answers_nothing_is_told_of():
    driver = DeafDriver(pace="stepped")
    (proof,) = proof_test(MockLink(driver), driver.clock)
    assert not proof.holds


def test_the_command_writes_a_dated_record(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(app, ["doctor", "--proof-test", "mock:"])
    assert done.exit_code == 0, done.output
    (path,) = tmp_path.glob("proof-test-*.json")
    record = json.loads(path.read_text())
    assert record["driver"] == "mock:"
    assert record["date"][:4] in path.name
    assert [row["ok"] for row in record["proofs"]] == ["yes"] * 9


@pytest.mark.parametrize(
    ("amplifier", "stays"),
    [
        (lambda codes: codes, True),
        (lambda codes: codes + np.int16(2900), True),
        (lambda codes: codes + np.int16(3100), False),
        (lambda codes: np.zeros_like(codes), True),
    ],
    ids=["as sent", "within the tolerance", "an offset", "dead, at 0 V"],
)
def test_an_output_that_is_not_what_was_sent_takes_the_enable_down(amplifier, stays):
    driver = MockDriver(pace="stepped")
    driver.amplifier = amplifier
    assert isinstance(driver.clock, SteppedClock)
    driver.clock.sleep(0.01)
    assert driver.output[0].size
    assert driver.core.is_whole is stays
    assert not driver.output[0].any()


@pytest.mark.skipif(sys.platform != "linux", reason="maps one page twice, by Linux's calls")
def test_memory_whose_words_are_the_same_does_not_pass():
    """As with a broken line of addresses: what is written to one word is read from another."""
    ffi, firmware = compiled()
    libc = ctypes.CDLL(None, use_errno=True)
    libc.mmap.restype = ctypes.c_void_p
    libc.mmap.argtypes = [ctypes.c_void_p, ctypes.c_size_t, *[ctypes.c_int] * 3, ctypes.c_long]
    both, page = mmap.PROT_READ | mmap.PROT_WRITE, mmap.PAGESIZE
    file = os.memfd_create("page")
    os.ftruncate(file, page)
    at = libc.mmap(None, 2 * page, both, mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS, -1, 0)
    assert firmware.hx_test_memory(ffi.cast("void *", at), 2 * page) == 1
    for place in (at, at + page):
        assert libc.mmap(place, page, both, mmap.MAP_SHARED | 0x10, file, 0) == place
    assert firmware.hx_test_memory(ffi.cast("void *", at), page) == 1
    assert firmware.hx_test_memory(ffi.cast("void *", at), 2 * page) == 0
    libc.munmap(ctypes.c_void_p(at), ctypes.c_size_t(2 * page))
    os.close(file)
