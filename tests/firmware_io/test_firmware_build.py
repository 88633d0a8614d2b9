"""The firmware as C: strict compilers, sanitizers, a microcontroller, no compiler at all."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import firmware_io
from firmware_io import ABSOLUTE_CEILING_V, DeviceError, MockDriver
from firmware_io.firmware import build, flags, reference_board
from firmware_io.firmware.opening import open_core
from firmware_io.firmware.sine import TURN, c_header, sine_table
from firmware_io.protocol import FaultCode, FrameKind

FIRMWARE = Path(firmware_io.__file__).parent / "firmware"


def need(*commands):
    for command in commands:
        if shutil.which(command) is None:
            pytest.skip(f"{command} is missing")


def make(tmp_path, target):
    return subprocess.run(
        ["make", "-C", FIRMWARE, f"BUILD={tmp_path}", target],
        capture_output=True,
        text=True,
        timeout=600,
    )


def test_strict_compilation_and_sanitizers(tmp_path):
    need("make", "cc")
    done = make(tmp_path, "check")
    if "cannot find" in done.stderr and "san" in done.stderr:
        pytest.skip("the compiler has no sanitizers (on Debian: apt install libasan8 libubsan1)")
    assert done.returncode == 0, done.stderr
    for flag in ("-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "address,undefined"):
        assert flag in done.stdout
    assert "no output above the ceiling" in done.stdout


def test_it_fits_a_microcontroller(tmp_path):
    need("make", "arm-none-eabi-gcc")
    done = make(tmp_path, "cortex-m")
    assert done.returncode == 0, done.stderr
    text, data, bss = map(
        int, re.search(r"(\d+)\s+(\d+)\s+(\d+)\s+\d+\s+\w+\s+\(TOTALS\)", done.stdout).groups()
    )
    # The smallest boards in question have 64 KB of flash and 16 KB of RAM.
    assert text < 16_000
    assert data == 0
    assert bss < 8_500


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


def test_the_sine_table_in_c_is_the_references():
    assert (FIRMWARE / "haptix_sine.h").read_text() == c_header()
    table = sine_table()
    assert table[: TURN // 2] == [-value for value in table[TURN // 2 : TURN]]
    assert (table[0], table[TURN // 4], table[TURN]) == (0, 32767, 0)


def test_everything_the_build_needs_is_in_the_package():
    for name in (*flags.SOURCES, *flags.HOST_SOURCES, *build.HEADERS):
        assert (FIRMWARE / name).is_file()


@pytest.fixture
def no_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path


def test_the_library_is_built_once(no_cache):
    if build.find_compiler() is None:
        pytest.skip("no C compiler: $CC, cc, gcc and clang are missing")
    path = build.library()
    assert path.parent == no_cache / "haptix"
    built = path.stat().st_mtime_ns
    assert build.library() == path
    assert path.stat().st_mtime_ns == built
    assert {entry.name for entry in path.parent.iterdir()} == {path.name, f"{path.stem}.sha256"}


def test_without_a_compiler_the_reference_plays(no_cache, monkeypatch):
    monkeypatch.setenv("PATH", str(no_cache))
    monkeypatch.delenv("CC", raising=False)
    assert MockDriver().core == "python"
    with pytest.raises(DeviceError, match=r"needs a C compiler.*apt install gcc"):
        build.library()


def test_a_wheel_of_a_platform_needs_neither_a_compiler_nor_the_reference(no_cache, monkeypatch):
    need("cc")
    built = build.library().read_bytes()
    monkeypatch.setattr(build, "SOURCE_DIR", no_cache)
    (no_cache / "haptix-firmware.so").write_bytes(built)
    monkeypatch.setenv("PATH", str(no_cache / "nothing"))
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setitem(sys.modules, "firmware_io.firmware.reference", None)  # as if not there
    assert build.library() == no_cache / "haptix-firmware.so"
    assert MockDriver().core == "c"
    with pytest.raises(DeviceError, match=r"py3-none-any\.whl"):
        MockDriver(core="python")


def test_a_compiler_that_fails_is_told_and_not_hidden(no_cache, monkeypatch):
    need("false")
    monkeypatch.setenv("CC", "false")
    with pytest.raises(DeviceError, match="false could not compile the firmware"):
        build.library()
    assert list((no_cache / "haptix").iterdir()) == []


def test_a_full_disk_is_told_by_its_folder(no_cache, monkeypatch):
    def fill_up(*arguments, **options):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(build, "find_compiler", lambda: ["cc"])
    monkeypatch.setattr("tempfile.TemporaryDirectory", fill_up)
    with pytest.raises(DeviceError, match=r"in /.*: No space left on device\. Make room"):
        build.library()


def test_the_core_can_be_chosen():
    about = MockDriver(core="python").about
    assert open_core(about, "python").name == "python"
    if build.find_compiler() is not None:
        assert open_core(about, "c").name == "c"
        assert MockDriver().core == "c"


@pytest.mark.parametrize("name", ["RAMP_MS", "MIN_WATCHDOG_MS", "PAUSE_MS", "ABSOLUTE_CEILING_MV"])
def test_the_reference_has_the_constants_of_the_firmware(name):
    header = (FIRMWARE / "haptix_device.h").read_text()
    assert f"#define HX_{name} {getattr(reference_board, name)}u" in header


def test_no_limit_of_the_firmware_is_above_the_hosts():
    assert reference_board.ABSOLUTE_CEILING_MV == ABSOLUTE_CEILING_V * 1e3


def test_the_kinds_and_faults_in_c_are_those_of_the_protocol():
    header = (FIRMWARE / "haptix_wire.h").read_text()
    for kind in FrameKind:
        assert f"HX_{kind.name} = {kind.value:#04x}" in header
    for code in FaultCode:
        assert f"HX_FAULT_{code.name} = {code.value}" in header
