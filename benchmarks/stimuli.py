"""Offline stimuli: time and memory for an hour of drive, its peak, and its felt error.

    python benchmarks/stimuli.py [minutes]
    python benchmarks/stimuli.py --many 10000 2

Times depend on the load of the machine: run it on a quiet one.
"""

from __future__ import annotations

import hashlib
import json
import resource
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import soundfile

from haptix import ContactModel, Finger, Screen
from haptix.feel import Sine, TimeNoise, grating
from haptix.lab.stimuli import Apparatus, Rendering, Stimulus, StimulusSet
from haptix.model.perception.thresholds import WEBER_FRACTION
from haptix.play.virtual_finger import VirtualFinger

FINGER, SCREEN = Finger.preset("semi-wet"), Screen.preset("3m-sct3250")
RATE = 48_000.0


def signals() -> dict[str, object]:
    return {
        "sine": Sine(0.07, 20.0, offset=0.08),
        "grating": grating(0.07, 2.0, 80.0, offset=0.08),
        "noise": TimeNoise(0.014, (20.0, 200.0), seed=1, mean=0.1),  # 7 deviations above 0
    }


def hour(kind: str, minutes: float, threads: int, encoding: str, container: str) -> None:
    """Make one long file, in a process of its own so that its memory can be measured."""
    stimulus = Stimulus(kind, signals()[kind].lasting(60 * minutes))  # type: ignore[attr-defined]
    parts = StimulusSet(
        "hour", (stimulus,), FINGER, (SCREEN,), container=container, encoding=encoding
    )
    apparatus = parts.apparatus(SCREEN)  # the surface, which a cache keeps
    apparatus.contact(stimulus)
    with tempfile.TemporaryDirectory() as folder:
        began = time.perf_counter()
        (table,) = parts.make(folder, threads).sidecars
        took = time.perf_counter() - began
        path = Path(folder) / table["file"]
        peak = 0.0
        with soundfile.SoundFile(path) as file:
            for block in file.blocks(1 << 20, dtype="float64", always_2d=True):
                peak = max(peak, float(np.abs(block[:, 0]).max()) * table["full_scale_v"])
        result = {
            "seconds": took,
            "times_real_time": 60 * minutes / took,
            "megabytes": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
            "sha256": hashlib.sha256(path.read_bytes()).hexdigest()
            if minutes < 10
            else table["sha256"],
            "peak_error_steps": abs(peak - table["peak_v"]) / table["quantisation_step_v"],
        }
    print(json.dumps(result))


def in_a_process(*arguments: object) -> dict[str, float]:
    done = subprocess.run(
        [sys.executable, __file__, "--hour", *map(str, arguments)],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    return json.loads(done.stdout.splitlines()[-1])


def evaluate_set() -> None:
    """Print the error of the friction felt by the virtual finger, which uses no surface."""
    length, force, speed = 4.0, 0.5, 80.0
    model = ContactModel(FINGER, SCREEN)
    for name, signal in signals().items():
        stimulus = Stimulus(name, signal.lasting(length))  # type: ignore[attr-defined]
        apparatus = Apparatus.build(FINGER, SCREEN, [stimulus])
        response, _ = apparatus.responses(stimulus)
        rendering = Rendering(stimulus, response, RATE)
        t = np.array([0.0, length])
        felt = VirtualFinger(model).feel(
            rendering.whole(), RATE, t, speed * t, 0 * t + 20, 0 * t + force
        )
        values = stimulus.signal.values(0, rendering.samples, RATE)
        at = np.rint(felt.t_s * RATE).astype(int).clip(0, rendering.samples - 1)
        target = (1 + values[at]) * response.lowest_mu
        inside = (felt.t_s > 0.05) & (felt.t_s < length - 0.02)
        error = np.abs(felt.mu - target)[inside] / (WEBER_FRACTION * target[inside])
        print(
            f"{name}: friction felt by the virtual finger is off by {np.percentile(error, 95):.3f} "
            f"JND (95 %), {error.max():.3f} at most"
        )


def many(count: int, workers: int) -> None:
    """Print the time of a set of short stimuli, and the processor time of its making.

    The sheet and what a set does once are in it, and the workers' start: a process each.
    """
    stimuli = tuple(
        Stimulus(f"s-{i:05d}", (Sine(0.02 + 0.03 * i / count, 20.0 + i % 50) + 0.06).lasting(0.5))
        for i in range(count)
    )
    parts = StimulusSet("many", stimuli, FINGER, (SCREEN,))
    parts.apparatus(SCREEN)  # the surface, which a cache keeps
    began = time.perf_counter()
    with (
        tempfile.TemporaryDirectory() as folder,
        ProcessPoolExecutor(workers, get_context("spawn")) as executor,
    ):
        parts.make(folder, executor=executor)
        took = time.perf_counter() - began
    kinds = resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN
    used = [resource.getrusage(kind) for kind in kinds]  # the children have ended
    spent = sum(one.ru_utime + one.ru_stime for one in used)
    print(
        f"{count} stimuli of 0.5 s by {workers} processes: {took:.1f} s, {spent:.0f} s of "
        f"processor time, start included: {1e3 * spent / count:.1f} ms each"
    )


def main() -> None:
    minutes = float(sys.argv[1]) if len(sys.argv) > 1 else 60.0
    digests = set()
    for threads in (1, 2):
        found = in_a_process("noise", min(minutes, 5.0), threads, "float32", "wav")
        digests.add(found["sha256"])
    print(f"equal bytes on 1 and 2 threads: {len(digests) == 1}")
    for kind, encoding, container in (
        ("sine", "float32", "wav"),
        ("grating", "float32", "wav"),
        ("noise", "float32", "wav"),
        ("sine", "24-bit", "wav"),
        ("sine", "24-bit", "flac"),
    ):
        found = in_a_process(kind, minutes, 2, encoding, container)
        print(
            f"{minutes:g} minutes of {kind}, {encoding} {container}, 2 threads: "
            f"{found['seconds']:.1f} s, {found['times_real_time']:.0f} times real time, "
            f"{found['megabytes']:.0f} MB; peak in the file off by "
            f"{found['peak_error_steps']:.2f} steps"
        )
    evaluate_set()


if __name__ == "__main__":
    if sys.argv[1:2] == ["--many"]:
        many(int(sys.argv[2]), int(sys.argv[3]) if len(sys.argv) > 3 else 2)
    elif sys.argv[1:2] == ["--hour"]:
        name, length_min, count, form, kept_as = sys.argv[2:]
        hour(name, float(length_min), int(count), form, kept_as)
    else:
        main()
