"""The golden sessions on other processors: 16, 32 and 64 bits, either byte order, emulated."""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import firmware_io
from c_libraries import LIBRARIES

ROOM = Path(firmware_io.__file__).parent
SOURCES = [
    ROOM / "firmware" / name
    for name in LIBRARIES["haptix-firmware"].sources
    if name != "haptix_host.c"
]
HERE = Path(__file__).parent
TARGETS, BOARD = HERE / "targets", HERE / "cortex_m"
PICO = ROOM.parent / "examples" / "boards" / "pico"
SESSIONS = sorted((ROOM / "golden").glob("session-*.json"))
#: What the host's library does not do alike by itself; the others play on each target if asked for.
QUICK = ("session-edges", "session-revise", "session-sense")

ZIG = (sys.executable, "-m", "ziglang", "cc", "-std=gnu99", "-Wall", "-Werror", "-Os")
CORTEX = (
    *("arm-none-eabi-gcc", "-std=gnu99", "-Wall", "-Werror", "-Os", "-ffreestanding", "-mthumb"),
    *("-nostdlib", "-T", str(BOARD / "board.ld")),
)
ON_CORTEX = (
    *("qemu-system-arm", "-M", "mps2-an385", "-nographic", "-monitor", "none", "-serial", "none"),
    *("-semihosting-config", "enable=on,target=native", "-kernel"),
)
CHIP = (
    *("arm-none-eabi-gcc", "-std=gnu99", "-Wall", "-Werror", "-Os", "-ffreestanding", "-mthumb"),
    *("-nostdlib", "-T", str(PICO / "pico.ld"), str(PICO / "boot.S")),
)
SESSION = str(HERE / "pico" / "session.mjs")
WASI = """
import { readFileSync } from "node:fs";
import { WASI } from "node:wasi";
const wasi = new WASI({ version: "preview1", returnOnExit: true });
const module = await WebAssembly.compile(readFileSync(process.argv[1]));
process.exitCode = wasi.start(await WebAssembly.instantiate(module, wasi.getImportObject()));
"""
#: Folder of its start, compiler, what runs the program, and the Debian packages of both.
PROCESSORS: dict[str, tuple[str, tuple[str, ...], tuple[str, ...]]] = {
    "cortex-m3": ("cortex_m", (*CORTEX, "-mcpu=cortex-m3"), ON_CORTEX),
    "cortex-m0plus": ("cortex_m", (*CORTEX, "-mcpu=cortex-m0plus"), ON_CORTEX),
    "rp2040": ("pico", (*CHIP, "-mcpu=cortex-m0plus"), ("node", SESSION, "rp2040")),
    "rp2350": ("pico", (*CHIP, "-mcpu=cortex-m33"), ("node", SESSION, "rp2350")),
    "avr": (
        "avr",
        (
            *("avr-gcc", "-std=gnu99", "-Wall", "-Werror", "-Waddr-space-convert", "-Os"),
            "-mmcu=atmega1284p",
        ),
        ("simavr", "-m", "atmega1284p", "-f", "20000000"),
    ),
    "s390x": ("hosted", (*ZIG, "-target", "s390x-linux-musl", "-static"), ("qemu-s390x",)),
    "wasm32": (
        "hosted",
        (*ZIG, "-target", "wasm32-wasi"),
        ("node", "--no-warnings", "--input-type=module", "-e", WASI, "--"),
    ),
}
PACKAGES = {
    "arm-none-eabi-gcc": "gcc-arm-none-eabi",
    "qemu-system-arm": "qemu-system-arm",
    "avr-gcc": "gcc-avr avr-libc",
    "simavr": "simavr",
    "qemu-s390x": "qemu-user",
    "node": "nodejs",
}


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
        "typedef struct { step_kind kind; uint32_t count; const FAR uint8_t *bytes;"
        " const FAR int16_t *codes; } step;",
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
        lines.append(
            f"static const FAR {of} d{number}[] = {{{', '.join(map(str, values or [0]))}}};"
        )
        steps.append(f"{{{kind.upper()}, {len(values)}, {place.format(number)}}}")
    lines.append(f"static const FAR step steps[] = {{{', '.join(steps)}}};")
    lines.append(f"static const uint32_t count_of_steps = {len(steps)};")
    return "\n".join(lines) + "\n"


def needs(*commands):
    for command in commands:
        if command in PACKAGES and shutil.which(command) is None:
            pytest.skip(f"{command} is missing (apt install {PACKAGES[command]})")


@pytest.fixture(scope="module")
def objects_of(tmp_path_factory):
    """A function that compiles the core for a processor, once: all boards have the same queue."""
    made = {}

    def objects_of(processor, sizes):
        if (processor, *sizes) not in made:
            compiler = PROCESSORS[processor][1]
            folder = tmp_path_factory.mktemp(processor)
            # What is for the linker is not used here, and zig takes one file at a time.
            command = [*compiler, "-Wno-unused-command-line-argument", *sizes]
            command += [f"-I{ROOM / 'firmware'}", "-c"]
            for path in SOURCES:
                subprocess.run([*command, path], check=True, cwd=folder)
            made[processor, *sizes] = [folder / f"{path.stem}.o" for path in SOURCES]
        return made[processor, *sizes]

    return objects_of


def run(tmp_path, objects_of, session, processor):
    """What the program of a processor prints at its end."""
    folder, compiler, runner = PROCESSORS[processor]
    needs(compiler[0], runner[0])
    if processor == "rp2040" and not (HERE / "pico" / "node_modules").exists():
        pytest.skip("rp2040js is missing (bash scripts/setup-devices.sh)")
    (tmp_path / "session.h").write_text(c_header(session))
    program = tmp_path / "program.elf"
    sizes = [
        f"-DHX_{name.upper()}={session['board'][name]}u"
        for name in ("queue_samples", "max_frame_samples")
    ]
    subprocess.run(
        [
            *(*compiler, *sizes, f"-I{ROOM / 'firmware'}"),
            *(f"-I{tmp_path}", f"-I{TARGETS / folder}"),
            *(TARGETS / "session.c", *objects_of(processor, sizes)),
            *(("-lgcc",) if "-nostdlib" in compiler else ()),
            *("-o", program),
        ],
        check=True,
    )
    done = subprocess.run([*runner, program], capture_output=True, text=True, timeout=600)
    return re.sub(r"\x1b\[\d*m|\.*$", "", done.stdout + done.stderr, flags=re.MULTILINE)


def quick_or_slow(processor, path):
    """The others play on this machine's processor in test_conformance.py."""
    is_quick = path.stem in QUICK and processor in ("cortex-m3", "avr")
    marks = () if is_quick else pytest.mark.slow
    return pytest.param(processor, path, id=f"{processor}-{path.stem}", marks=marks)


@pytest.mark.parametrize(
    ("processor", "path"),
    [quick_or_slow(processor, path) for processor in PROCESSORS for path in SESSIONS],
)
def test_a_processor_plays_the_golden_sessions(tmp_path, objects_of, processor, path):
    said = run(tmp_path, objects_of, json.loads(path.read_text()), processor)
    assert said.strip().endswith("as golden")


@pytest.mark.parametrize(
    "processor",
    [
        pytest.param(name, marks=() if name in ("cortex-m3", "avr") else pytest.mark.slow)
        for name in ("cortex-m3", "avr", "rp2040", "rp2350", "s390x", "wasm32")
    ],
)
def test_a_wrong_sample_would_be_seen(tmp_path, objects_of, processor):
    session = json.loads(SESSIONS[0].read_text())
    played = next(step["play"] for step in reversed(session["steps"]) if "play" in step)
    played[-1] += 1
    assert run(tmp_path, objects_of, session, processor).strip().endswith("other samples")


def go_bad(tmp_path, *settings):
    """Failures at every step of a session, and flipped bits, in the memory of the board."""
    needs("arm-none-eabi-gcc", "qemu-system-arm")
    make = ("make", "-C", str(HERE / "firmware"), "faults-cortex-m", f"BUILD={tmp_path}")
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
