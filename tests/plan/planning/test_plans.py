"""What planning decides, against the contact model itself."""

import json
import re
from itertools import pairwise
from math import log

import pytest
import torch

from haptix import ContactModel, Finger, InputError
from haptix.plan.planning import plan_scene
from haptix.plan.trials import Choice, Trials

WEBER_FRACTION = 0.11  # physics page, section 7


def changed(scene, **override):
    return scene.replace(override=override)


def rows(plan):
    return {row.name: row for row in plan.rows}


@pytest.fixture(scope="module")
def carrier_plan(carrier):
    return plan_scene(carrier)


def other_points(scene, seed):
    """Random states of a scene, drawn in another way than planning draws them."""
    generator = torch.Generator().manual_seed(seed)

    def uniform(low, high):
        share = torch.rand(400, generator=generator, dtype=torch.float64)
        return torch.exp(log(low) + share * (log(high) - log(low)))

    ranges = scene.ranges()
    force, frequency, h0 = (
        uniform(*ranges[name]) for name in ("normal_force_n", "frequency_hz", "h0_m")
    )
    return force, frequency, h0, torch.rand(400, generator=generator, dtype=torch.float64)


def full_model(scene):
    return ContactModel(scene.finger, scene.screen, terms=scene.terms())


def test_terms_without_effect_are_dropped_and_those_with_a_large_one_kept(
    carrier, carrier_plan, plain_plan
):
    found = rows(plain_plan)
    # With an exponent of 0 the area at 1 N is the area: switching the term off changes no bit.
    assert found["apparent-area"].effect.mu_max == 0
    assert not found["apparent-area"].kept
    assert "apparent-area" not in plain_plan.model.terms
    # Under a stiff layer the soft tissue carries long waves: theory says it is no detail, which is
    # half of the budget, more than leaving things out may cost.
    place = (carrier.normal_force_n[0], carrier.max_voltage_v, carrier.ranges()["frequency_hz"][0])
    layered, solid = (
        float(ContactModel(carrier.finger, carrier.screen, terms=terms).solve(*place).mu)
        for terms in (carrier.terms(), carrier.terms() - {"layered-skin"})
    )
    effect = abs(solid / layered - 1) / WEBER_FRACTION
    assert effect > 0.5 * carrier.budget_jnd
    found = rows(carrier_plan)
    assert found["layered-skin"].effect.jnd_max >= (1 - 1e-6) * effect
    assert found["layered-skin"].kept
    assert "layered-skin" in carrier_plan.model.terms
    # What the profiles have no numbers for has no effect, and the row says what is missing.
    assert not found["plasticity"].kept
    assert "finger.hardness_pa" in found["plasticity"].why


def test_an_effect_is_the_difference_that_switching_makes(carrier, carrier_plan):
    with_it, without, chosen = (
        ContactModel(carrier.finger, carrier.screen, terms=terms)
        for terms in (
            carrier.terms(),
            carrier.terms() - {"skin-dielectric"},
            carrier_plan.model.terms,
        )
    )
    force, frequency, h0, share = other_points(carrier, seed=1)
    end = torch.minimum(
        0.9 * with_it.solve(force, 0.0, frequency, h0).pull_in_voltage_v,
        torch.tensor(carrier.max_voltage_v, dtype=torch.float64),
    )
    mu = with_it.solve(force, share * end, frequency, h0).mu
    # The planned model has the terms that were kept, and the tables of the trials: it rounds to
    # float32.
    planned = carrier_plan.model.solve(force, share * end, frequency, h0).mu
    same = chosen.solve(force, share * end, frequency, h0).mu
    assert torch.allclose(planned.to(torch.float64), same, rtol=1e-7, atol=0)
    difference = (without.solve(force, share * end, frequency, h0).mu - mu).abs()
    row = rows(carrier_plan)["skin-dielectric"]
    # Its points have the corners, where effects are largest: none at random is larger.
    assert float(difference.max()) <= row.effect.mu_max
    # 400 points over two quantities come near the corner, about which the effect is steep.
    assert float((difference / (WEBER_FRACTION * mu)).max()) > 0.7 * row.effect.jnd_max


@pytest.mark.parametrize("which", ["carrier", "plain"])
def test_what_is_planned_keeps_the_budget_at_other_points(which, request):
    scene = request.getfixturevalue(which)
    plan = request.getfixturevalue(f"{which}_plan")
    full = full_model(scene)
    surface = plan.build()
    force, frequency, h0, share = other_points(scene, seed=2)
    held = {
        name: None if len(getattr(surface, name).nodes) == 1 else value
        for name, value in (("frequency_hz", frequency), ("h0_m", h0))
    }
    voltage = share.sqrt() * surface.highest_voltage(force, **held).to(torch.float64)
    sample = surface.evaluate(force, voltage, **held)
    inside = sample.status == 0
    assert float(inside.double().mean()) > 0.99  # the last volt may round past the end
    truth = full.solve(force, voltage, frequency, h0).mu
    lost = (sample.mu.to(torch.float64) - truth).abs() / (WEBER_FRACTION * truth)
    assert float(lost[inside].max()) <= scene.budget_jnd


def test_one_carrier_on_one_screen_gets_a_surface_of_two_dimensions(carrier_plan):
    surface = carrier_plan.build()
    assert len(surface.frequency_hz.nodes) == len(surface.h0_m.nodes) == 1
    assert len(surface.normal_force_n.nodes) > 1
    assert surface.mu_table.dtype == carrier_plan.dtype
    assert surface.info["notes"]["plan"] == json.loads(json.dumps(carrier_plan.record()))


def test_a_narrow_axis_is_collapsed_to_its_middle(plain, plain_plan):
    row = rows(plain_plan)["frequency_hz"]
    assert row.effect.jnd_max < 0.05  # of the 20 Hz between 200 and 220
    assert not row.kept
    assert plain_plan.ranges["frequency_hz"] == pytest.approx((44000**0.5,) * 2)


@pytest.mark.slow
def test_a_larger_budget_never_keeps_more(plain):
    wider = plain.replace(
        h0_m=(0.1e-6, 0.2e-6), override={"terms": {"breakdown": False}}, normal_force_n=(0.1, 1.0)
    )
    kept = []
    for budget in (1.2e-5, 0.5, 50.0):
        plan = plan_scene(wider.replace(budget_jnd=budget), points=100)
        assert plan.effect.jnd_max <= budget / 2  # the share for modelling
        kept.append({row.name for row in plan.rows if row.kept})
    for small, large in pairwise(kept):
        assert large <= small
    # Not because nothing ever changes: the smallest budget keeps what a vast one drops.
    assert {"h0_m", "finite-size", "mean-field"} <= kept[0]
    assert not kept[-1] & {"h0_m", "finite-size", "mean-field"}


def test_the_same_scene_has_the_same_plan(plain_plan):
    again = plan_scene(plain_plan.scene, points=150)
    assert json.dumps(again.record()) == json.dumps(plain_plan.record())


def test_overrides_win(plain):
    plan = plan_scene(
        changed(
            plain,
            terms={"apparent-area": True, "skin-dielectric": False, "breakdown": True},
            axes={"frequency_hz": "keep"},
            dtype="float64",
            fidelity="mean-field",
            tolerance="0.1 JND",
        ),
        points=100,
    )
    found = rows(plan)
    for name, kept in [
        ("apparent-area", True),
        ("skin-dielectric", False),
        ("breakdown", True),
        ("frequency_hz", True),
        ("mean-field", True),
    ]:
        assert found[name].kept is kept
        assert "by the scene" in found[name].why
    assert {"apparent-area", "breakdown"} <= plan.model.terms
    assert "skin-dielectric" not in plan.model.terms
    assert plan.ranges["frequency_hz"] == (200.0, 220.0)
    assert plan.dtype == torch.float64
    assert str(plan.tolerance) == "0.1 JND"
    # The cost of what was forced is told, though it is not held against the rest.
    assert found["skin-dielectric"].effect.mu_max > 0


def test_overrides_the_other_way(plain):
    plan = plan_scene(
        changed(
            plain,
            terms={"breakdown": False},
            axes={"frequency_hz": "collapse"},
            dtype="float32",
            fidelity="closed-form",
        ),
        points=100,
    )
    found = rows(plan)
    assert plan.model.fidelity == "closed-form"
    assert "breakdown" not in plan.model.terms
    assert "contradicts" in found["finite-size"].why
    assert not any(found[name].kept for name in ("frequency_hz", "mean-field"))
    assert plan.model.dtype == torch.float32


@pytest.mark.parametrize(
    ("override", "sentence"),
    [
        ({"terms": {"plasticity": True}}, "needs finger.hardness_pa"),
        ({"terms": {"finite-size": True}, "fidelity": "closed-form"}, "contradicts fidelity"),
        ({"tolerance": "much"}, "tolerance: expected"),
    ],
)
def test_overrides_that_cannot_be(plain, override, sentence):
    with pytest.raises(InputError, match=sentence):
        plan_scene(changed(plain, **override), points=100)


@pytest.mark.slow
def test_no_axis_is_collapsed_across_breakdown(plain):
    low, high = 0.1e-6, 0.2e-6
    scene = plain.replace(
        h0_m=(low, high),
        drive={"scheme": "direct", "frequency_hz": 200.0},
        override={"terms": {"breakdown": True}},
    )
    thinnest, middle = (
        full_model(scene).solve(0.5, 0.0, 200.0, h0).breakdown_voltage_v
        for h0 in (low, (low * high) ** 0.5)
    )
    assert middle > 1.1 * thinnest  # or the scene shows nothing
    row = rows(plan_scene(scene, points=100))["h0_m"]
    assert row.kept
    assert row.effect.overreach == pytest.approx(float(middle / thinnest) - 1)
    assert "past breakdown" in row.why


def test_breakdown_is_told_and_ends_a_surface_only_if_asked(plain):
    plan = plan_scene(plain, points=100)
    told = rows(plan)["breakdown"]
    assert not told.kept
    found = re.search(r"voltages reach (\d+)% of its voltage", told.why)
    # 60 V across no more than 350 V/um of the insulator, at the one frequency of the surface.
    low, high = plain.ranges()["frequency_hz"]
    assert plan.ranges["frequency_hz"] == pytest.approx(((low * high) ** 0.5,) * 2)
    thickness = full_model(plain).solver.terms.thickness(
        torch.tensor(plain.screen.h0_m, dtype=torch.float64),
        torch.tensor(plan.ranges["frequency_hz"], dtype=torch.float64),
    )
    expected = 60.0 / (350e6 * float(thickness.abs().min()))
    assert int(found[1]) == pytest.approx(100 * expected, abs=0.5)  # whole per cent


def test_points_end_where_a_surface_does(plain):
    everything = Choice(plain.terms() - {"breakdown"})
    trials = Trials(plain.replace(override={"terms": {"breakdown": False}}), everything, 100)
    end = trials.highest_voltage(everything, trials.points)
    places = {name: trials.points[name] for name in ("normal_force_n", "frequency_hz", "h0_m")}
    state = full_model(plain).solve(voltage_v=0.0, **places)
    assert bool((end <= 0.9 * state.pull_in_voltage_v + 1e-9).all())
    assert float(end.max()) <= 60.0
    thin = {**trials.points, "h0_m": trials.points["h0_m"] / 100}
    assert float(trials.highest_voltage(everything, thin).max()) <= 60.0


@pytest.mark.slow
def test_what_is_left_to_the_scene_is_measured_and_off(plain):
    plan = plan_scene(plain, points=50)
    for name in ("field-limit", "body-return"):
        row = rows(plan)[name]
        assert not row.kept
        assert "the scene does not ask" in row.why
        assert name not in plan.model.terms
    # 60 V are 0.9 times breakdown: no gap is held, but the body takes a tenth of the voltage.
    # Rounding: gaps that may be held have a column for each state.
    assert rows(plan)["field-limit"].effect.jnd_max < 1e-12
    assert rows(plan)["body-return"].effect.jnd_max > 0
    assert plan.pull_past_breakdown == plan.record()["pull_past_breakdown"] == 0
    asking = plain.replace(
        override={"terms": {"body-return": True}},
        screen=plain.screen.replace(body_capacitance_f=20e-12),
    )
    assert "body-return" in plan_scene(asking, points=50).model.terms


def test_a_budget_finer_than_the_model_is_refused_as_a_budget(carrier):
    with pytest.raises(InputError, match=r"budget_jnd: .*1e-05 JND.* got 1e-06"):
        plan_scene(carrier.replace(budget_jnd=1e-6))


def test_a_term_costs_the_time_that_it_adds(plain, monkeypatch):
    monkeypatch.setattr(Trials, "seconds", lambda self, choice: 1e-3 * len(choice.terms))
    plan = plan_scene(plain, points=50)
    on = plain.terms() - {"breakdown"}
    for row in plan.rows:
        expected = 1e-3 if row.kind == "term" and row.name in on else 0.0
        if row.kind != "fidelity":
            assert row.cost_s == pytest.approx(expected), row.name


def test_a_scene_may_refuse_what_was_not_shown(carrier, carrier_plan):
    assert carrier_plan.accuracy.startswith("theory: ")
    # Lighter loaded than elastic contacts that were compared, and its spots yield in part.
    dry = Finger.preset("dry").replace(hardness_pa=5e8)
    with pytest.raises(InputError, match=r"not_shown: .* under voltage.*docs/mean-field.md"):
        plan_scene(carrier.replace(finger=dry, not_shown="refuse"))
