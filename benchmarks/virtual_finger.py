"""Accuracy and speed of the virtual finger, as docs/virtual-finger.md quotes them.

    .venv/bin/python benchmarks/virtual_finger.py

Differences are in JND, 0.11 of the friction. One thread; times are the median of
three runs in one process.
"""

import math
import statistics
import time

import numpy as np
import torch

from haptix import ContactModel, Finger, Screen
from haptix.model.perception.thresholds import WEBER_FRACTION
from haptix.model.waves import Waveform
from haptix.play.virtual_finger import VirtualFinger

RATE, FORCE, VOLTAGE = 48_000, 0.5, 150.0


def square(phase):
    return np.where(phase < 0.5, 1.0, -1.0)


def sine(phase):
    return np.cos(2 * np.pi * phase)


def modulated(phase):
    return np.sqrt((1 + 0.8 * np.cos(2 * np.pi * phase)) / 2) * np.sin(2 * np.pi * 40 * phase)


def periods(model: ContactModel) -> None:
    print("largest difference from ContactModel.over_period, without the response, JND")
    finger = VirtualFinger(model, has_response=False)
    for shape, frequency in ((sine, 120.0), (sine, 1000.0), (square, 120.0), (modulated, 100.0)):
        samples = round(RATE / frequency)
        waveform = Waveform.of_samples(shape(np.arange(samples) / samples))
        wave = waveform.at(np.arange(samples) / samples)
        drive = np.tile(VOLTAGE * wave, math.ceil(1.1 * frequency))
        expected = model.over_period(
            FORCE, VOLTAGE, frequency, waveform, samples=samples
        ).mu.numpy()
        at_s = round(0.5 * frequency) / frequency
        span = [at_s, at_s + 1 / frequency]
        felt = finger.feel(drive, RATE, span, [0, 1], 0, FORCE, output_rate_hz=4 * RATE)
        lack = np.abs(felt.mu[::4][:samples] / expected - 1).max() / WEBER_FRACTION
        print(f"  {shape.__name__:10} {frequency:5.0f} Hz   {lack:.1e}")


def carriers(model: ContactModel) -> None:
    print("largest difference from ContactModel.solve, steady amplitude, JND")
    t = np.arange(RATE) / RATE
    for frequency in (3000.0, 4000.0, 12_000.0):
        expected = float(model.solve(FORCE, VOLTAGE, frequency).mu)
        for speed in (10.0, 100.0, 300.0):
            drive = VOLTAGE * np.sin(2 * np.pi * frequency * t)
            felt = VirtualFinger(model).feel(drive, RATE, [0.1, 0.9], [0, 0.8 * speed], 0, FORCE)
            lack = np.abs(felt.mu / expected - 1).max() / WEBER_FRACTION
            print(f"  {frequency:5.0f} Hz, {speed:3.0f} mm/s   {lack:.1e}")


def direct_drive(model: ContactModel) -> None:
    print("direct drive: mean friction above that of the averaged attraction, and its ripple, JND")
    t = np.arange(RATE) / RATE
    for frequency in (80.0, 400.0):
        for voltage in (100.0, 200.0):
            averaged = float(model.solve(FORCE, voltage, frequency).mu)
            for speed in (10.0, 100.0):
                drive = voltage * np.sin(2 * np.pi * frequency * t)
                path = ([0.2, 0.2 + 0.5], [0, 0.5 * speed], 0, FORCE)
                mu = VirtualFinger(model).feel(drive, RATE, *path).mu[500:-1]
                above = (mu.mean() / averaged - 1) / WEBER_FRACTION
                ripple = np.ptp(mu) / 2 / averaged / WEBER_FRACTION
                print(
                    f"  {frequency:3.0f} Hz, {voltage:3.0f} V, {speed:3.0f} mm/s   "
                    f"mean {above:+.3f}, ripple +-{ripple:.2f}"
                )


def speed(model: ContactModel) -> None:
    print("ten seconds at 48 kHz")
    t = np.arange(10 * RATE) / RATE
    touch_s = np.linspace(0, 10, 1001)
    path = (touch_s, 50 + 45 * np.sin(1.5 * touch_s), 10, 0.5 + 0.3 * np.sin(touch_s))
    amplitude = 120 + 70 * np.sin(2 * np.pi * 30 * t)
    noise = np.random.default_rng(0).normal(0, 40, len(t)).clip(-200, 200)
    drives = {
        "carrier, 10 kHz out": (amplitude * np.sin(2 * np.pi * 4000 * t), 10_000.0),
        "carrier, 48 kHz out": (amplitude * np.sin(2 * np.pi * 4000 * t), 48_000.0),
        "noise, 10 kHz out": (noise, 10_000.0),
    }
    for name, (drive, out) in drives.items():
        finger = VirtualFinger(model)
        taken = []
        for _ in range(3):
            began = time.perf_counter()
            finger.feel(drive, RATE, *path, output_rate_hz=out)
            taken.append(time.perf_counter() - began)
        print(f"  {name:20} {statistics.median(taken):.2f} s")


def main() -> None:
    torch.set_num_threads(1)
    model = ContactModel(Finger.preset("semi-wet"), Screen.preset("3m-sct3250"))
    periods(model)
    carriers(model)
    direct_drive(model)
    speed(model)


if __name__ == "__main__":
    main()
