"""What an engine of programs of a touch costs on a Cortex-M4F and M7: flash, RAM, instructions.

    python benchmarks/engine_board.py        # needs ziglang, gcc-arm-none-eabi, qemu-system-arm

One finger, blocks of 1 ms, 8 reports kept. qemu counts the instructions of a block that plays a
finger at 80 mm/s, without the cycles that flash and branches add. The M4F has no unit for double
precision, the M7 has one. Flash is the code with its `math.h`, and the program; RAM is the engine's
memory. All layouts of the gallery are played by the M7, those of --on-both by the M4F too.
"""

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

import haptix
from haptix.feel.gallery import presets
from haptix.play import compile_touch

ROOT = Path(__file__).parent.parent
NATIVE = ROOT / "haptix" / "base" / "native"
BOARD = ROOT / "tests" / "firmware_io" / "cortex_m"
CORES = {
    "M4F": ("cortex_m4", "mps2-an386"),
    "M7": ("cortex_m7+fp_armv8d16", "mps2-an500"),  # with double precision, as of an STM32H7
}
ON_BOTH = ("fine-ribs", "button", "coin", "denim")
PROGRAM_AT = 0x200000  # as in engine.c
PARTS = {"192 kB": (192_000, 1_000_000), "1 MB": (1_000_000, 2_000_000)}  # RAM, flash
SMALL = ("-DHX_FINGERS=1", "-DHX_POINTS=12", "-DHX_REPORTS=8")


def built(core: str, folder: Path) -> Path:
    """Return the board's program."""
    script = (BOARD / "board.ld").read_text().replace("256K", "4M").replace(": 64K", ": 4M")
    (folder / "board.ld").write_text(script)
    of_hosts = ("haptix_contact", "haptix_surface", "haptix_live", "haptix_waves")
    sources = (path for path in NATIVE.glob("*.c") if path.stem not in of_hosts)
    program = folder / "engine.elf"
    flags = ("-target", "thumb-linux-musleabihf", f"-mcpu={core}", "-static", "-nostartfiles")
    subprocess.run(
        [
            *(sys.executable, "-m", "ziglang", "cc", *flags, "-O2", "-std=gnu99", *SMALL),
            *("-ffunction-sections", "-Wl,--gc-sections", f"-I{NATIVE}", f"-I{BOARD}"),
            *(str(path) for path in (BOARD / "engine.c", *sources)),
            *("-T", str(folder / "board.ld"), "-lm", "-o", str(program)),
        ],
        check=True,
        cwd=folder,
    )
    return program


def played(program: Path, touch: Path, machine: str) -> list[int]:
    """Return the engine's memory, its blocks with a finger, and the instructions of a block."""
    done = subprocess.run(
        [
            *("qemu-system-arm", "-M", machine, "-nographic", "-monitor", "none", "-serial"),
            *("none", "-icount", "shift=0", "-kernel", program),
            *("-semihosting-config", "enable=on,target=native"),
            *("-device", f"loader,file={touch},addr={PROGRAM_AT:#x},force-raw=on"),
        ],
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    if "refused" in done.stdout + done.stderr:
        return []
    return [int(line) for line in (done.stdout + done.stderr).split()]


def code_size(program: Path) -> int:
    sizes = subprocess.run(
        ["arm-none-eabi-size", program], capture_output=True, text=True, check=True
    )
    return int(sizes.stdout.splitlines()[1].split()[0])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--on-both", nargs="*", default=ON_BOTH)
    options = parser.parse_args()
    model = haptix.ContactModel(haptix.Finger(), haptix.Screen(), fidelity="closed-form")
    scene = {"normal_force_n": 0.5, "frequency_hz": 4000.0}
    surface = haptix.FrictionSurface.build(model, scene, 0.01)
    with haptix.open_device("mock:") as device:
        programs = {one.name: compile_touch(surface, one.material, device) for one in presets()}
    fitting = dict.fromkeys(PARTS, 0)
    for core, (cpu, machine) in CORES.items():
        with tempfile.TemporaryDirectory() as at:
            folder = Path(at)
            program = built(cpu, folder)
            code = code_size(program)
            for name in programs if core == "M7" else options.on_both:
                touch = folder / "touch.hxp"
                touch.write_bytes(programs[name])
                size = len(programs[name])
                answer = played(program, touch, machine)
                if not answer:
                    print(f"{name:18}{core:4} code {code} bytes, program {size:7}: too large")
                    continue
                room, fingers, count = answer
                for part, (ram, flash) in PARTS.items():
                    fitting[part] += core == "M7" and room < ram and code + size < flash
                print(
                    f"{name:18}{core:4} code {code} bytes, program {size:7}, RAM {room:8}, "
                    f"{count:7} instructions a block{'' if fingers > 100 else ' (no finger)'}",
                    flush=True,
                )
    for part, count in fitting.items():
        print(f"{count} of {len(programs)} fit a part with {part} of RAM")


if __name__ == "__main__":
    main()
