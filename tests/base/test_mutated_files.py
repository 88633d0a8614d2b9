"""Mutated files of every kind that comes from strangers: each reader refuses, or reads in bounds.

``python -m tests.base.test_mutated_files SECONDS [KIND]`` mutates each kind for so long; an hour of
each is 3600. A file that fails is kept in the folder that the message names.
"""

import io
import random
import resource
import shutil
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory, mkdtemp
from unittest.mock import Mock, patch

import numpy as np
import pytest
import pyvisa
from nptdms import ChannelObject, TdmsWriter

from firmware_io.generator import FunctionGenerator, GeneratorProfile
from haptix.base.errors import HaptixError
from haptix.base.tables import read_table
from haptix.feel.gallery import load as load_material
from haptix.feel.materials.pictures import read_grey
from haptix.feel.signals.audio_files import read_audio
from haptix.lab.experiment.trial_log import read_log
from haptix.lab.stimuli.interchange import read_ahap, read_hjif, write_hjif
from haptix.model.contact.measured_files import read_spectrum, read_surface
from haptix.model.surface.file import load_table
from haptix.play.touch import TuioDecoder
from haptix.play.touch.hid import HidReports
from haptix.play.touch.recordings import read_events
from tests.base.test_noticed_damage import audio, picture, table
from tests.devices.guest.hid_panel import descriptor
from tests.play.touch import test_recordings as recorded
from tests.play.touch.tuio_frames import cursors

DATA = Path(__file__).parents[1] / "data" / "kept-files"
MUTATIONS, LONGEST_S, MOST_BYTES = 200, 10.0, 2**30


def decode(path):
    decoder = TuioDecoder(160.0, 90.0)
    decoder.feed(path.read_bytes(), 0.0)
    decoder.feed(path.read_bytes(), 0.01)


def generate(path):
    """Play on a generator whose answers are the lines of a file, and then silence."""
    lines = path.read_bytes().splitlines()

    def query(command):
        if not lines:
            raise pyvisa.VisaIOError(pyvisa.constants.StatusCode.error_timeout)
        return lines.pop(0).decode("ascii")  # as PyVISA decodes it

    profile = GeneratorProfile(amplifier_gain=20.0, ceiling_v=150.0)
    instrument = Mock(spec=pyvisa.resources.MessageBasedResource, query=query)
    with patch.object(pyvisa, "ResourceManager") as manager:
        manager().open_resource.return_value = instrument
        with FunctionGenerator("TCPIP::198.51.100.1::INSTR", profile, "", lambda s: None) as one:
            one.play(100.0 * np.sin(np.arange(480)))


def hjif():
    with TemporaryDirectory() as folder:
        path = Path(folder) / "a.hjif"
        write_hjif(path, [0.0, 1.5, 2.25, 10.0], [0.25, 0.31, 0.27, 0.25], date="2026-01-01")
        return path.read_bytes()


def lvm():
    head = (
        "LabVIEW Measurement\t\nWriter_Version\t2\nReader_Version\t2\nSeparator\tTab\n"
        "Decimal_Separator\t.\nMulti_Headings\tYes\nX_Columns\tOne\nTime_Pref\tRelative\n"
        "***End_of_Header***\t\n\t\nChannels\t2\t\nSamples\t40\t40\nY_Unit_Label\tN\tN\n"
        "X_Dimension\tTime\tTime\nX0\t0\t0\nDelta_X\t0.001\t0.001\n***End_of_Header***\t\t\n"
        "X_Value\tFz\tFx\tComment\n"
    )
    return (head + "".join(f"{n / 1e3}\t0.5\t{n % 7 / 10}\t\n" for n in range(40))).encode()


def numpy_file():
    file = io.BytesIO()
    np.save(file, np.linspace(0.0, 1.0, 24 * 24).reshape(24, 24))
    return file.getvalue()


def tdms():
    file = io.BytesIO()
    steps = {"wf_increment": 1e-3, "wf_start_offset": 0.0, "unit_string": "N"}
    with TdmsWriter(file) as writer:
        writer.write_segment(
            [ChannelObject("Force", name, np.linspace(0, 1, 40), steps) for name in ("Fz", "Fx")]
        )
    return file.getvalue()


EVEMU = b"""# EVEMU 1.3
N: panel
I: 0003 0001 0002 0001
A: 00 0 1599 0 0 10
A: 01 0 899 0 0 10
A: 2f 0 9 0 0 0
A: 35 0 1599 0 0 10
A: 36 0 899 0 0 10
A: 39 0 65535 0 0 0
E: 0.000001 0003 0039 0001
E: 0.000001 0003 0035 0400
E: 0.000001 0003 0036 0300
E: 0.000001 0000 0000 0000
E: 0.010001 0003 0035 0420
E: 0.010001 0000 0000 0000
E: 0.020001 0003 0039 -001
E: 0.020001 0000 0000 0000
"""
AHAP = (
    b'{"Version":1.0,"Pattern":[{"Event":{"Time":0.0,"EventType":"HapticTransient","EventParameters":'
    b'[{"ParameterID":"HapticIntensity","ParameterValue":0.8}]}},{"Event":{"Time":0.1,"EventType":'
    b'"HapticContinuous","EventDuration":0.25,"EventParameters":[]}}]}'
)
HAPTIC = (
    b'{"version":{"major":1,"minor":0,"patch":0},"metadata":{},"signals":{"continuous":{"envelopes":'
    b'{"amplitude":[{"time":0.0,"amplitude":0.0},{"time":0.1,"amplitude":0.8,"emphasis":{"amplitude":'
    b'1.0,"frequency":0.5}},{"time":0.4,"amplitude":0.0}],"frequency":[]}}}}'
)


def of_descriptor(path):
    """Read a descriptor, and reports by it."""
    reports = HidReports.of(path.read_bytes())
    if reports is not None:
        assert reports.size_mm is None or [*reports.axes]
        for data in (b"\x01", bytes(64), b"\xff" * 64, bytes([1, 3, 5, 144, 1, 32, 3, 1, 0, 0])):
            list(reports.events(0.0, data))


KINDS = {
    "TUIO": (cursors(1, {1: (0.5, 0.5), 2: (0.1, 0.9)}), ".osc", decode),
    "evemu": (EVEMU, ".evemu", lambda path: read_events(path, 160.0, 90.0)),
    "libinput record": (recorded.libinput().encode(), ".yml", read_events),
    "getevent": (recorded.getevent(False).encode(), ".txt", read_events),
    "getevent -l": (recorded.getevent(True).encode(), ".txt", read_events),
    "hid-recorder": (recorded.hid().encode(), ".hid", read_events),
    "HID descriptor": (descriptor(2047, 1151), ".bin", of_descriptor),
    "haptic clip": (HAPTIC, ".haptic", load_material),
    "SCPI": (b"Keysight,33522B,1,2.0\n" + 40 * b'+0,"No error"\n', ".txt", generate),
    "HJIF": (hjif(), ".hjif", lambda path: read_hjif(path, 50.0)),
    "CSV of touches": (
        table(("t_s", "x_mm", "y_mm"), lambda n: (n / 100, n / 3, 5)), ".csv", read_events,
    ),
    "CSV of measured values": (
        table(("t_s", "normal_force_n"), lambda n: (n / 100, 0.5)), ".csv",
        lambda path: read_table(path, ("normal_force_n",)),
    ),
    "LVM": (lvm(), ".lvm", read_table),
    "TDMS": (tdms(), ".tdms", read_table),
    "WAV": (audio("WAV"), ".wav", read_audio),
    "FLAC": (audio("FLAC"), ".flac", read_audio),
    "PNG": (picture(), ".png", read_grey),
    "height map of text": (
        "\n".join(",".join(f"{(x * y) % 7}" for x in range(24)) for y in range(24)).encode(),
        ".csv", lambda path: read_surface(path, "um", 1e-6),
    ),
    "height map of numpy": (numpy_file(), ".npy", lambda path: read_surface(path, "um", 1e-6)),
    "spectrum": (
        table(("q (1/m)", "C (m^4)"), lambda n: (1e3 * (n + 1), 10.0 / (n + 1))),
        ".csv", lambda path: read_spectrum(path, "C"),
    ),
    "surface": ((DATA / "direct.surface").read_bytes(), ".surface", load_table),
    "layout": ((DATA / "layout.json").read_bytes(), ".json", load_material),
    "AHAP": (AHAP, ".ahap", lambda path: read_ahap(path, 0.2, 0.6)),
    "log of trials": ((DATA / "trials.tsv").read_bytes(), ".tsv", read_log),
}  # fmt: skip
WORDS = (b"nan", b"inf", b"-1", b"1e308", b"99999999999999999999", b"\0", b"\xff\xfe", b'"', b"\n")
NUMBERS = (
    b"\xff" * 4,
    b"\x7f" + b"\xff" * 3,
    b"\xff" * 3 + b"\x7f",
    b"\0" * 4,
    b"\x80" + b"\0" * 3,
)


def mutated(content, chance):
    """Content with one to four changes: bits, numbers, words, pieces lost, moved or repeated."""
    out = bytearray(content)
    for _ in range(chance.randint(1, 4)):
        at, size = chance.randrange(len(out) + 1), chance.choice((1, 4, 16, 200))
        match chance.randrange(6):
            case 0 if at < len(out):
                out[at] ^= 1 << chance.randrange(8)
            case 1:
                out[at : at + 4] = chance.choice(NUMBERS)
            case 2:
                out[at : at + chance.randint(0, 8)] = chance.choice(WORDS)
            case 3:
                del out[at : at + size]
            case 4:
                out[at:at] = out[at : at + size] * chance.choice((1, 2, 50))
            case _:
                from_ = chance.randrange(len(out) + 1)
                out[at : at + size] = out[from_ : from_ + size]
    return bytes(out)


def most_memory_bytes():
    """The most that this process had."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else 1024 * peak


def attack(kind, folder, seed, until):
    """Read mutated files while `until(count)` is false; return how many were refused, and read."""
    content, suffix, read = KINDS[kind]
    path = folder / f"mutated{suffix}"
    path.write_bytes(content)
    read(path)
    refused = count = 0
    while not until(count):
        path.write_bytes(mutated(content, random.Random(f"{kind} {seed} {count}")))
        before_bytes, began_s = most_memory_bytes(), time.thread_time()
        try:
            read(path)
        except HaptixError:
            refused += 1
        except Exception as error:
            error.add_note(f"{path}: mutation {count} of {kind}")
            raise
        assert time.thread_time() - began_s < LONGEST_S, (path, count)
        assert most_memory_bytes() - before_bytes < MOST_BYTES, (path, count)
        count += 1
    return refused, count - refused


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("kind", KINDS)
def test_no_mutated_file_ends_its_reader(tmp_path, kind):
    refused, _ = attack(kind, tmp_path, 0, lambda count: count >= MUTATIONS)
    assert refused or kind in ("TUIO", "HID descriptor")  # which leave out what is none


def attack_for(kind, folder, seconds):
    end_s = time.monotonic() + seconds
    return attack(kind, folder, time.time_ns(), lambda count: time.monotonic() > end_s)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("kind", KINDS)
def test_ten_minutes_of_mutated_files_end_no_reader(tmp_path, kind):
    refused, _ = attack_for(kind, tmp_path, 600.0)
    assert refused or kind in ("TUIO", "HID descriptor")


if __name__ == "__main__":
    for each in sys.argv[2:] or KINDS:
        place = Path(mkdtemp(prefix="mutated-"))
        refusals, reads = attack_for(each, place, float(sys.argv[1]))
        sys.stdout.write(f"{each}: {refusals} refused, {reads} read\n")
        shutil.rmtree(place)
