"""Skin that softens under the screen, friction by speed, and the area that shear takes."""

import numpy as np
import pytest
import torch

from haptix import ContactModel, Finger, Scene, Screen
from haptix.feel.motion import Trajectory
from haptix.plan.planning import plan_scene
from haptix.play.virtual_finger import VirtualFinger
from haptix.play.virtual_finger.finger import LiveVirtualFinger

SCREEN = Screen.preset("3m-sct3250")
GEL = Finger(name="gel")  # a half-space: its tables are cheap
SKIN = Finger.preset("semi-wet")
FORCE = torch.tensor([0.1, 1.0], dtype=torch.float64)
VOLTS = torch.tensor([[0.0], [60.0]], dtype=torch.float64)


def mu_of(finger: Finger, *terms: str) -> torch.Tensor:
    model = ContactModel(finger, SCREEN, terms=dict.fromkeys(terms, True))
    return model.solve(FORCE, VOLTS, 200.0).mu


@pytest.mark.parametrize("finger", [GEL, SKIN], ids=["half-space", "layer"])
def test_softened_skin_is_skin_of_that_modulus(finger: Finger) -> None:
    covered = finger.replace(contact_time_s=7.0, softening_time_s=4.0, softened_share=0.5)
    left = 0.5 + 0.5 * np.exp(-7 / 4)
    soft = finger.replace(youngs_modulus_pa=finger.youngs_modulus_pa * left)
    # The same numbers take another way: rounding.
    torch.testing.assert_close(mu_of(covered, "occlusion"), mu_of(soft), rtol=1e-9, atol=0)


def test_at_the_first_touch_nothing_has_changed() -> None:
    covered = mu_of(GEL.replace(contact_time_s=0.0), "occlusion")
    torch.testing.assert_close(covered, mu_of(GEL), rtol=1e-12, atol=0)


def test_friction_rises_fivefold_in_ten_seconds_at_low_load() -> None:
    # Dzidek et al. (2017) find five times at low load. The defaults (a tenth of the modulus left,
    # 5 s) are not fitted to it; a quarter about it is what one finger differs from another by.
    early, late = (
        ContactModel(SKIN.replace(contact_time_s=t), SCREEN, terms={"occlusion": True})
        for t in (0.0, 10.0)
    )
    rise = float(late.solve(0.05, 0.0).mu / early.solve(0.05, 0.0).mu)
    assert rise == pytest.approx(5.0, rel=0.25)


@pytest.mark.parametrize("exponent", [-0.2, 0.3])
def test_friction_is_a_power_of_the_speed_and_its_contrast_is_not(exponent: float) -> None:
    slow, fast = (
        mu_of(GEL.replace(sliding_speed_mm_per_s=v, speed_exponent=exponent), "sliding-speed")
        for v in (10.0, 150.0)
    )
    torch.testing.assert_close(fast / slow, torch.full_like(fast, 15**exponent), rtol=1e-9, atol=0)
    torch.testing.assert_close(fast[1] / fast[0], slow[1] / slow[0], rtol=1e-12, atol=0)


def test_shear_leaves_a_finger_of_less_area() -> None:
    smaller = GEL.replace(apparent_area_at_1n_m2=0.7 * GEL.apparent_area_at_1n_m2)
    sheared = mu_of(GEL.replace(shear_area_loss=0.3), "shear-area")
    torch.testing.assert_close(sheared, mu_of(smaller), rtol=1e-9, atol=0)


def test_a_plan_says_what_each_costs_in_friction_and_in_contrast() -> None:
    drive = {"scheme": "carrier", "carrier_hz": 4000.0}
    scene = Scene(finger=GEL, screen=SCREEN, normal_force_n=(0.3, 0.6), drive=drive)
    rows = {row.name: row for row in plan_scene(scene, points=20).rows}
    speed, occlusion, shear = (rows[name] for name in ("sliding-speed", "occlusion", "shear-area"))
    assert not any(row.kept for row in (speed, occlusion, shear))
    # (200/30)^0.3 = 1.77 is 7 JND less at any voltage, and no contrast at all.
    assert speed.effect.jnd_max == pytest.approx((1 - (200 / 30) ** -0.3) / 0.11, rel=1e-6)
    assert speed.effect.contrast_jnd == 0.0
    assert occlusion.effect.jnd_max > 5
    assert occlusion.effect.contrast_jnd > shear.effect.contrast_jnd > 1e-3


PATH_S = np.array([0.0, 2.0, 2.1, 4.0])
PRESS_N = np.array([0.5, 0.5, 0.0, 0.5])


@pytest.fixture(scope="module")
def covered() -> ContactModel:
    finger = GEL.replace(softening_time_s=1.0, softened_share=0.5)
    return ContactModel(finger, SCREEN, "closed-form", terms={"occlusion": True})


def test_the_virtual_finger_softens_from_each_touch_on(covered: ContactModel) -> None:
    finger = VirtualFinger(covered, has_response=False)
    felt = finger.feel_carrier(
        np.full(400, 50.0), 100.0, 4000.0, PATH_S, 50 * PATH_S, 0.0, PRESS_N, output_rate_hz=50.0
    )
    for time in (0.3, 1.5, 3.5):
        at = int(time * 50)
        since = time if time < 2 else time - 2.1
        aged = covered.finger.replace(contact_time_s=since)
        model = ContactModel(aged, SCREEN, "closed-form", terms={"occlusion": True})
        expected = model.solve(float(felt.normal_force_n[at]), 50.0, 4000.0).mu
        # Friction between two moduli a quarter of ln E apart, and the touch known to a sample.
        assert felt.mu[at] == pytest.approx(float(expected), rel=0.01)


def test_a_live_finger_remembers_since_when_it_is_down(covered: ContactModel) -> None:
    whole = VirtualFinger(covered, has_response=False)
    live = LiveVirtualFinger(whole, 4000.0, rate_hz=50.0)
    volts, parts = np.full(400, 50.0), []
    for start in (0.0, 1.0):
        t_s = np.array([start, start + 1.0])
        path = Trajectory.of(t_s, 50 * t_s, 0.0, 0.5)
        parts.append(live.feel(volts, 100.0, 0.0, {1: path})[1].mu)
    t_s = np.array([0.0, 2.0])
    at_once = whole.feel_carrier(
        volts, 100.0, 4000.0, t_s, 50 * t_s, 0.0, 0.5, output_rate_hz=50.0
    ).mu
    np.testing.assert_allclose(np.concatenate(parts), at_once[:100], rtol=1e-9)


def test_the_virtual_finger_follows_the_speed_of_its_path() -> None:
    finger = GEL.replace(sliding_speed_mm_per_s=80.0, speed_exponent=0.3)
    model = ContactModel(finger, SCREEN, "closed-form", terms={"sliding-speed": True})
    t_s, x_mm = np.array([0.0, 0.5, 1.0]), np.array([0.0, 20.0, 100.0])  # 40, then 160 mm/s
    felt = VirtualFinger(model).feel(np.zeros(100), 100.0, t_s, x_mm, 0.0, 0.5, output_rate_hz=50.0)
    rest = float(ContactModel(finger, SCREEN, "closed-form").solve(0.5, 0.0).mu)
    assert felt.mu[10] == pytest.approx(rest * (40 / 30) ** 0.3, rel=1e-3)  # no field, no response
    assert felt.mu[40] == pytest.approx(rest * (160 / 30) ** 0.3, rel=1e-3)
