"""x and the waves of the roll-off under a contact, and what is said below the validated ones."""

from collections import defaultdict
from math import inf, log, pi

import pytest
import torch

from benchmarks.yielding_spots import compared
from haptix import ContactModel, Finger, Screen
from haptix.model.contact import Accuracy
from haptix.model.contact.accuracy import (
    HEAVIEST_X,
    UNDER_VOLTAGE,
    VALIDATED_WAVES,
    VALIDATED_X,
    YIELDED,
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
    def beyond(lowest: float, highest: float, waves: float) -> list[str]:
        return beyond_validation(torch.tensor([lowest, highest]), torch.zeros(2), waves)

    ends = (1.01 * VALIDATED_X, 0.99 * HEAVIEST_X, VALIDATED_WAVES)
    assert beyond(*ends) == []
    for place, factor in enumerate((0.97, 1.03, 0.99)):
        assert (
            len(beyond(*(end * factor if i == place else end for i, end in enumerate(ends)))) == 1
        )


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


def yielded(
    x: float = 1e-5, area: float = 2e-4, h0: float = 0.01, pull: float = 0.01, ratio: float = 1.01
) -> Accuracy:
    """Accuracy of a state whose spots all yield."""
    x_, h0_, pull_, ratio_ = (torch.tensor([value]) for value in (x, h0, pull, ratio))
    return of_states("local", x_, h0_, pull_, ratio_, area)


def test_the_interval_of_yielding_spots_is_in_proportion_to_what_the_voltage_adds() -> None:
    weak, strong = yielded(ratio=1.01), yielded(ratio=1.02)
    assert not weak.not_shown
    assert 0 < float(weak.ratio) < 0.01
    assert float(strong.ratio) / float(weak.ratio) == pytest.approx(log(1.02) / log(1.01), rel=1e-6)
    assert float(yielded(pull=0.0, ratio=1.0).ratio) == 0
    # An elastic contact of this load was compared with nothing.
    assert float(accuracy("local", 1e-5, 0.01, 0.01, 1.01).ratio) == inf


@pytest.mark.parametrize("place", range(4))
@pytest.mark.parametrize("end", [0, 1])
def test_nothing_is_claimed_of_yielding_spots_beyond_either_end(place: int, end: int) -> None:
    name, ends = list(YIELDED.items())[place]
    if ends[end] == 0:  # no attraction, and nothing to say of it
        return
    option, value = ("x", "area", "h0", "pull")[place], ends[end] * (1.01 if end else 0.99)
    beyond = yielded(**{option: value})
    (reason,) = beyond.not_shown
    assert name in reason
    assert float(beyond.ratio) == inf
    if option != "pull":  # load and area count without voltage too
        at_rest = yielded(**{option: value, "pull": 0.0, "ratio": 1.0})
        assert (float(at_rest.mu) == inf) == (option != "h0")


def test_yielding_spots_without_a_comparison_leave_the_others_of_a_batch_theirs() -> None:
    x, h0, pull, ratio = torch.tensor([[1e-3, 1e-5], [0.3, 0.01], [2.0, 0.01], [3.0, 1.01]])
    said = of_states("corrected", x, h0, pull, ratio, torch.tensor([0.0, 2e-4]))
    alone = accuracy("corrected", 1e-3, 0.3, 2.0, 3.0)
    assert said.ratio.tolist() == [float(alone.ratio), inf]
    assert said.mu.tolist() == [float(alone.mu), inf]
    assert said.not_shown == ('the theory "corrected" has no comparison where all spots yield',)


def test_rows_kept_out_of_the_choice_lie_in_the_interval_of_yielding_spots() -> None:
    inside: dict[str, list[bool]] = defaultdict(list)
    for row in compared():
        inside[row.group or ""] += row.inside
    kept_out = [group for group in inside if "kept out" in group]
    assert len(kept_out) == 2
    for group in kept_out:
        assert len(inside[group]) >= 15
        assert sum(inside[group]) >= 0.9 * len(inside[group])


def test_a_dry_finger_has_an_interval_and_one_that_yields_in_part_has_none() -> None:
    dry, screen = Finger.preset("dry"), Screen.preset("3m-sct3250")
    state = ContactModel(dry, screen).solve([0.1, 0.5, 1.0], 200.0, 4000.0)
    assert not state.accuracy.not_shown
    assert not state.warnings()
    ratio = state.mu / ContactModel(dry, screen).solve([0.1, 0.5, 1.0], 0.0, 4000.0).mu
    assert bool((state.accuracy.ratio <= torch.log(ratio)).all())
    # Ten times the hardness: elastic spots bear much of the load.
    harder = ContactModel(dry.replace(hardness_pa=5e8), screen).solve(0.5, 200.0, 4000.0)
    assert any("validated from 5e-05" in one for one in harder.accuracy.not_shown)
    assert any("validated from 5e-05" in one for one in harder.warnings())
