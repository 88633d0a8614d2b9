"""A session that scatter leaves undecided asks for the strokes that would decide it."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

import calibration.steps as steps
from calibration import Session, SessionInfo, Stroke
from calibration.fit.result import Fit
from calibration.plan.protocol import Protocol
from calibration.steps import Finished, finish_decided, plan_that_decides
from calibration.verify.steadiness import Steadiness
from calibration.verify.verification import Verification
from haptix.base.task import Context

OPEN = Verification((), 0.5, ("open",), is_open=True, steadiness=Steadiness(0.2))


@pytest.fixture
def session(tmp_path, finger, screen):
    plan = Protocol(
        strokes=[
            Stroke(number=n, normal_force_n=0.5, voltage_v=100.0, frequency_hz=125.0,
                   held_out=n > 4)
            for n in range(1, 9)
        ]
    )  # fmt: skip
    return Session.begin(tmp_path / "s", plan, SessionInfo(screen=screen, finger=finger))


@pytest.fixture
def quick(monkeypatch):
    """The verdicts of a test in place of a fit's; as many strokes as a plan for 2.2 % has."""
    verdicts = []
    monkeypatch.setattr(Fit, "load", lambda path: SimpleNamespace(theory="open-gaps"))
    monkeypatch.setattr(steps, "extended_plan", lambda *given: given[2].extended(10))
    monkeypatch.setattr(
        steps, "finish_folder", lambda folder, context: Finished(verdicts.pop(0), None, 4, {})
    )
    monkeypatch.setattr(steps, "StrokePredictor", lambda model: None)
    return verdicts


def test_it_goes_on_until_it_is_decided(session, quick):
    quick += [OPEN, replace(OPEN, failures=(), is_open=False)]
    asked = []

    def go_on(now, question):
        asked.append(question)
        assert len(now.protocol.held_out) == 10 and now.protocol.looks == 2
        added = now.protocol.strokes[8:]
        assert [one.number for one in added] == list(range(9, 15))
        assert all(one.held_out for one in added)
        return True

    found, known = finish_decided(session.folder, Context(), go_on)
    assert (found.verification.verdict, known, len(asked)) == ("passed", False, 1)
    assert "6 strokes more" in asked[0] and "0.9 minutes" in asked[0]  # 9 s each


def test_who_declines_keeps_the_session_and_its_verdict(session, quick):
    for one in session.protocol.strokes:
        session.path_of(one).parent.mkdir(exist_ok=True)
        session.path_of(one).touch()
    quick.append(OPEN)
    found, _ = finish_decided(session.folder, Context(), lambda now, question: False)
    assert found.verification.verdict == "failed"
    assert Session.open(session.folder).protocol == session.protocol


def test_what_is_wrong_or_was_looked_at_three_times_is_not_asked_again(session, quick):
    wrong = replace(OPEN, is_open=False)
    assert plan_that_decides(session.folder, wrong) is None
    plan = plan_that_decides(session.folder, OPEN)
    for _ in range(2):
        plan.save(session.folder / "protocol.toml")
        plan = plan_that_decides(session.folder, OPEN)
    assert plan is None


def test_a_session_that_was_stopped_between_its_files_begins(session, tmp_path):
    """Of either order in which the two were ever written."""
    for left in ("protocol.toml", "session.json"):
        folder = tmp_path / left
        folder.mkdir()
        (folder / left).write_bytes((session.folder / left).read_bytes())
        assert not Session.has_begun(folder)
        begun = Session.begin(folder, session.protocol, session.info)
        assert len(Session.open(folder).open_strokes) == 8 and begun.protocol == session.protocol
