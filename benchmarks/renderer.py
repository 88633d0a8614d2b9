"""The renderer's times, and its error under the virtual finger, as the README quotes them.

    .venv/bin/python benchmarks/renderer.py

A block is 1 ms at 48 kHz. Its time runs from asking the touches for the fingers' paths to the drive
samples: prediction, texture, surface, fades, wave. For comparison, the same run times the bare path
(one texture row, one table row, the inverse, a sine, 16 bits) in numpy, in eager torch and, where
numba is installed, compiled. reaction.py plays in real time, with stalls.
"""

import argparse
import gc
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from skimage.data import brick

import haptix
from firmware_io import open_device
from haptix.base.native import NULL, ffi, library
from haptix.feel.motion import Trajectory
from haptix.model.surface import Slice
from haptix.play.render import (
    DirectWave,
    LiveSettings,
    RenderCore,
    RenderSettings,
    SineCarrier,
)
from haptix.play.render.fingers import PredictedFingers
from haptix.play.render.program import compile_touch
from haptix.play.simulation import FINGER_PATH, Setting, simulate
from haptix.play.touch import TouchEvent, TouchSettings
from haptix.play.virtual_finger import TouchPanel

RATE, STEP, BLOCK = 48_000.0, 4, 48
POINTS = BLOCK // STEP


def times_us(work: Callable[[], object], count: int = 4000) -> np.ndarray:
    for _ in range(2000):  # until the processor's clock has settled
        work()
    times = np.empty(count)
    for i in range(count):
        began = time.perf_counter()
        work()
        times[i] = time.perf_counter() - began
    return times * 1e6


def report(name: str, times: np.ndarray) -> None:
    p50, p99 = np.percentile(times, [50, 99])
    print(f"  {name:44} p50 {p50:6.1f}   p99 {p99:6.1f}   max {times.max():7.1f} us")


def blocks(surface: Any, texture: Any) -> None:
    print("a block of 1 ms at 48 kHz")
    for fingers in (1, 2, 10):
        live = LiveSettings(touch=TouchSettings(lost_after_s=60.0))
        touches = PredictedFingers(live)
        for i in range(30):
            for finger in range(fingers):
                x, y, force = 10 + 0.5 * i, 20.0 + finger, 0.5 + 0.005 * i
                touches.take(TouchEvent(0.01 * i, finger, x, y, "move", force))
        touches.update(0.29)
        drive, settings = SineCarrier(4000.0), RenderSettings(block_s=1e-3)
        core = RenderCore(surface, texture, open_device("mock:"), drive, settings)
        clock = {"sample": 0, "amplitude_v": 0.0}

        def one(
            touches: Any = touches, core: Any = core, clock: Any = clock, fingers: int = fingers
        ) -> None:
            first = clock["sample"]
            # At one time, since a finger without reports soon rests and gets no drive.
            motion = touches.motion(0.3, STEP / RATE, POINTS, first / RATE)
            block = core.block(motion, first, clock["amplitude_v"])
            assert motion.motion.fingers == fingers
            clock["sample"], clock["amplitude_v"] = first + BLOCK, float(block.amplitude_v[-1])

        who = f"{fingers} finger{'s' * (fingers > 1)}"
        report(f"{who}, everything on", times_us(one))
        with open_device("mock:") as device:
            program = compile_touch(surface, texture, device, drive, live)
        report(f"{who}, by the engine in C", times_us(engine_block(program, fingers)))


def engine_block(program: bytes, fingers: int) -> Callable[[], object]:
    """Return what renders the same block by the engine."""
    memory = ffi.new("double[]", library.hx_engine_size(program, len(program)) // 8 + 1)
    engine = library.hx_engine_open(program, len(program), memory)
    for i in range(30):
        for finger in range(fingers):
            place = (10 + 0.5 * i, 20.0 + finger, 0.5 + 0.005 * i)
            library.hx_engine_touch(engine, finger, 0.01 * i, *place, 1)
    first = round(0.3 * RATE)
    felt = library.hx_engine_window(engine, first, POINTS, 0.0, NULL, 1)
    assert felt.fingers == fingers
    return lambda: library.hx_engine_window(engine, first, POINTS, 0.0, NULL, 0) and memory


def bare(surface: Any, texture: Any) -> None:
    """One row of pixels under 48 places, one row of the surface, the sine, 16 bits."""
    print("the bare path, one finger")
    level = np.ascontiguousarray(texture.level[100])
    load = torch.tensor(0.5, dtype=torch.float64)
    low, high = surface.reachable(load)
    shares = np.linspace(0.0, 1.0, 256)
    row = surface.voltage(low + torch.from_numpy(shares) * (high - low), load).voltage_v.numpy()
    places = np.linspace(100.0, 110.0, BLOCK)
    columns = np.arange(len(level), dtype=float)
    wave = 2 * np.pi * 4000.0 / RATE * np.arange(BLOCK)

    def by_numpy() -> np.ndarray:
        voltage_v = np.interp(np.interp(places, columns, level), shares, row)
        return np.asarray(voltage_v * np.sin(wave) * (32767 / 250)).astype(np.int16)

    report("numpy", times_us(by_numpy))

    line, at, phase = torch.from_numpy(level), torch.from_numpy(places), torch.from_numpy(wave)

    def by_torch() -> torch.Tensor:
        cell = at.long()
        share = torch.lerp(line[cell], line[cell + 1], at - cell)
        low, high = surface.reachable(load)
        voltage = surface.voltage(low + share * (high - low), load).voltage_v
        codes: torch.Tensor = (voltage * torch.sin(phase) * (32767 / 250)).to(torch.int16)
        return codes

    report("torch, eager", times_us(by_torch, 1000))

    try:
        import numba  # type: ignore[import-not-found] # not everybody has it
    except ImportError:
        print("  numba is not installed")
        return
    column, drive = row.inverse, row.drive
    low, high, pull_in = row.lowest_mu, row.highest_mu, row.unit_v

    @numba.njit
    def compiled(places, level, column, drive, low, high, pull_in, wave):
        codes = np.empty(len(places), np.int16)
        for i in range(len(places)):
            cell = int(places[i])
            share = level[cell] + (places[i] - cell) * (level[cell + 1] - level[cell])
            goal = -1 / (low + share * (high - low))
            k = min(max(np.searchsorted(column, goal) - 1, 0), len(column) - 2)
            part = (goal - column[k]) / (column[k + 1] - column[k])
            s = max(drive[k] + part * (drive[k + 1] - drive[k]), 0.0)
            codes[i] = int(pull_in * np.sqrt(s) * np.sin(wave[i]) * (32767 / 250))
        return codes

    report(
        "numba",
        times_us(lambda: compiled(places, level, column, drive, low, high, pull_in, wave)),
    )


def offline(surface: Any, texture: Any) -> None:
    t = np.arange(0, 60.0, 0.01)
    path = Trajectory(t, 30 + 20 * np.sin(2 * t), 20 + 10 * np.cos(2.1 * t), 0.5 + 0.2 * np.sin(t))
    device = open_device("mock:")
    renderer = haptix.Renderer(surface, texture, device)
    written, write = [0.0], device.write

    def timed(volts: Any) -> None:
        began = time.perf_counter()
        write(volts)
        written[0] += time.perf_counter() - began

    device.write = timed  # type: ignore[method-assign]
    began = time.perf_counter()
    with renderer:
        renderer.play(path)
    spent = time.perf_counter() - began
    device.close()
    print(
        f"a recorded path: {60 / (spent - written[0]):.0f} times real time; "
        f"{60 / spent:.0f} times with limits, wire and the mock device"
    )


def errors(model: Any, texture: Any, path: Trajectory) -> None:
    print("errors felt by the virtual finger: 95 % are below, in JND")
    for name, drive in (
        ("carrier of 4 kHz", SineCarrier(4000.0)),
        ("direct sine of 60 Hz", DirectWave(60.0)),
        ("direct sine of 125 Hz", DirectWave(125.0)),
        ("direct square of 125 Hz", DirectWave(125.0, "square")),
    ):
        setting = Setting(model, texture, path, drive)
        found = simulate(setting, setting.surface()[0], TouchPanel())
        parts = "   ".join(f"{key} {part.error_p95_jnd:.2g}" for key, part in found.parts.items())
        print(f"  {name:24} {parts}   all {found.evaluation.error_p95_jnd:.2g}")
        if found.periods is not None:
            print(f"    mean friction of each period {found.periods.error_p95_jnd:.2g}")


def direct(model: Any) -> None:
    """Friction over a period of a direct sine at full voltage, against what was asked for."""
    print("direct sine, 0.3 N, 200 V: mean friction minus that of the mean attraction, and minus")
    print("what the renderer asks for, in JND")
    for frequency in (60.0, 125.0, 500.0):
        ranges = {"normal_force_n": (0.1, 1.0), "frequency_hz": frequency}
        surface = haptix.FrictionSurface.build(model, ranges, tolerance=1e-4)
        wave = DirectWave(frequency)
        attraction = wave.attraction
        assert attraction is not None  # a sine's ripples
        asked = Slice.of(surface.table).averaged(attraction).column(0.3).highest_mu
        felt = float(model.over_period(0.3, 200.0, frequency).mu.mean())
        naive = float(surface.mu(0.3, 200.0))
        parts = [(felt - one) / (0.11 * felt) for one in (naive, asked)]
        print(f"  {frequency:g} Hz: {parts[0]:.2f}, {parts[1]:.2f}")


def main() -> None:
    argparse.ArgumentParser(description=__doc__.split("\n")[0]).parse_args()
    torch.set_num_threads(1)
    model = haptix.ContactModel(
        haptix.Finger.preset("semi-wet"), haptix.Screen.preset("3m-sct3250")
    )
    ranges = {"normal_force_n": (0.1, 1.0), "frequency_hz": 4000.0}
    surface = haptix.FrictionSurface.build(model, ranges, tolerance=5e-4).at(4000.0)
    texture = haptix.Texture.from_image(brick(), width_mm=60)
    gc.collect()
    gc.freeze()
    blocks(surface, texture)
    bare(surface, texture)
    offline(surface, texture)
    direct(model)
    errors(model, texture, Trajectory.from_csv(FINGER_PATH))


if __name__ == "__main__":
    main()
