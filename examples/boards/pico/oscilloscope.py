"""Draw what an oscilloscope shows at the converter of the emulated board.

``python oscilloscope.py output.codes`` draws what an emulator that you have started has written,
to ``output.png``: signed 16-bit codes, little-endian, 48,000 a second; 32767 is full scale. Without
a file it plays 10 V for 200 ms on an emulator of its own and writes ``10v.png``. It needs
matplotlib and, without a file, Node 20 and ``npm install --prefix tests/firmware_io/pico``.
"""

import argparse
import json
import subprocess
from pathlib import Path
from tempfile import TemporaryDirectory

import matplotlib.pyplot as plt
import numpy as np

from firmware_io import open_device
from firmware_io.pico_image import pico_uf2

HERE = Path(__file__).parent
EMULATOR = HERE.parents[2] / "tests" / "firmware_io" / "pico" / "emulator.mjs"
OUTPUT_HZ, FULL_SCALE_V, REFERENCE_V = 48_000, 200.0, 3.3


def record(folder: Path) -> np.ndarray:
    """Return the codes at the converter, while 200 ms of 10 V are played and the host ends."""
    image, trace = folder / "pico.uf2", folder / "codes"
    image.write_bytes(pico_uf2("pico", "rig-1"))
    with subprocess.Popen(
        ["node", EMULATOR, image, trace], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as emulator:
        assert emulator.stdout is not None
        port = 0
        for line in emulator.stdout:
            event = json.loads(line)
            port = event.get("port", port)
            if "configuration" in event:
                break
        address = f"tcp:127.0.0.1:{port},mode=envelope,sample_rate_hz=48000,carrier_hz=1000"
        with open_device(address) as device:
            device.arm()
            device.write(np.full(9600, 10.0))
        end = trace.stat().st_size + 2 * OUTPUT_HZ
        while trace.stat().st_size < end:
            pass
        emulator.kill()
    return np.fromfile(trace, "<i2").astype(float)


def main() -> None:
    """Draw the whole, its begin and its end."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("codes", nargs="?", type=Path, help="what an emulator wrote")
    parser.add_argument("--out", type=Path, help="the picture")
    given = parser.parse_args()
    if given.codes is None:
        with TemporaryDirectory() as folder:
            codes = record(Path(folder))
    else:
        codes = np.fromfile(given.codes, "<i2").astype(float)
    played = np.flatnonzero(codes)
    if not played.size:
        parser.exit(1, "Nothing but 0 V has been played yet.\n")
    volts = REFERENCE_V / 2 * (1 + codes / 32768)
    figure, axes = plt.subplots(1, 3, figsize=(10, 2.6), layout="constrained", sharey=True)
    spans = (
        (-1000, played[-1] - played[0] + 1000),
        (-48, 192),
        (played[-1] - played[0] - 432, None),
    )
    for axis, (begin, end) in zip(axes, spans, strict=True):
        begin += played[0]
        end = played[-1] + 96 if end is None else played[0] + end
        axis.step(np.arange(end - begin) / OUTPUT_HZ * 1e3, volts[begin:end], where="post", lw=0.8)
        axis.set_xlabel("time [ms]")
        axis.grid(visible=True, alpha=0.3)
    axes[0].set_ylabel("converter's output [V]")
    out = given.out or (given.codes.with_suffix(".png") if given.codes else Path("10v.png"))
    figure.savefig(out, dpi=110)
    took_ms = (played[-1] - played[0] + 1) / OUTPUT_HZ * 1e3
    print(f"{took_ms:.0f} ms from the first sample off 0 V to the last: {out}")


if __name__ == "__main__":
    main()
