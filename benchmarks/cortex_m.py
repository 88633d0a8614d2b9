"""What the firmware costs on a Cortex-M0+: flash, RAM, instructions for each output sample.

    python benchmarks/cortex_m.py        # needs gcc-arm-none-eabi and qemu-system-arm

Compiled with -Os for the Cortex-M0+ and run on the Cortex-M3 that qemu emulates, which takes the
same instructions; qemu counts them. A real M0+ needs a third more cycles than instructions,
and no more than twice as many: 2 for a load, a store or a taken branch, 1 for the rest (ARM's
Cortex-M0+ manual, table 3-1). No division is in a revision.
"""

import subprocess
import tempfile
from pathlib import Path

ROOT = Path(__file__).parent.parent
SOURCE_DIR = ROOT / "firmware_io" / "firmware"
CHECKS = ROOT / "tests" / "firmware_io"
BOARD = CHECKS / "cortex_m"
SIZES = ("-DHX_QUEUE_SAMPLES=2048u", "-DHX_MAX_FRAME_SAMPLES=512u")


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        sizes = subprocess.run(
            ["make", "-s", "-C", CHECKS / "firmware", f"BUILD={folder}", "cortex-m"],
            capture_output=True,
            text=True,
            check=True,
        ).stdout.splitlines()[-1]
        print(f"flash {sizes.split()[0]} bytes, RAM {sizes.split()[2]} bytes (2048 samples queued)")
        program = Path(folder) / "count.elf"
        subprocess.run(
            [
                *("arm-none-eabi-gcc", "-std=gnu99", "-Os", "-ffreestanding", "-nostdlib"),
                *("-mcpu=cortex-m0plus", "-mthumb", *SIZES, f"-I{SOURCE_DIR}"),
                *("-T", BOARD / "board.ld", BOARD / "count.c"),
                *(path for path in SOURCE_DIR.glob("*.c") if path.name != "haptix_host.c"),
                *("-lgcc", "-o", program),
            ],
            check=True,
        )
        done = subprocess.run(
            [
                *("qemu-system-arm", "-M", "mps2-an385", "-nographic", "-monitor", "none"),
                *("-serial", "none", "-icount", "shift=0", "-kernel", program),
                *("-semihosting-config", "enable=on,target=native"),
            ],
            capture_output=True,
            text=True,
            check=True,
            timeout=60,
        )
    print("instructions for each output sample, and millions a second at 48 kHz")
    for line in (done.stdout + done.stderr).splitlines():
        what, count = line.rsplit(" ", 1)
        if "revise" in what:
            print(f"{what:20}{int(count):6}   the longest call, for each sample of it or besides")
            continue
        print(f"{what:20}{int(count):6}{int(count) * 48e3 / 1e6:8.1f}")


if __name__ == "__main__":
    main()
