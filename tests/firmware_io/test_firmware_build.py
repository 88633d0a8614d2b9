"""The firmware as C: strict compilers, sanitizers, a microcontroller."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

import firmware_io
from firmware_io import ABSOLUTE_CEILING_V
from firmware_io.protocol import FaultCode, FrameKind
from tests.firmware_io.oracle import board
from tests.firmware_io.oracle.sine import TURN, c_header, sine_table

FIRMWARE = Path(firmware_io.__file__).parent / "firmware"
CHECKS = Path(__file__).parent / "firmware"


def need(*commands):
    for command in commands:
        if shutil.which(command) is None:
            pytest.skip(f"{command} is missing")


def make(tmp_path, target, *values):
    return subprocess.run(
        ["make", "-C", CHECKS, f"BUILD={tmp_path}", *values, target],
        capture_output=True,
        text=True,
        timeout=600,
    )


@pytest.mark.slow
def test_strict_compilation_and_sanitizers(tmp_path):
    need("make", "cc")
    done = make(tmp_path, "check")
    if "cannot find" in done.stderr and "san" in done.stderr:
        pytest.skip("the compiler has no sanitizers (on Debian: apt install libasan8 libubsan1)")
    assert done.returncode == 0, done.stderr
    for flag in ("-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "address,undefined"):
        assert flag in done.stdout
    assert "No output above the ceiling" in done.stdout


def test_a_failure_at_every_step_and_flipped_bits_end_at_0_v(tmp_path):
    need("make", "cc")
    done = make(tmp_path, "faults", "SESSIONS=10", "FLIPS=20000")
    assert done.returncode == 0, done.stdout + done.stderr
    assert len(re.findall(r" [1-9]\d* well, 0 badly", done.stdout)) == 7
    assert re.search(r" [1-9]\d* at 0 V within 15 ms, [1-9]\d* within limits, 0 esc", done.stdout)


@pytest.mark.slow  # the solver takes more than a minute
def test_what_the_contracts_of_the_limiter_say_is_proven(tmp_path):
    need("make", "frama-c", "why3", "z3")
    done = make(tmp_path, "prove")
    assert done.returncode == 0, done.stdout + done.stderr


def test_it_fits_a_microcontroller(tmp_path):
    need("make", "arm-none-eabi-gcc")
    done = make(tmp_path, "cortex-m")
    assert done.returncode == 0, done.stderr
    text, data, bss = map(
        int, re.search(r"(\d+)\s+(\d+)\s+(\d+)\s+\d+\s+\w+\s+\(TOTALS\)", done.stdout).groups()
    )
    # The smallest boards in question have 64 KB of flash and 16 KB of RAM.
    assert text < 18_000  # 4.4 KB of it for a converter of the current
    assert data == 0
    assert bss < 9_000  # 0.7 KB of it for the converter and readings that wait


def test_no_call_leaves_the_core(tmp_path):
    """No allocation, no operating system: only the compiler's own arithmetic is missing."""
    need("make", "arm-none-eabi-gcc", "arm-none-eabi-nm")
    assert make(tmp_path, "cortex-m").returncode == 0
    names = subprocess.run(
        ["arm-none-eabi-nm", "-u", *sorted(tmp_path.glob("haptix_*.o"))],
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    missing = set(re.findall(r" U (\S+)", names))
    compilers_own = re.compile(r"__aeabi_|__gnu_thumb1_case_|mem(cpy|set|move)$")
    assert {name for name in missing if not name.startswith("hx_")} == {
        name for name in missing if compilers_own.match(name)
    }


def test_the_sine_table_in_c_is_the_oracles():
    assert (FIRMWARE / "haptix_sine.h").read_text() == c_header()
    table = sine_table()
    assert table[: TURN // 2] == [-value for value in table[TURN // 2 : TURN]]
    assert (table[0], table[TURN // 4], table[TURN]) == (0, 32767, 0)


@pytest.mark.parametrize("name", ["RAMP_MS", "MIN_WATCHDOG_MS", "PAUSE_MS", "ABSOLUTE_CEILING_MV"])
def test_the_oracle_has_the_constants_of_the_firmware(name):
    header = (FIRMWARE / "haptix_device.h").read_text()
    assert f"#define HX_{name} {getattr(board, name)}u" in header


def test_no_limit_of_the_firmware_is_above_the_hosts():
    assert board.ABSOLUTE_CEILING_MV == ABSOLUTE_CEILING_V * 1e3


def test_the_kinds_and_faults_in_c_are_those_of_the_protocol():
    header = (FIRMWARE / "haptix_wire.h").read_text()
    for kind in FrameKind:
        assert f"HX_{kind.name} = {kind.value:#04x}" in header
    for code in FaultCode:
        assert f"HX_FAULT_{code.name} = {code.value}" in header
