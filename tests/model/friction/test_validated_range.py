"""x and the waves of the roll-off under a contact, and what is said below the validated ones."""

from math import inf, pi

import pytest
import torch

from haptix import ContactModel, Finger, Screen
from haptix.model.contact import Accuracy
from haptix.model.contact.accuracy import (
    HEAVIEST_X,
    UNDER_VOLTAGE,
    VALIDATED_WAVES,
    VALIDATED_X,
    beyond_validation,
    of_states,
)


def test_a_state_says_how_lightly_it_is_loaded_and_by_how_many_waves() -> None:
    finger = Finger.preset("semi-wet").replace(bulk_modulus_pa=None)
    state = ContactModel(finger, Screen()).solve(torch.tensor([0.1, 0.9]), 100.0)
    # The paper's pressures, E* and slope of 0.91 in two digits; physics page, section 8.
    expected = [3e3 / (40e6 / 0.75 * 0.91), 20e3 / (40e6 / 0.75 * 0.91)]
    assert state.x.tolist() == pytest.approx(expected, rel=0.02)
    area = [0.1 / 3e3, 0.9 / 20e3]
    waves = [one * (3992.9 / (2 * pi)) ** 2 for one in area]
    assert state.rolloff_waves.tolist() == pytest.approx(waves, rel=0.02)
    assert state.warnings() == []
    # A touch of 5 mN, on a tenth of the area.
    small = finger.replace(apparent_area_at_1n_m2=finger.apparent_area_at_1n_m2 / 10)
    (load, count) = ContactModel(small, Screen()).solve(5e-4, 10.0).warnings()
    assert "validated from 5e-05" in load
    assert "validated from 4" in count


def accuracy(theory: str | None, x: float, h0: float, pull: float, ratio: float) -> Accuracy:
    return of_states(theory, *(torch.tensor([value]) for value in (x, h0, pull, ratio)))


def test_the_interval_without_voltage_follows_the_load() -> None:
    usual, light, lightest = (
        accuracy("local", x, 1e-3, 0.0, 1.0) for x in (6e-4, 6e-5, 0.99 * VALIDATED_X)
    )
    assert 0 < float(usual.mu) < float(light.mu) < inf
    assert float(usual.ratio) == 0
    assert not usual.not_shown  # an insulator of any thickness: nothing attracts
    assert float(lightest.mu) == inf


def test_the_interval_of_the_ratio_grows_with_the_ratio_thin_insulators_and_light_loads() -> None:
    weak, strong, thin, light = (
        accuracy("local", x, h0, pull, ratio)
        for x, h0, pull, ratio in (
            (1e-3, 0.5, 1.0, 2.0),
            (1e-3, 0.5, 8.0, 9.0),
            (1e-3, 0.06, 1.0, 2.0),
            (1.5e-4, 0.5, 1.0, 2.0),
        )
    )
    assert 0 < float(weak.ratio) < float(strong.ratio)
    assert float(weak.ratio) < float(thin.ratio)
    assert float(weak.ratio) < float(light.ratio)
    for one in (weak, strong, thin, light):
        assert float(one.mu) > float(one.ratio)


@pytest.mark.parametrize("place", range(3))
@pytest.mark.parametrize("end", [0, 1])
def test_nothing_is_claimed_beyond_either_end(place: int, end: int) -> None:
    name, ends = list(UNDER_VOLTAGE.items())[place]
    values = [1e-3, 0.3, 2.0]
    values[place] = ends[end] * (1.01 if end else 0.99)
    if values[place] == 0:  # no attraction, and nothing to say of it
        return
    x, h0, pull = values
    said = accuracy("local", x, h0, pull, 3.0)
    (reason,) = said.not_shown
    assert name in reason
    assert float(said.ratio) == inf


def test_other_theories_and_models_have_no_interval() -> None:
    for theory in ("open-gaps", None):
        assert float(accuracy(theory, 1e-3, 0.3, 2.0, 3.0).mu) == inf


def test_a_state_at_200_v_does_not_have_the_accuracy_of_0_v() -> None:
    model = ContactModel(Finger.preset("semi-wet"), Screen())
    assert not model.solve(0.5, 0.0).accuracy.not_shown
    # Its insulator is 0.006 h_rms, thinner than any of the rows.
    assert any("h0/h_rms" in reason for reason in model.solve(0.5, 200.0).accuracy.not_shown)


def test_nothing_is_said_within_what_was_validated() -> None:
    ends = (VALIDATED_X, HEAVIEST_X, VALIDATED_WAVES)
    assert beyond_validation(*ends) == []
    for place, factor in enumerate((0.99, 1.01, 0.99)):
        beyond = [end * factor if i == place else end for i, end in enumerate(ends)]
        assert len(beyond_validation(*beyond)) == 1


def test_heavy_contact_has_no_interval() -> None:
    said = accuracy("local", 1.01 * HEAVIEST_X, 1e-3, 0.0, 1.0)
    assert float(said.mu) == inf
    assert "up to 0.1" in said.not_shown[0]
    assert said.record()["mu_percent"] is None
    state = ContactModel(Finger.preset("semi-wet"), Screen()).solve(0.5, 0.0)
    # A thousandth of the modulus: the same load is a heavy one.
    soft = Finger.preset("semi-wet").replace(youngs_modulus_pa=4e4, bulk_modulus_pa=None)
    heavy = ContactModel(soft, Screen()).solve(0.5, 0.0)
    assert not state.warnings()
    assert any("validated up to" in one for one in heavy.warnings())
