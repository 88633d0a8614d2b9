"""A new term: everything that solves a contact has it at once, or a test says what is missing."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

import haptix.model.terms
from calibration import Parameters, StrokePredictor
from calibration.fit.fitting import comparable_terms
from calibration.plan.predict import StrokeConditions
from haptix import ContactModel, Finger, Scene, Screen, Status
from haptix.model.fidelity import FIDELITIES
from haptix.model.presets import TERM_NAMES
from haptix.model.terms import TERMS, Properties, Stage, Term
from haptix.plan.planning import plan_scene
from haptix.play.virtual_finger import VirtualFinger

ROOT = Path(__file__).parents[3]
FINGER = Finger(name="gel")  # a half-space: its tables are cheap
SCREEN = Screen()


class ThinFilm(Term):
    """Halves the effective thickness of everything that insulates."""

    name = "thin-film"
    summary = "half of the insulation"
    source = "made up"
    uses = ("screen.insulator_thickness_m",)
    on_request = True

    def insulators(self, h0_m: Tensor, frequency_hz: Tensor, properties: Properties) -> Tensor:
        return h0_m / 2


@pytest.fixture(autouse=True)
def new_term(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setitem(TERMS, "thin-film", ThinFilm())
    yield


def test_the_table_of_names_has_every_class() -> None:
    classes = vars(haptix.model.terms).values()
    terms = [c for c in classes if isinstance(c, type) and issubclass(c, Term) and c is not Term]
    assert sorted(term.name for term in terms) == sorted(TERM_NAMES)


def models(**options: Any) -> tuple[ContactModel, ContactModel]:
    """A model with the new term, and one whose film is half as thick; no skin dielectric."""
    off = {"skin-dielectric": False}
    thin = Screen(insulator_thickness_m=SCREEN.insulator_thickness_m / 2)
    return (
        ContactModel(FINGER, SCREEN, terms={**off, "thin-film": True}, **options),
        ContactModel(FINGER, thin, terms=off, **options),
    )


@pytest.mark.parametrize("fidelity", ["mean-field", "closed-form"])
def test_the_contact_model_has_it(fidelity: str) -> None:
    new, thin = models(fidelity=fidelity)
    force, voltage = torch.tensor([0.1, 1.0]), torch.tensor([60.0, 150.0])
    found, expected = new.solve(force, voltage, 200.0), thin.solve(force, voltage, 200.0)
    torch.testing.assert_close(found.mu, expected.mu, rtol=1e-12, atol=0)
    thick = ContactModel(FINGER, SCREEN, fidelity=fidelity).solve(force, voltage, 200.0)
    assert bool((found.mu > 1.05 * thick.mu).all())
    period = new.over_period(0.3, 100.0, 200.0, samples=8).mu
    torch.testing.assert_close(period, thin.over_period(0.3, 100.0, 200.0, samples=8).mu)
    assert new.describe()["terms"]["thin-film"]["on"]
    assert not thin.describe()["terms"]["thin-film"]["on"]


def test_the_virtual_finger_has_it() -> None:
    new, thin = models(fidelity="closed-form")
    drive = 100.0 * np.sin(2 * np.pi * 300.0 * np.arange(4800) / 48_000)
    felt, expected = (
        VirtualFinger(model).feel(drive, 48_000, [0.0, 0.1], [0.0, 5.0], 0.0, 0.5).mu
        for model in (new, thin)
    )
    np.testing.assert_allclose(felt, expected, rtol=1e-12)
    assert felt.max() > 1.1 * felt.min()


def test_planning_weighs_it() -> None:
    scene = Scene(
        finger=FINGER,
        screen=SCREEN,
        normal_force_n=0.5,
        drive={"scheme": "direct", "frequency_hz": 200.0},
    )
    plan = plan_scene(scene, points=50)
    (row,) = (row for row in plan.rows if row.name == "thin-film")
    assert row.kept
    assert row.effect.jnd_max > 0.5
    assert "thin-film" in plan.model.terms


def test_calibration_predicts_and_compares_it() -> None:
    new, _ = models()
    plain = ContactModel(FINGER, SCREEN, terms={"skin-dielectric": False})
    strokes = StrokeConditions(*(np.array([v, v]) for v in (0.4, 120.0, 200.0, 50.0)))
    parameters = Parameters.of(FINGER, SCREEN)
    halved = parameters.started_at(h0_m=SCREEN.h0_m / 2)
    predictor = StrokePredictor(plain)
    with_it = StrokePredictor(new, predictor)(strokes, parameters.names, parameters.log_values)
    thinner = predictor(strokes, halved.names, halved.log_values)
    without = predictor(strokes, parameters.names, parameters.log_values)
    np.testing.assert_allclose(with_it.log_mu, thinner.log_mu, atol=1e-12)
    assert (with_it.log_mu > without.log_mu + 0.05).all()
    assert "thin-film" in comparable_terms()


def test_a_term_that_only_reports_is_left_to_the_scene(monkeypatch: pytest.MonkeyPatch) -> None:
    class Alarm(ThinFilm):
        name = "alarm"
        reports = Status.BREAKDOWN
        insulators = Term.insulators

        def status(self, status: Tensor, field: Any, properties: Properties) -> Tensor:
            return torch.full_like(status, int(Status.BREAKDOWN))

    alarm = Alarm()
    assert alarm.stages == {Stage.STATUS}
    assert not alarm.changes_friction
    monkeypatch.setitem(TERMS, "alarm", alarm)
    model = ContactModel(FINGER, SCREEN, "closed-form", terms={"alarm": True})
    assert int(model.solve(0.5, 0.0).status) == Status.BREAKDOWN
    assert model.reports(Status.BREAKDOWN)
    assert "alarm" not in comparable_terms()


def test_a_fidelity_refuses_what_it_does_not_honour() -> None:
    limits = {name: frozenset(Stage) - how.honours for name, how in FIDELITIES.items()}
    assert limits["mean-field"] == frozenset()
    for name, missing in limits.items():
        refused = {term.name for term in TERMS.values() if term.stages & missing}
        possible = haptix.model.terms.possible_terms(
            FINGER.replace(bulk_modulus_pa=1e4, hardness_pa=1e7),
            SCREEN.replace(gap_resistivity_ohm_m=1e7),
            FIDELITIES[name],
        )
        assert possible == set(TERMS) - refused


def test_every_term_is_complete(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(TERMS, "thin-film")
    page = (ROOT / "docs" / "terms.md").read_text(encoding="utf-8")
    assert set(re.findall(r"^## (\S+)$", page, re.M)) == set(TERMS), "docs/terms.md"
    for name, term in TERMS.items():
        assert type(term).__module__ == "haptix.model.terms"
        assert term.name == name
        assert term.stages, f"{name} changes nothing"
        assert term.summary and term.source and term.uses
        assert term.parameters(FINGER, SCREEN)  # raises where a field does not exist
