"""The PsychoPy plugin: its session against haptix, its component against stubs.

PsychoPy does not install here. `Stub*` follow the interface of its components: what
`psychopy.experiment.components` exports, how a Param is written into code by its type, and where
the tests of start and stop leave the indentation. The code that the component writes is run.
"""

import hashlib
import json
import sys
import tomllib
from dataclasses import replace
from importlib.metadata import EntryPoint
from io import StringIO
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
import soundfile

from firmware_io import DeviceBusyError
from haptix.base.errors import InputError, LimitError
from tests.waiting import wait_for

PLUGIN = Path(__file__).parents[2] / "clients" / "psychopy"
RATE, FULL_V = 48_000, 180.0


class StubParam:
    def __init__(self, val, valType, inputType="single", categ="Basic", hint="", label="",
                 updates=None, allowedUpdates=None):  # fmt: skip
        assert valType in ("str", "code", "file", "bool")
        self.val, self.valType = val, valType

    def __str__(self):
        text = str(self.val)
        if self.valType in ("str", "file"):
            return text[1:] if text.startswith("$") else repr(text)
        return text


class StubBuffer(StringIO):
    indentLevel = 0

    def setIndentLevel(self, level, relative=False):
        self.indentLevel = self.indentLevel + level if relative else level

    def writeIndentedLines(self, text):
        for line in text.splitlines():
            self.write("    " * self.indentLevel + line + "\n")


class StubBaseComponent:
    def __init__(self, exp, parentName, name="", startType="time (s)", startVal="",
                 stopType="duration (s)", stopVal="", startEstim="", durationEstim="",
                 saveStartStop=True, syncScreenRefresh=False, disabled=False):  # fmt: skip
        self.exp = exp
        self.params = {
            "name": StubParam(name, "code"),
            "startVal": StubParam(startVal, "code"),
            "stopVal": StubParam(stopVal, "code"),
        }

    def _test(self, buff, condition, status):
        before = buff.indentLevel
        buff.writeIndentedLines("if " + condition.format(**self.params) + ":\n")
        buff.setIndentLevel(+1, relative=True)
        buff.writeIndentedLines(f"{self.params['name']}.status = {status}\n")
        return buff.indentLevel - before

    def writeStartTestCode(self, buff):
        return self._test(buff, "{name}.status == NOT_STARTED and t >= {startVal}", "STARTED")

    def writeStopTestCode(self, buff):
        return self._test(buff, "{name}.status == STARTED and t >= {stopVal}", "FINISHED")

    def writeRoutineEndCode(self, buff):
        buff.writeIndentedLines(f"thisExp.addData('{self.params['name']}.started', 0.0)\n")


class StubExperiment:
    def __init__(self):
        self.imports = []

    def requireImport(self, importName, importFrom="", importAs=""):
        self.imports.append(f"from {importFrom} import {importName}")


@pytest.fixture
def plugin(monkeypatch):
    """Loads what the plugin's entry points name, as PsychoPy does."""
    components: Any = ModuleType("psychopy.experiment.components")
    components.BaseComponent, components.Param = StubBaseComponent, StubParam
    names = {"psychopy": ModuleType("psychopy")}
    names |= {"psychopy.experiment": ModuleType("psychopy.experiment")}
    for name, module in {**names, components.__name__: components}.items():
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.syspath_prepend(str(PLUGIN))
    groups = tomllib.loads((PLUGIN / "pyproject.toml").read_text())["project"]["entry-points"]
    yield lambda name: next(
        EntryPoint(name, group[name], "").load() for group in groups.values() if name in group
    )
    for name in [name for name in sys.modules if name.startswith("psychopy_haptix")]:
        del sys.modules[name]


def stimulus_file(folder, name="a.wav", seconds=0.2, volts=100.0):
    """A drive and its sidecar, written without haptix."""
    wave = volts / FULL_V * np.sin(2 * np.pi * 100 * np.arange(round(seconds * RATE)) / RATE)
    path = folder / name
    soundfile.write(path, wave, RATE, subtype="FLOAT")
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    path.with_suffix(".json").write_text(json.dumps({"full_scale_v": FULL_V, "sha256": digest}))
    return path


def driven(session):
    """Volts that the mock driver has played."""
    codes, _ = session.device.mock.output
    return codes / 32767 * session.device.capabilities.full_scale_v


def test_the_session_plays_a_file_and_tells_its_onset(plugin, tmp_path):
    now = {"s": 7.0}
    with plugin("HaptixSession")("mock:") as session:
        stimulus = plugin("HapticStimulus")(session)
        stimulus.load(stimulus_file(tmp_path), 7, lambda: now["s"])
        assert (stimulus.onset, stimulus.is_done) == (None, True)
        stimulus.play()
        wait_for(lambda: stimulus.is_done)
        stimulus.stop()
        volts = driven(session)
        assert np.abs(volts).max() == pytest.approx(100.0, rel=1e-3)
        assert volts[-1] == 0.0
        assert (stimulus.onset_by, stimulus.code) == ("driver", 7)
        # On the experiment's clock, which stood at 7 s: seconds before it, not days.
        assert abs(stimulus.onset - 7.0) < 30.0


def test_a_device_without_marks_estimates_the_onset(plugin, tmp_path, monkeypatch):
    session = plugin("HaptixSession")("mock:")
    without = replace(session.device.capabilities, takes_marks=False)
    monkeypatch.setattr(type(session.device), "capabilities", without)
    stimulus = plugin("HapticStimulus")(session)
    stimulus.load(stimulus_file(tmp_path, seconds=0.6))
    stimulus.play()
    wait_for(lambda: stimulus.is_done)
    assert stimulus.onset_by == "estimate"
    stimulus.close()
    stimulus.close()


def test_wrong_files_and_uses_say_what_to_do(plugin, tmp_path):
    with plugin("HaptixSession")("mock:") as session:
        stimulus = plugin("HapticStimulus")(session)
        with pytest.raises(InputError, match="nothing is loaded"):
            stimulus.play()
        with pytest.raises(InputError, match=r"sidecar gone\.json"):
            stimulus.load(tmp_path / "gone.wav")
        path = stimulus_file(tmp_path)
        path.write_bytes(path.read_bytes()[:-4] + b"\0\0\0\1")
        with pytest.raises(InputError, match="differs from what"):
            stimulus.load(path)
        stimulus.load(stimulus_file(tmp_path, "loud.wav", volts=179.0, seconds=2.0))
        session.in_use.acquire()
        with pytest.raises(DeviceBusyError):
            stimulus.play()
        session.in_use.release()
    with plugin("HaptixSession")("mock:ceiling_v=50") as session:
        stimulus = plugin("HapticStimulus")(session)
        stimulus.load(stimulus_file(tmp_path, "strong.wav"))
        stimulus.play()
        wait_for(lambda: stimulus.is_done)
        with pytest.raises(LimitError, match="ceiling"):
            stimulus.stop()
    with (
        plugin("HaptixSession")("mock:sample_rate_hz=96000") as session,
        pytest.raises(InputError, match="sample_rate_hz=48000"),
    ):
        plugin("HapticStimulus")(session).load(stimulus_file(tmp_path))


def run_experiment(component, frames, **named):
    """Run the code of an experiment with one routine, as Builder puts it together."""
    found: dict[str, Any] = {}
    space = {
        "NOT_STARTED": 0, "STARTED": 1, "FINISHED": -1,
        "globalClock": type("Clock", (), {"getTime": staticmethod(lambda: 5.0)}),
        "thisExp": type("Handler", (), {"addData": staticmethod(found.__setitem__)}),
        **named,
    }  # fmt: skip

    def run(*writers):
        buff = StubBuffer()
        for write in writers:
            write(buff)
            assert buff.indentLevel == 0
        exec(buff.getvalue(), space)

    exec("\n".join(component.exp.imports), space)
    run(component.writeInitCode, component.writeRoutineStartCode)
    stimulus: Any = space[component.params["name"].val]
    stimulus.status = space["NOT_STARTED"]
    for t in frames(stimulus):
        space["t"] = t
        run(component.writeFrameCode)
    session = stimulus.session
    run(component.writeRoutineEndCode)
    volts = driven(session)
    run(component.writeExperimentEndCode)
    return found, volts


def test_the_code_of_the_component_plays_and_saves(plugin, tmp_path):
    path = stimulus_file(tmp_path)
    component = plugin("HapticStimulusComponent")(
        StubExperiment(), "trial", "ridges",
        startVal=0.5, address="mock:", stimulus="$stim", code="c",
    )  # fmt: skip

    def frames(stimulus):
        yield 0.0
        assert stimulus.is_done and stimulus.status == 0
        yield 0.5
        # Begun, or even over: a busy machine may not look before the stimulus has passed.
        assert stimulus.status in (1, -1)
        wait_for(lambda: stimulus.is_done)
        yield 0.6
        assert stimulus.status == -1

    found, volts = run_experiment(component, frames, stim=str(path), c=42)
    assert np.abs(volts).max() == pytest.approx(100.0, rel=1e-3)
    assert found.keys() == {f"ridges.{one}" for one in
                            ("onset", "onset_by", "code", "sha256", "started")}  # fmt: skip
    assert (found["ridges.code"], found["ridges.onset_by"]) == (42, "driver")
    assert found["ridges.onset"] is not None


def test_a_stop_time_ends_it_at_zero(plugin, tmp_path):
    path = stimulus_file(tmp_path, seconds=20.0)
    component = plugin("HapticStimulusComponent")(
        StubExperiment(), "trial", "long", stopVal=1.0, address="mock:", stimulus=str(path)
    )

    def frames(stimulus):
        yield 0.0
        wait_for(lambda: stimulus.onset is not None)
        yield 1.0
        assert stimulus.is_done and stimulus.status == -1

    found, volts = run_experiment(component, frames)
    assert found["long.onset"] is not None
    assert np.abs(volts).max() > 99.0 and volts[-1] == 0.0
    assert volts.size < 20 * RATE  # it was cut short, however late this machine came to it
