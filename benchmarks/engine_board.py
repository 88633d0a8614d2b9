"""What an engine of programs of a touch costs on a Cortex-M4F and M7: flash, RAM, instructions.

    python benchmarks/engine_board.py        # needs ziglang, gcc-arm-none-eabi, qemu-system-arm

One finger, blocks of 1 ms, 8 reports kept. qemu counts the instructions of a block that plays a
finger at 80 mm/s, without the cycles that flash and branches add. The M4F has no unit for double
precision. Flash is the code with its `math.h`, and the program; RAM is the engine's memory.
"""

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
CORES = {"M4F": ("cortex_m4", "mps2-an386"), "M7": ("cortex_m7", "mps2-an500")}
PLAYED = ("fine-ribs", "button")
SMALL = ("-DHX_FINGERS=1", "-DHX_POINTS=12", "-DHX_REPORTS=8")


def built(core: str, folder: Path) -> Path:
    """Return the board's program that plays touch.hxp of the folder."""
    script = (BOARD / "board.ld").read_text().replace("256K", "4M").replace(": 64K", ": 4M")
    (folder / "board.ld").write_text(script)
    sources = (path for path in NATIVE.glob("*.c") if path.stem != "haptix_surface")
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


def played(program: Path, machine: str) -> list[int]:
    """Return the engine's memory, its blocks with a finger, and the instructions of a block."""
    done = subprocess.run(
        [
            *("qemu-system-arm", "-M", machine, "-nographic", "-monitor", "none", "-serial"),
            *("none", "-icount", "shift=0", "-kernel", program),
            *("-semihosting-config", "enable=on,target=native"),
        ],
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
    )
    return [int(line) for line in (done.stdout + done.stderr).split()]


def main() -> None:
    model = haptix.ContactModel(haptix.Finger(), haptix.Screen(), fidelity="closed-form")
    scene = {"normal_force_n": 0.5, "frequency_hz": 4000.0}
    surface = haptix.FrictionSurface.build(model, scene, 0.01)
    with haptix.open_device("mock:") as device, tempfile.TemporaryDirectory() as at:
        folder = Path(at)
        programs = {one.name: compile_touch(surface, one.material, device) for one in presets()}
        for name in PLAYED:
            (folder / "touch.hxp").write_bytes(programs[name])
            for core, (cpu, machine) in CORES.items():
                program = built(cpu, folder)
                room, fingers, count = played(program, machine)
                sizes = subprocess.run(
                    ["arm-none-eabi-size", program], capture_output=True, text=True, check=True
                )
                text = int(sizes.stdout.splitlines()[1].split()[0])
                print(
                    f"{name:15}{core:4} code {text - len(programs[name]):6} bytes, program "
                    f"{len(programs[name]):7}, RAM {room:8}, {count:8} instructions a block"
                    f"{'' if fingers > 100 else ' (no finger)'}"
                )


if __name__ == "__main__":
    main()
