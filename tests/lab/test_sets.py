"""Sets in folders: what is in the files, what is refused, and what a full disk leaves behind."""

import csv
import errno
import json
import re
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from itertools import pairwise
from multiprocessing import get_context
from types import SimpleNamespace

import numpy as np
import pytest
import soundfile
import torch

from firmware_io import LimitError
from haptix import ContactModel, Screen
from haptix.base.errors import FileFormatError, HaptixError, InputError, RangeError
from haptix.base.files import json_table
from haptix.feel import Constant, Excerpt, Recorded, Sine, TimeNoise, grating
from haptix.feel.signals.audio_files import AudioWriter, read_drive
from haptix.lab import Population
from haptix.lab.stimuli import Stimulus, StimulusSet, TrialPlan, check_manifest
from haptix.lab.stimuli.designs import constant_stimuli, equal_friction, full_factorial
from haptix.lab.stimuli.set_plan import Trigger
from haptix.lab.stimuli.stimulus import stimulus_from
from haptix.model.finger import MeasuredRoughness

RATE = 48_000.0

pytestmark = pytest.mark.usefixtures("own_cache")


def tones():
    """Three short stimuli."""
    return (
        Stimulus("sine", (Sine(0.05, 20.0) + 0.06).lasting(0.3), conditions={"hz": 20}),
        Stimulus("noise", (TimeNoise(0.01, (20.0, 200.0), seed=3) + 0.1).lasting(0.2)),
        Stimulus("volts", Sine(80.0, 10.0).lasting(0.25), "volts", conditions={"note": "a\tb"}),
    )


@pytest.fixture
def parts(finger, screen):
    return StimulusSet("three", tones(), finger, (screen,), trials=TrialPlan(2, 0.5, seed=4))


def tree(folder):
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir()) if path.is_file()}


def test_a_set_is_all_there(parts, tmp_path, surface, screen):
    folder = tmp_path / "set"
    result = parts.make(folder)
    assert sorted(tree(folder)) == sorted(
        ["events.json", "events.tsv", "manifest.json", "profiles.json", "sheet.png"]
        + [f"{name}.{kind}" for name in ("sine", "noise", "volts") for kind in ("wav", "json")]
    )
    assert not [path for path in folder.iterdir() if path.name.startswith(".")]
    assert check_manifest(folder) == []
    assert result.manifest["is_placeholder"] is True
    table = json.loads((folder / "noise.json").read_text())
    assert table["seeds"] == [3]
    assert table["carrier_hz"] == 4000 and table["normal_force_n"] == 0.5
    assert table["is_placeholder"] is True
    assert "dielectric of the skin" in table["placeholders"]
    assert table["full_scale_v"] == 250
    assert len(table["surface_hash"]) == 1 and len(table["profile_hash"]) == 64
    assert table["predicted"]["error_mu_at_most"] > 0
    assert table["predicted"]["error_jnd_at_most"] < 0.25
    assert table["audibility"]["audible"] is True  # 4 kHz at some 100 uA
    assert "flagged where" in table["audibility"]["rule"]
    # The prediction is that of the surface, at the amplitudes that were written.
    low, high = table["amplitude_v"]
    for volts, mu in ((low, table["predicted"]["mu_low"]), (high, table["predicted"]["mu_high"])):
        assert float(surface.mu(0.5, volts, 4000.0)) == pytest.approx(mu, abs=2e-3)
    (folder / "noise.wav").write_bytes(b"changed")
    assert check_manifest(folder) == ["noise.wav"]


def test_a_sidecar_has_a_line_for_each_entry(parts, tmp_path):
    parts.make(tmp_path)
    text = (tmp_path / "noise.json").read_text()
    table = json.loads(text)
    assert len(text.splitlines()) == len(table) + 2
    assert json.loads(json_table({'a"\n': [1, "µ"], "b": {}})) == {'a"\n': [1, "µ"], "b": {}}


def test_the_trial_table_is_bids(parts, tmp_path):
    parts.make(tmp_path / "set")
    with (tmp_path / "set" / "events.tsv").open(newline="") as file:
        rows = list(csv.DictReader(file, delimiter="\t"))
    assert list(rows[0])[:2] == ["onset", "duration"]
    described = json.loads((tmp_path / "set" / "events.json").read_text())
    assert set(rows[0]) == set(described)
    assert all("Description" in column for column in described.values())
    assert len(rows) == 6
    for half in (rows[:3], rows[3:]):
        assert {row["trial_type"] for row in half} == {"sine", "noise", "volts"}
    for row, after in pairwise(rows):
        gap = float(after["onset"]) - float(row["onset"]) - float(row["duration"])
        assert gap == pytest.approx(0.5, abs=1e-6)
        assert (tmp_path / "set" / row["stim_file"]).is_file()
    assert {row["hz"] for row in rows if row["trial_type"] == "sine"} == {"20"}
    assert {row["hz"] for row in rows if row["trial_type"] == "noise"} == {"n/a"}
    assert {row["note"] for row in rows if row["trial_type"] == "volts"} == {"a b"}


@pytest.mark.parametrize(
    ("container", "encoding"), [("wav", "float32"), ("wav", "24-bit"), ("flac", "24-bit")]
)
def test_the_peak_in_the_file_is_the_sidecars(finger, screen, tmp_path, container, encoding):
    """To one quantisation step, whoever reads the file."""
    parts = StimulusSet("one", tones(), finger, (screen,), container=container, encoding=encoding)
    for table in parts.make(tmp_path).sidecars:
        data, rate = soundfile.read(tmp_path / table["file"], dtype="float64")
        drive = data[:, 0] * table["full_scale_v"]
        assert rate == table["sample_rate_hz"]
        assert len(drive) == table["samples"]
        assert abs(np.abs(drive).max() - table["peak_v"]) <= table["quantisation_step_v"]
        assert np.sqrt(np.mean(drive**2)) == pytest.approx(table["rms_v"], rel=1e-5)
    info = soundfile.info(tmp_path / f"sine.{container}")
    assert info.subtype == {"float32": "FLOAT", "24-bit": "PCM_24"}[encoding]
    # 24 bits round to the nearest: half a step is all that any sample loses.
    drive, _, _ = read_drive(tmp_path / f"volts.{container}", 250.0)
    n = np.arange(12_000)
    exact = 80 * np.sin(2 * np.pi * 10 * n / RATE) * np.sin(2 * np.pi * 4000 * n / RATE)
    step = 250 / 2**23 if encoding == "24-bit" else 250 * 2.0**-25
    assert np.abs(drive - exact).max() <= step / 2 * (1 + 1e-6)


def test_triggers_mark_onset_and_end(parts, tmp_path):
    parts.make(tmp_path)
    _, trigger, _ = read_drive(tmp_path / "noise.wav", 250.0)
    code = json.loads((tmp_path / "noise.json").read_text())["trigger"]["onset_code"]
    assert code == 2
    levels = trigger * 256
    assert np.all(levels[:480] == code) and np.all(levels[-480:] == 255)
    assert not levels[480:-480].any()
    whole = Trigger(9, 1000, 1000.0).values(0, 1000)
    cut = np.concatenate([Trigger(9, 1000, 1000.0).values(k, 7) for k in range(0, 994, 7)])
    assert np.array_equal(cut, whole[:994])
    with pytest.raises(InputError, match="1 to 254"):
        Trigger(255, 100, 1000.0)


def test_equal_sets_are_equal_bytes(parts, tmp_path):
    parts.make(tmp_path / "a", threads=1)
    parts.make(tmp_path / "b", threads=2)
    assert tree(tmp_path / "a") == tree(tmp_path / "b")


@pytest.mark.parametrize(
    "workers", [ThreadPoolExecutor, pytest.param(ProcessPoolExecutor, marks=pytest.mark.slow)]
)
def test_an_executor_changes_no_byte_and_stays_open(parts, tmp_path, workers):
    """Processes are of their own, as on a cluster: what they need is sent or in the cache."""
    parts.make(tmp_path / "alone")
    told = []
    context = {"mp_context": get_context("spawn")} if workers is ProcessPoolExecutor else {}
    with workers(2, **context) as executor:
        made = parts.make(
            tmp_path / "many", on_progress=lambda *at: told.append(at), executor=executor
        )
        assert executor.submit(abs, -1).result() == 1
    assert tree(tmp_path / "alone") == tree(tmp_path / "many")
    assert [one["name"] for one in made.sidecars] == [one.name for one in parts.stimuli]
    assert [share for stage, share in told if stage == "render"][-1] == 1.0


def test_a_neighbour_changes_no_byte(finger, screen, tmp_path):
    """A stimulus of another force and frequency in the set leaves file and sidecar as they are."""
    first, other = (
        Stimulus(name, Constant(0.1, length_s=0.05), carrier_hz=hertz, normal_force_n=force)
        for name, hertz, force in (("a", 3000.0, 0.5), ("b", 1500.0, 0.3))
    )
    for name, stimuli in (("alone", (first,)), ("both", (first, other))):
        StimulusSet("s", stimuli, finger, (screen,), sample_rate_hz=48_000).make(tmp_path / name)
    for file in ("a.wav", "a.json"):
        alone, both = ((tmp_path / name / file).read_bytes() for name in ("alone", "both"))
        assert alone == both


def test_what_fails_in_a_worker_is_said_and_nothing_runs_on(parts, tmp_path, monkeypatch):
    def fill_up(self, drive_v, trigger):
        raise OSError(errno.ENOSPC, "No space left on device")

    with ThreadPoolExecutor(2) as executor:
        with monkeypatch.context() as patch:
            patch.setattr(AudioWriter, "write", fill_up)
            with pytest.raises(InputError, match="No space left"):
                parts.make(tmp_path, executor=executor)
        assert tree(tmp_path) == {}
        assert len(parts.make(tmp_path, executor=executor).sidecars) == 3


def test_what_is_finished_is_not_made_again(parts, tmp_path):
    first = parts.make(tmp_path)
    before = tree(tmp_path)
    stamps = {path.name: path.stat().st_mtime_ns for path in tmp_path.glob("*.wav")}
    again = parts.make(tmp_path)
    assert (first.reused, again.reused) == (0, 3)
    assert tree(tmp_path) == before
    assert {path.name: path.stat().st_mtime_ns for path in tmp_path.glob("*.wav")} == stamps
    # A damaged file, and one of another recipe, are.
    (tmp_path / "sine.wav").write_bytes(b"damaged")
    assert parts.make(tmp_path).reused == 2
    assert tree(tmp_path) == before


def test_a_full_disk_is_told_from_other_failures_of_the_library(tmp_path, monkeypatch):
    """libsndfile says "System error." of a full disk and of all else."""

    def fail(self, data):
        raise soundfile.LibsndfileError(2)

    monkeypatch.setattr(soundfile.SoundFile, "write", fail)
    for free, told in ((0, r"No space left on device.*a\.wav"), (10**9, r"cannot write.*a\.wav")):
        usage = SimpleNamespace(free=free)
        monkeypatch.setattr("shutil.disk_usage", lambda path, usage=usage: usage)
        with (
            pytest.raises(OSError, match=told) as caught,
            AudioWriter(tmp_path / "a.wav", "wav", "float32", RATE, 250.0, 10, False) as file,
        ):
            file.write(np.zeros(10), None)
        assert (caught.value.errno == errno.ENOSPC) == (free == 0)


def test_a_full_disk_leaves_no_half_file_and_the_next_run_goes_on(parts, tmp_path, monkeypatch):
    write, written = AudioWriter.write, []

    def fill_up(self, drive_v, trigger):
        if len(written) == 1:  # the second file
            raise OSError(28, "No space left on device")
        written.append(self.path)
        write(self, drive_v, trigger)

    with monkeypatch.context() as patch:
        patch.setattr(AudioWriter, "write", fill_up)
        with pytest.raises(InputError, match=r"No space left.*at /.*continues"):
            parts.make(tmp_path)
    assert tree(tmp_path) == {}  # nothing bears a final name
    result = parts.make(tmp_path)
    assert result.reused == 1
    other = tmp_path / "other"
    parts.make(other)
    assert tree(tmp_path) == tree(other)


def test_a_real_short_write_is_noticed(tmp_path):
    """The system refuses to let a file grow: the library below must not call that success."""
    resource = pytest.importorskip("resource", reason="needs POSIX's limit of a file's size")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    path = tmp_path / "a.wav"
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, before[1]))
        with (
            pytest.raises(OSError, match=r"a\.wav"),
            AudioWriter(path, "wav", "float32", RATE, 250.0, 10**6, False) as file,
        ):
            for _ in range(10):
                file.write(np.zeros(65_536), None)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_set_above_the_ceiling_is_rejected_whole(finger, screen, tmp_path):
    loud = Stimulus("loud", Constant(150.0).lasting(0.1), "volts")
    parts = StimulusSet("set", (*tones(), loud), finger, (screen,), ceiling_v=140.0)
    with pytest.raises(LimitError, match=r"loud\.wav.*ceiling"):
        parts.make(tmp_path / "set")
    assert tree(tmp_path / "set") == {} and not list((tmp_path / "set").iterdir())
    with pytest.raises(LimitError, match=r"250 V .*200 V"):
        StimulusSet("set", tones(), finger, (screen,), ceiling_v=250.0, full_scale_v=300)


def test_a_set_of_too_much_energy_or_a_mean_is_rejected_whole(finger, screen, tmp_path):
    """A square at the ceiling has twice the energy of a sine; a half wave has a mean."""
    square = np.clip(900 * np.sin(2 * np.pi * 50 * np.arange(96_000) / RATE), -195, 195)
    for name, wave, pattern in (("energy", square, "rms over"), ("mean", square * 0 + 90, "mean")):
        soundfile.write(tmp_path / f"{name}.wav", wave / 250, 48_000, "FLOAT")
        signal = Recorded(str(tmp_path / f"{name}.wav"), gain=250.0)
        bad = Stimulus(name, signal, "volts", carrier_hz=None, drive_hz=100.0)
        parts = StimulusSet("set", (*tones(), bad), finger, (screen,))
        with pytest.raises(LimitError, match=pattern):
            parts.make(tmp_path / "set")
        assert not list((tmp_path / "set").iterdir())


def test_the_expected_current_is_told_and_an_earthed_person_lowers_the_drive(finger, tmp_path):
    """A sine of 60 V at 120 Hz: its current by hand, C w V, through contact and body in series."""
    tone = Stimulus(
        "tone", Sine(60.0, 120.0).lasting(0.2), "volts", carrier_hz=None, drive_hz=120.0
    )
    earthed = Screen(name="earthed", body_capacitance_f=10e-9)
    for screen in (Screen(), earthed):
        (table,) = (
            StimulusSet("set", (tone,), finger, (screen,)).make(tmp_path / screen.name).sidecars
        )
        current = table["current"]
        series = 1 / (1 / current["contact_capacitance_f"] + 1 / current["body_capacitance_f"])
        assert current["capacitance_f"] == pytest.approx(series)
        peak_a = series * 2 * np.pi * 120 * 60
        assert current["expected_peak_a"] == pytest.approx(peak_a, rel=1e-3)
        assert current["expected_rms_a"] == pytest.approx(peak_a / np.sqrt(2), rel=1e-2)
    assert current["body_capacitance_f"] == 10e-9
    # 0.7 mA through 10 nF are 70 kV/s: 2.8 V at 4 kHz, so that nothing is left to be felt.
    carried = Stimulus("fine", Constant(0.05).lasting(0.05))
    with pytest.raises(RangeError, match="3 V"):
        StimulusSet("set", (carried,), finger, (earthed,)).make(tmp_path / "none")


def test_unreachable_friction_is_reported_for_each_with_the_nearest(finger, screen, tmp_path):
    model = ContactModel(finger, screen)
    lowest, highest = model.solve(0.5, torch.tensor([0.0, 185.7]), 4000.0).mu.tolist()
    stimuli = (
        Stimulus("fine", Constant(0.05).lasting(0.05)),
        Stimulus("high", Constant(0.9).lasting(0.05)),
        Stimulus("low", Sine(0.05, 20.0).lasting(0.1)),
    )
    parts = StimulusSet("set", stimuli, finger, (screen,))
    with pytest.raises(RangeError) as caught:
        parts.make(tmp_path)
    high, low = (line for line in str(caught.value).splitlines() if ".wav" in line)
    assert "high.wav" in high and "voltage limit, 186 V" in high
    assert "low.wav" in low
    # As the model says without a surface, to the 2 % of a JND that a surface may be off.
    jnd = 0.11 * lowest
    said = float(re.search(r"highest is ([0-9.]+)", high)[1])
    assert said == pytest.approx(highest, abs=0.02 * jnd)
    said = float(re.search(r"lowest is ([0-9.]+)", low)[1])
    assert said == pytest.approx(lowest, abs=0.02 * jnd)
    assert tree(tmp_path) == {}
    nearest = StimulusSet("set", stimuli, finger, (screen,), unreachable="nearest")
    tables = {table["name"]: table for table in nearest.make(tmp_path).sidecars}
    assert tables["high"]["wanted"]["share_above_reach"] == 1.0
    assert tables["low"]["wanted"]["share_below_reach"] == pytest.approx(0.5, abs=0.02)
    assert tables["fine"]["wanted"]["share_above_reach"] == 0.0
    assert tables["high"]["peak_v"] <= 185.7


def test_equal_friction_has_each_screens_own_volts(finger, tmp_path):
    """The reason for profiles: one friction, two screens, two voltages."""
    thin = Screen(name="thin", insulator_thickness_m=0.5e-6)
    thick = Screen(name="thick", insulator_thickness_m=2e-6)
    wanted = Stimulus("same", (Sine(0.004, 20.0) + 0.272).lasting(0.2), "mu")
    stimuli, screens = equal_friction([wanted], [thin, thick])
    result = StimulusSet("pair", stimuli, finger, screens).make(tmp_path)
    first, second = result.sidecars
    assert [first["file"], second["file"]] == ["same_on_thin.wav", "same_on_thick.wav"]
    assert first["predicted"]["mu_high"] == pytest.approx(second["predicted"]["mu_high"])
    assert first["predicted"]["mu_high"] == pytest.approx(0.276, abs=1e-6)
    assert second["peak_v"] > 1.02 * first["peak_v"]
    assert first["profile_hash"] != second["profile_hash"]
    profiles = json.loads((tmp_path / "profiles.json").read_text())
    assert profiles[second["profile_hash"]]["screen"]["insulator_thickness_m"] == 2e-6
    # Each screen has a session of its own, with the triggers of its files.
    for table in (first, second):
        name = f"events_on_{table['screen']}.tsv"
        with (tmp_path / name).open(newline="") as file:
            (row,) = csv.DictReader(file, delimiter="\t")
        assert row["stim_file"] == table["file"]
        assert int(row["trigger"]) == table["trigger"]["onset_code"] == 1
    with pytest.raises(InputError, match="two screens"):
        equal_friction([wanted], [thin])
    with pytest.raises(InputError, match='"mu"'):
        equal_friction(tones(), [thin, thick])


def test_a_calibrated_finger_is_no_placeholder(finger, screen, tmp_path):
    measured = MeasuredRoughness.of(finger.roughness.spectrum(), "a profilometer")
    skin = finger.dielectric.model_copy(update={"is_placeholder": False})
    mine = finger.replace(roughness=measured, dielectric=skin)
    one = (tones()[0],)
    table = StimulusSet("set", one, mine, (screen,)).make(tmp_path).sidecars[0]
    assert table["is_placeholder"] is False and table["placeholders"] == []


def test_a_population_states_its_band(finger, screen, tmp_path):
    people = Population.around(finger, 3, {"frictional_shear_stress_pa": 0.2}, seed=1)
    table = StimulusSet("set", (tones()[0],), people, (screen,)).make(tmp_path).sidecars[0]
    band = table["predicted"]["over_fingers"]
    assert band["percentiles"] == [5.0, 50.0, 95.0]
    low, middle, high = band["mu_high"]
    assert low < middle < high
    assert middle == pytest.approx(table["predicted"]["mu_high"], rel=1e-3)
    # tau_f scales friction and nothing else: contrast is the same for all.
    assert np.ptp(band["contrast_high"]) < 1e-3
    assert "log-normal" in table["fingers"]
    assert len(table["surface_hash"]) == 3


def test_designs():
    def make(name, hz, force):
        return Stimulus(name, Sine(0.05, hz).lasting(0.1), normal_force_n=force)

    made = full_factorial("f", make, hz=[5.0, 10.0, 20.0], force=[0.3, 0.6])
    assert [one.name for one in made] == [f"f-0{k}" for k in range(1, 7)]
    assert [(one.conditions["hz"], one.conditions["force"]) for one in made] == [
        (hz, force) for hz in (5.0, 10.0, 20.0) for force in (0.3, 0.6)
    ]
    levels = constant_stimuli(
        "c", lambda name, a: Stimulus(name, Sine(a, 5.0).lasting(1.0)), 0.02, [-6, 0, 6]
    )
    amplitudes = [one.conditions["amplitude"] for one in levels]
    assert 20 * np.log10(np.array(amplitudes) / 0.02) == pytest.approx([-6, 0, 6])
    with pytest.raises(InputError, match="hz"):
        full_factorial("f", make, hz=[])
    with pytest.raises(InputError, match="threshold"):
        constant_stimuli("c", make, -1.0, [0])


@pytest.mark.parametrize(
    ("fields", "pattern"),
    [
        ({"container": "mp3"}, "mp3"),
        ({"container": "flac"}, "24-bit"),
        ({"sample_rate_hz": 44_100.5}, "whole number"),
        ({"full_scale_v": 200.0}, "more than the ceiling"),
        ({"stimuli": ()}, "at least one"),
        ({"stimuli": (*tones(), tones()[0])}, "two are called 'sine'"),
        ({"stimuli": (Stimulus("events", Constant(0.1).lasting(1.0)),)}, "'events'"),
        ({"unreachable": "clip"}, "reject"),
        ({"screens": (Screen(), Screen())}, "same name"),
    ],
)
def test_wrong_sets_are_refused(finger, screen, fields, pattern):
    given = {"name": "x", "stimuli": tones(), "finger": finger, "screens": (screen,), **fields}
    with pytest.raises(HaptixError, match=pattern):
        StimulusSet(**given)


def test_folders_that_cannot_be_used_are_said(parts, tmp_path):
    (tmp_path / "file").write_text("x")
    with pytest.raises(InputError, match="is a file"):
        parts.make(tmp_path / "file")
    with pytest.raises(FileFormatError, match="manifest"):
        check_manifest(tmp_path)


def test_a_direct_drive_needs_its_frequency(finger, screen, tmp_path):
    direct = Stimulus("a", Sine(50.0, 100.0).lasting(0.1), "volts", carrier_hz=None)
    with pytest.raises(InputError, match="drive_hz"):
        StimulusSet("x", (direct,), finger, (screen,)).make(tmp_path)


def test_a_single_sample_is_a_stimulus(finger, screen, tmp_path):
    one = Stimulus("tick", Constant(0.05).lasting(1 / RATE))
    (table,) = StimulusSet("x", (one,), finger, (screen,)).make(tmp_path).sidecars
    assert table["samples"] == 1 and table["felt"]["sensation_db"] < 0
    none = Stimulus("none", Constant(0.05).lasting(0.1 / RATE))
    with pytest.raises(InputError, match="one sample"):
        StimulusSet("x", (none,), finger, (screen,)).make(tmp_path)


def test_a_grating_carries_its_speed_into_the_sidecar(finger, screen, tmp_path):
    one = stimulus_from(
        "g",
        {
            "length_s": 0.1,
            "speed": 50,
            "signal": {"kind": "grating", "amplitude": 0.02, "offset": 0.05, "period_mm": 2},
        },
    )
    assert isinstance(one.signal, Excerpt)
    assert one.signal.of == grating(0.02, 2, 50, offset=0.05)
    table = StimulusSet("x", (one,), finger, (screen,)).make(tmp_path).sidecars[0]
    assert table["speed"] == {"kind": "steady-speed", "speed_mm_per_s": 50.0}
