"""Play haptix stimuli from a PsychoPy script, which keeps its own pictures and clocks.

    pip install psychopy        # haptix does not depend on it
    python examples/psychopy_schedule.py FOLDER participant-01.tsv

FOLDER is a set made by ``haptix stimuli make``. The trial table says what comes when; every
stimulus is played within ``with device``, which ends at 0 V whatever happens in the script, and
every answer is on the disk before the next trial. Without PsychoPy, `run` can be called with
substitutes for its window and keyboard, as the tests do.
"""

from __future__ import annotations

import csv
import os
import sys
from collections.abc import Callable
from pathlib import Path

from firmware_io import Device, open_device
from haptix.base.files import read_json
from haptix.feel.signals.audio_files import read_drive
from haptix.lab import check_manifest

Show = Callable[[str], None]
Ask = Callable[[], str]


def play(device: Device, file: Path) -> None:
    """Play one drive file; its sidecar says what a sample is worth and at what rate."""
    table = read_json(file.with_suffix(".json"))
    drive, _, rate = read_drive(file, table["full_scale_v"])
    if rate != device.capabilities.sample_rate_hz:
        raise SystemExit(f"{file}: made for {rate:g} Hz, the device plays another rate")
    with device:  # left when all has been played
        device.write(drive)  # rejected whole if a sample is above the device's ceiling


def run(folder: Path, log: Path, device: Device, show: Show, ask: Ask) -> int:
    """Run the trials of the set's table, and return their number."""
    wrong = check_manifest(folder)
    if wrong:
        raise SystemExit(f"{folder}: files differ from the manifest: {', '.join(wrong)}")
    with (folder / "events.tsv").open(newline="") as file:
        trials = list(csv.DictReader(file, delimiter="\t"))
    with log.open("x") as answers:
        answers.write("trial\ttrial_type\tanswer\n")
        for number, trial in enumerate(trials, 1):
            show("slide your finger to the right")
            play(device, folder / trial["stim_file"])
            show("how rough was it? 1 to 7")
            answers.write(f"{number}\t{trial['trial_type']}\t{ask()}\n")
            answers.flush()
            os.fsync(answers.fileno())
    return len(trials)


def main() -> None:
    if len(sys.argv) != 3:
        sys.exit("psychopy_schedule: expected FOLDER LOG, a set of stimuli and a table to write")
    try:
        from psychopy import event, visual  # GPL: not a dependency of haptix
    except ModuleNotFoundError as error:
        sys.exit(f"psychopy_schedule: {error.name} is missing; run: pip install psychopy")

    window = visual.Window()
    text = visual.TextStim(window)

    def show(message: str) -> None:
        text.text = message
        text.draw()
        window.flip()

    def ask() -> str:
        (key,) = event.waitKeys(maxWait=float("inf"), keyList=list("1234567"))[:1]
        return str(key)

    device = open_device("mock:")  # or "usb:", "hid:", "audio:"
    try:
        run(Path(sys.argv[1]), Path(sys.argv[2]), device, show, ask)
    finally:
        device.close()
        window.close()


if __name__ == "__main__":
    main()
