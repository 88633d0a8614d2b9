"""The theory that strokes decide for is the one that is fitted and written."""

from types import SimpleNamespace

import pytest

from calibration import Parameters
from calibration.fit import fitting
from calibration.fit.fitting import DECISIVE, fit_in_best_theory
from calibration.fit.result import FormFit

NAME = 'theory "open-gaps"'


@pytest.fixture
def fitted(monkeypatch):
    """Fits of a set cost in each theory, in place of true ones."""

    def setup(evidence, costs=(50.0, 20.0)):
        made = []

        def fit_strokes(reduced, predictor, parameters, forms):
            theory = predictor.model.theory
            made.append((theory, parameters["frictional_shear_stress_pa"].value))
            cost = costs[theory == "open-gaps"]
            return SimpleNamespace(
                theory=theory, cost=cost, forms=(FormFit(NAME, evidence, 1.0, 0.1),)
            )

        monkeypatch.setattr(fitting, "fit_strokes", fit_strokes)
        monkeypatch.setattr(fitting, "other_forms", lambda *args, **options: {})
        return made

    return setup


def predictor(theory, shear):
    finger = SimpleNamespace(frictional_shear_stress_pa=shear)
    return SimpleNamespace(model=SimpleNamespace(theory=theory, finger=finger))


def chosen(parameters):
    forms = {NAME: predictor("open-gaps", 8e6)}
    return fit_in_best_theory(None, predictor("local", 5.5e6), parameters, forms)


def test_decisive_strokes_change_the_theory_and_its_start_of_tau_f(fitted, parameters):
    made = fitted(-DECISIVE - 1)
    found = chosen(parameters)
    assert found.fit.theory == "open-gaps"
    assert found.predictor.model.theory == "open-gaps"
    assert made[1] == ("open-gaps", 8e6)


@pytest.mark.parametrize("evidence", [-DECISIVE + 1, 30.0])
def test_others_keep_it(fitted, parameters, evidence):
    made = fitted(evidence)
    assert chosen(parameters).fit.theory == "local"
    assert len(made) == 1


def test_a_known_tau_f_belongs_to_its_theory(fitted, parameters):
    for known in (
        parameters.fixed(frictional_shear_stress_pa=5e6),
        parameters.known(frictional_shear_stress_pa=(5e6, 0.1)),
    ):
        fitted(-100.0)
        assert isinstance(known, Parameters)
        assert chosen(known).fit.theory == "local"


def test_a_fit_that_is_no_better_is_not_taken(fitted, parameters):
    fitted(-DECISIVE - 1, costs=(50.0, 60.0))
    assert chosen(parameters).fit.theory == "local"
