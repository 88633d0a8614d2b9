"""Code, stack and cycles of each function of the firmware on a Cortex-M, against the last release.

    make size                     # needs gcc-arm-none-eabi and qemu-system-arm
    make size ARGS=--store        # with a release: what the next ones are compared with

Compiled with -Os for the Cortex-M0+. Stack is that of the function alone (gcc's -fstack-usage).
Cycles are those that the function alone takes while `count.c` plays 5 ms of a waveform and of an
envelope, takes in four revisions and lets two blocks of the window end: qemu lists the instructions
that run, and each costs what ARM's Cortex-M0+ manual says (table 3-1, no wait states); 0 did not
run. What the compiler inlines counts where it stands. Below the table: flash and RAM of the boards'
whole firmware, each built by its own Makefile.
"""

import argparse
import json
import re
import subprocess
import tempfile
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).parent.parent
CORE = ROOT / "firmware_io" / "firmware"
BOARD = ROOT / "tests" / "firmware_io" / "cortex_m"
STORED = Path(__file__).with_suffix(".json")
FLAGS = (
    *("-std=gnu99", "-Os", "-ffreestanding", "-nostdlib", "-mcpu=cortex-m0plus", "-mthumb"),
    *("-DHX_QUEUE_SAMPLES=2048u", "-DHX_MAX_FRAME_SAMPLES=512u"),
)
#: Of each board its folder and its program.
BOARDS = {
    "pico": ("pico", "pico.elf"),
    "pico2": ("pico", "pico2.elf"),
    "stm32f405": ("stm32f405", "board.elf"),
}
COLUMNS = ("code bytes", "stack bytes", "cycles")


def said(*command: object) -> str:
    """Return what a command writes."""
    words = [str(word) for word in command]
    return subprocess.run(words, capture_output=True, text=True, check=True, timeout=300).stdout


def cycles_of(instruction: str, operands: str) -> int:
    """Return the cycles of an instruction, of a branch as if it were taken."""
    if instruction.startswith(("push", "pop", "stm", "ldm")):
        count = 1 + operands.count(",") - (0 if instruction.startswith(("push", "pop")) else 1)
        count += sum(
            int(last) - int(first) for first, last in re.findall(r"r(\d+)-r(\d+)", operands)
        )
        return 1 + count + (2 if "pc" in operands else 0)
    if instruction.startswith("bl"):
        return 3
    # Loads and stores, and branches but not bics and bkpt.
    is_branch = re.fullmatch(r"b(x|[a-z]{2})?(\.n)?", instruction) is not None
    return 2 if is_branch or instruction.startswith(("ldr", "str")) else 1


def measure(core: Path, folder: Path) -> dict[str, dict[str, int]]:
    """Return the columns of each function of the core's sources in a folder."""
    objects = []
    found: dict[str, dict[str, int]] = {}
    for source in sorted(core.glob("haptix_*.c")):
        if source.stem == "haptix_host":
            continue
        objects.append(folder / f"{source.stem}.o")
        said("arm-none-eabi-gcc", *FLAGS, "-fstack-usage", "-c", source, "-o", objects[-1])
        for line in objects[-1].with_suffix(".su").read_text().splitlines():
            place, stack, _ = line.split("\t")
            found[place.rsplit(":", 1)[1].split(".")[0]] = {"stack bytes": int(stack)}
    program, trace = folder / "count.elf", folder / "trace"
    said(
        *("arm-none-eabi-gcc", *FLAGS, f"-I{core}", "-T", BOARD / "board.ld", BOARD / "count.c"),
        *(*objects, "-lgcc", "-o", program),
    )
    begins: list[tuple[int, int, str]] = []
    for line in said("arm-none-eabi-nm", "-S", program).splitlines():
        match line.split():
            case [begin, size, "t" | "T", name] if name.split(".")[0] in found:
                row = found[name.split(".")[0]]
                row["code bytes"] = row.get("code bytes", 0) + int(size, 16)
                begins.append((int(begin, 16), int(size, 16), name.split(".")[0]))
    costs = {}
    for line in said("arm-none-eabi-objdump", "-d", "--no-show-raw-insn", program).splitlines():
        if match := re.match(r"\s+([0-9a-f]+):\t(\S+)\s*([^;]*)", line):
            costs[int(match[1], 16)] = cycles_of(match[2], match[3])
    said(
        *("qemu-system-arm", "-M", "mps2-an385", "-nographic", "-monitor", "none", "-serial"),
        *("none", "-semihosting-config", "enable=on,target=native", "-kernel", program),
        *("-singlestep", "-d", "exec,nochain", "-D", trace),
    )
    runs = Counter(re.findall(r"/([0-9a-f]{8})/", trace.read_text()))
    for first, length, name in begins:
        spent = sum(
            costs.get(int(at, 16), 1) * count
            for at, count in runs.items()
            if first <= int(at, 16) < first + length
        )
        found[name]["cycles"] = found[name].get("cycles", 0) + spent
    return {name: row for name, row in found.items() if "code bytes" in row}


def measure_board(name: str, folder: Path) -> tuple[int, int]:
    """Return the bytes of flash and of RAM, without the stack, of a board's firmware."""
    place, file = BOARDS[name]
    board, program = ROOT / "examples" / "boards" / place, folder / file
    said("make", "-s", "-C", board, f"BOARD={name}", f"BUILD={folder}", program)
    text, data, bss = map(int, said("arm-none-eabi-size", program).splitlines()[1].split()[:3])
    return text + data, data + bss


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--core", type=Path, default=CORE)
    parser.add_argument("--store", action="store_true")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        rows = measure(options.core.resolve(), Path(folder))
        boards = {name: measure_board(name, Path(folder)) for name in BOARDS}
    version = re.search(r'= "(.+)"', (ROOT / "haptix" / "base" / "version.py").read_text())
    assert version is not None
    if options.store:
        stored = {"release": version[1], "functions": dict(sorted(rows.items()))}
        STORED.write_text(json.dumps(stored, indent=1) + "\n")
    stored = json.loads(STORED.read_text())
    before = stored["functions"]
    print(f"{'':24}" + "".join(f"{name:>20}" for name in COLUMNS) + f"   since {stored['release']}")
    total = Counter[str]()
    for name in sorted(
        rows.keys() | before.keys(), key=lambda n: -rows.get(n, {}).get("cycles", 0)
    ):
        print(f"{name:24}", end="")
        for column in COLUMNS:
            now, then = rows.get(name, {}).get(column, 0), before.get(name, {}).get(column, 0)
            total.update({column: now, f"{column} then": then})
            print(f"{now:12}{now - then:+8d}" if now != then else f"{now:12}{'':8}", end="")
        print()
    print(f"{'all':24}", end="")
    for column in ("code bytes", "cycles"):
        gap = 0 if column == "code bytes" else 20
        print(f"{'':{gap}}{total[column]:12}{total[column] - total[f'{column} then']:+8d}", end="")
    print(f"\n\n{'':24}{'flash bytes':>20}{'RAM bytes':>20}")
    for name, (flash, ram) in boards.items():
        print(f"{name:24}{flash:20}{ram:20}")


if __name__ == "__main__":
    main()
