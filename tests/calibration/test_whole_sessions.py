"""Whole sessions on recordings of a virtual finger: a verdict left open, and defects."""

from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest

from calibration import Parameters, Session, SessionInfo
from calibration.keep.practice import (
    TRUTH,
    VIRTUAL_RIG,
    Person,
    Truth,
    VirtualFingerSource,
    draw_practice,
)
from calibration.measure.measuring import measure
from calibration.measure.rig import RIG, VoltsRead
from calibration.plan.protocol import short_protocol
from calibration.steps import finish_decided
from haptix.base.task import Context
from haptix.play.devices import open_device

VOLTS = 100.0

# Some of these sessions fail, and the profile that is written warns of it.
pytestmark = [
    pytest.mark.slow,
    pytest.mark.filterwarnings("default::haptix.model.screen.CalibrationWarning"),
]


class DefectiveSource(VirtualFingerSource):
    """A virtual finger whose recorded forces are changed by `defect(signals, stroke)`."""

    defect = staticmethod(lambda signals, stroke: {})
    reads = 1.0  # of both forces; the person goes by what is read
    weak = 0.0  # share of the highest volts that the amplifier lacks, behind its monitor

    def start(self, stroke, played):
        self._stroke = stroke
        felt = stroke.model_copy(update={"normal_force_n": stroke.normal_force_n / self.reads})
        share = 1 - self.weak * max(2 * stroke.voltage_v / VOLTS - 1, 0.0)
        super().start(felt, replace(played, volts=share * played.volts))
        self._signals["drive_v"] = played.at(self._signals["t_s"])
        for name in ("normal_force_n", "tangential_force_n"):
            self._signals[name] = self.reads * self._signals[name]

    def finish(self):
        signals = super().finish()
        return signals | self.defect(signals, self._stroke)


def rises_with_contact(signals, stroke):
    """By 30 % within 12 s of contact."""
    touched_s = np.cumsum(signals["normal_force_n"] > 0.05) * np.diff(signals["t_s"])[0]
    share = 1 + 0.3 * np.minimum(touched_s / 12.0, 1.0)
    return {"tangential_force_n": signals["tangential_force_n"] * share}


def rises_with_speed(signals, stroke):
    share = (stroke.speed_mm_per_s / 50.0) ** 0.15
    return {"tangential_force_n": signals["tangential_force_n"] * share}


@pytest.fixture
def begun(tmp_path, predictor, finger, screen):
    plan = short_protocol(predictor, Parameters.of(finger, screen).with_rig(), 3.0, VOLTS)
    folder = tmp_path / "s"
    folder.mkdir()
    draw_practice(folder, finger, screen, plan, seed=1)
    return Session.begin(folder, plan, SessionInfo(screen=screen, finger=finger))


def measured(session, person=None, seed=0, **faults):
    source = DefectiveSource(Truth.load(session.folder / TRUTH).model, person=person, seed=seed)
    for name, fault in faults.items():
        setattr(source, name, fault)
    with closing(open_device("mock:")) as device:
        return measure(session, source, device)


def test_an_open_verdict_goes_on_until_strokes_decide_it(begun):
    person = Person(repeatability=0.03)  # at 5 % no strokes would decide, and none are asked for
    assert not measured(begun, person).still_open
    first = len(begun.protocol.strokes)
    looks = []

    def go_on(session, question):
        looks.append((len(session.open_strokes), question))
        return not measured(session, person, seed=len(looks)).still_open

    found, was_known = finish_decided(begun.folder, Context(), go_on)
    assert looks and not was_known
    plan = Session.open(begun.folder).protocol
    assert len(plan.strokes) == first + sum(count for count, _ in looks)
    assert plan.looks == 1 + len(looks)
    assert all(f"{count} strokes more" in question for count, question in looks)
    # What was found is of all strokes, and is not asked about again.
    assert len(found.verification.strokes) == len(plan.held_out)
    assert len(looks) == 2 or not found.verification.is_open


@pytest.mark.parametrize("defect", [rises_with_contact, rises_with_speed])
def test_friction_that_the_model_lacks_is_refused(begun, defect):
    assert not measured(begun, defect=defect).still_open
    found, _ = finish_decided(begun.folder, Context())
    assert found.verification.verdict == "failed"


@pytest.mark.parametrize("weighed", [False, True])
def test_forces_that_both_read_too_little_are_found_by_the_weights_alone(begun, weighed):
    """Their friction looks right."""
    rig = VIRTUAL_RIG.replace(normal_gain=0.55, tangential_gain=0.55)
    rig.save(begun.folder / RIG) if weighed else (begun.folder / RIG).unlink()
    assert not measured(begun, reads=0.55).still_open
    found, _ = finish_decided(begun.folder, Context())
    if found.verification.passed:  # with the forces as the weights correct them
        assert weighed and found.practice.friction_error_worst_jnd < 0.5


def test_an_amplifier_weak_at_its_highest_volts_does_not_pass_unread(begun):
    """Its volts were read at one level only, where it is right."""
    lowest = VoltsRead(frequency_hz=125.0, monitor_v=0.25 * VOLTS, gain=1.0)
    VIRTUAL_RIG.replace(volts=[lowest]).save(begun.folder / RIG)
    assert not measured(begun, weak=0.12).still_open
    found, _ = finish_decided(begun.folder, Context())
    assert found.verification.verdict != "passed"
