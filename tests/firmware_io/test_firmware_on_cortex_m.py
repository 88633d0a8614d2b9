"""The firmware as it would run on a board: the golden sessions on an emulated Cortex-M3."""

import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest

import firmware_io
from c_libraries import LIBRARIES

SOURCES = LIBRARIES["haptix-firmware"].sources
ROOM = Path(firmware_io.__file__).parent
BOARD = Path(__file__).parent / "cortex_m"
SESSIONS = sorted((ROOM / "golden").glob("session-*.json"))
QUICK = ("session-edges", "session-revise", "session-sense")


def c_header(session):
    """The session as C: a configuration and an array of steps."""
    board = session["board"]
    numbers = (
        *("output_rate_hz", "full_scale_mv", "ceiling_mv", "max_slew_v_per_s", "queue_samples"),
        *("max_frame_samples", "max_watchdog_ms", "report_bytes"),
    )
    rates = ", ".join(f"{{{rate}, {sum(1 << m for m in modes)}}}" for rate, modes in board["rates"])
    texts = ", ".join(f'"{board[name]}"' for name in ("name", "serial", "calibration_id"))
    sensor = ", ".join(map(str, session.get("sensor", {"": 0, " ": 0}).values()))
    lines = [
        "typedef enum { RECEIVE, REPORT, TRANSMIT, PLAY, SENSE } step_kind;",
        "typedef struct { step_kind kind; uint32_t count; const uint8_t *bytes;"
        " const int16_t *codes; } step;",
        f"static const hx_config config = {{{', '.join(str(board[n]) for n in numbers)},"
        f" {board['reports_touch'] | board.get('takes_marks', False) << 1},"
        f" {len(board['rates'])}, {{{rates}}}, {texts},"
        f" {board['guard_ticks']}, {board.get('sense_rate_hz', 0)}, {sensor}}};",
    ]
    steps = []
    for number, step in enumerate(session["steps"]):
        ((kind, content),) = step.items()
        if kind in ("play", "sense"):
            values, of, place = content, "int16_t", "0, d{}"
        else:
            values, of, place = list(bytes.fromhex(content)), "uint8_t", "d{}, 0"
        # C has no empty arrays.
        lines.append(f"static const {of} d{number}[] = {{{', '.join(map(str, values or [0]))}}};")
        steps.append(f"{{{kind.upper()}, {len(values)}, {place.format(number)}}}")
    lines.append(f"static const step steps[] = {{{', '.join(steps)}}};")
    lines.append(f"static const uint32_t count_of_steps = {len(steps)};")
    return "\n".join(lines) + "\n"


def needs_a_board():
    for command in ("arm-none-eabi-gcc", "qemu-system-arm"):
        if shutil.which(command) is None:
            pytest.skip(f"{command} is missing (apt install gcc-arm-none-eabi qemu-system-arm)")


def run(tmp_path, session):
    needs_a_board()
    (tmp_path / "session.h").write_text(c_header(session))
    program = tmp_path / "board.elf"
    subprocess.run(
        [
            *("arm-none-eabi-gcc", "-std=gnu99", "-Wall", "-Werror", "-Os", "-ffreestanding"),
            *("-mcpu=cortex-m3", "-mthumb", "-nostdlib", "-DHX_QUEUE_SAMPLES=2048u"),
            *("-DHX_MAX_FRAME_SAMPLES=512u", f"-I{ROOM / 'firmware'}", f"-I{tmp_path}"),
            *("-T", BOARD / "board.ld", BOARD / "session.c"),
            *(ROOM / "firmware" / name for name in SOURCES if name != "haptix_host.c"),
            *("-lgcc", "-o", program),
        ],
        check=True,
    )
    return subprocess.run(
        [
            *("qemu-system-arm", "-M", "mps2-an385", "-nographic", "-monitor", "none"),
            *("-serial", "none", "-semihosting-config", "enable=on,target=native"),
            *("-kernel", program),
        ],
        capture_output=True,
        text=True,
        timeout=600,
    )


@pytest.mark.parametrize(
    "path",
    [  # the others play on this machine's processor in test_conformance.py
        pytest.param(path, id=path.stem, marks=() if path.stem in QUICK else pytest.mark.slow)
        for path in SESSIONS
    ],
)
def test_a_microcontroller_plays_the_golden_sessions(tmp_path, path):
    done = run(tmp_path, json.loads(path.read_text()))
    assert (done.returncode, done.stdout + done.stderr) == (0, "as golden\n")


def test_a_wrong_sample_would_be_seen(tmp_path):
    session = json.loads(SESSIONS[0].read_text())
    played = next(step["play"] for step in reversed(session["steps"]) if "play" in step)
    played[-1] += 1
    done = run(tmp_path, session)
    assert (done.returncode, done.stdout + done.stderr) == (1, "other samples\n")


def go_bad(tmp_path, *settings):
    """Failures at every step of a session, and flipped bits, in the memory of the board."""
    needs_a_board()
    make = ("make", "-C", str(BOARD.parent / "firmware"), "faults-cortex-m", f"BUILD={tmp_path}")
    return subprocess.run([*make, *settings], capture_output=True, text=True, timeout=600)


def test_what_goes_bad_in_a_board_s_memory_ends_at_0_v(tmp_path):
    done = go_bad(tmp_path, "EMULATED_SESSIONS=1", "EMULATED_FLIPS=2000")
    assert done.returncode == 0, done.stdout + done.stderr
    assert " 0 badly;" in done.stderr and " 0 escaped" in done.stderr


def test_a_core_that_trusts_its_memory_would_be_seen(tmp_path):
    core = shutil.copytree(ROOM / "firmware", tmp_path / "core")
    seal = (core / "haptix_seal.c").read_text()
    assert seal.count(" && seal_of(d) == d->seal") == 1
    (core / "haptix_seal.c").write_text(seal.replace(" && seal_of(d) == d->seal", ""))
    done = go_bad(tmp_path, "EMULATED_SESSIONS=1", "EMULATED_FLIPS=2000", f"CORE={core}")
    assert done.returncode != 0
    assert re.search(r" [1-9]\d* escaped|a hard fault", done.stderr), done.stderr
