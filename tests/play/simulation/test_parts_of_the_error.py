"""Where the error comes from: each part vanishes when its cause does, and they add up."""

import numpy as np
import pytest

import haptix
from haptix.play.render import DirectWave, LiveSettings
from haptix.play.simulation import PARTS, Setting, simulate
from haptix.play.virtual_finger import TouchPanel

CARRIER_HZ = 4000.0
#: 0.7 mA through 150 pF. The driver's samples differ by whole codes, of 250 V in 32767, so that
#: rounding to codes adds no slew. The amplitude's own slope of 4e5 V/s stands at right angles to
#: the carrier's.
SAMPLE_STEP_CODES = 0.7e-3 / 150e-12 / 48e3 * 32767 / 250 // 1
HIGHEST_V = np.sqrt((SAMPLE_STEP_CODES * 250 / 32767 * 48e3) ** 2 - 4e5**2) / (
    2 * np.pi * CARRIER_HZ
)
PANEL = TouchPanel()


@pytest.fixture(scope="module")
def usual(simulation):
    return simulation


@pytest.fixture(scope="module")
def of_direct_drive(model):
    """A surface at 125 Hz, whose own error is 0.01 JND."""
    scene = {"normal_force_n": (0.3, 0.8), "frequency_hz": 125.0}
    return haptix.FrictionSurface.build(model, scene, tolerance=1e-3)


def test_the_parts_are_the_whole(usual):
    assert set(usual.parts) == set(PARTS)
    whole, parts = usual.evaluation, usual.parts.values()
    assert whole.evaluated > 0.9 * whole.samples
    assert {part.evaluated for part in parts} == {whole.evaluated}
    # Each part is felt less what was felt without it: the sum telescopes, sample by sample.
    assert sum(part.bias_mu for part in parts) == pytest.approx(whole.bias_mu, abs=1e-12)
    assert whole.error_rms_mu <= sum(part.error_rms_mu for part in parts) + 1e-12
    # And so none may be larger than the whole and all others together.
    for part in parts:
        others = sum(other.error_rms_mu for other in parts) - part.error_rms_mu
        assert part.error_rms_mu <= whole.error_rms_mu + others + 1e-12


def test_felt_and_target_are_where_the_finger_truly_is(usual, path, hills, surface):
    felt = usual.felt
    x, _, force = path.at(felt.t_s)
    np.testing.assert_allclose(felt.x_mm, x, atol=1e-9)
    low, high = (surface.mu(force, volts, CARRIER_HZ).numpy() for volts in (0.0, HIGHEST_V))
    share = 0.5 + 0.35 * np.sin(2 * np.pi * x / 6)
    np.testing.assert_allclose(usual.target_mu, low + share * (high - low), rtol=1e-9)
    assert usual.is_reachable.all()


def test_an_exact_surface_has_no_part_in_it(model, hills, path):
    # In closed form 1/mu is a straight line over the drive: at one force a surface is exact.
    closed = haptix.ContactModel(model.finger, model.screen, fidelity="closed-form")
    scene = {"normal_force_n": 0.5, "frequency_hz": CARRIER_HZ}
    exact = haptix.FrictionSurface.build(closed, scene)
    level = haptix.Trajectory(path.t_s, path.x_mm, path.y_mm, np.full_like(path.t_s, 0.5))
    found = simulate(Setting(closed, hills, level), exact, PANEL)
    # The secant stops at a relative 1e-13 of 1/mu, over a slope of up to 1/200 per volt.
    assert found.parts["surface"].error_max_mu < 1e-8
    assert found.parts["prediction"].error_max_mu > 1e-4


def test_the_surfaces_part_is_within_its_stated_error(model, setting, surface, usual):
    assert usual.parts["surface"].error_max_mu <= surface.info["error_max"]
    scene = {"normal_force_n": (0.3, 0.8), "frequency_hz": CARRIER_HZ}
    fine = haptix.FrictionSurface.build(model, scene, tolerance=1e-4)
    finer = simulate(setting, fine, PANEL).parts["surface"]
    assert finer.error_max_mu <= fine.info["error_max"]
    assert finer.error_rms_mu < usual.parts["surface"].error_rms_mu


@pytest.mark.slow
def test_prediction_has_little_part_with_touches_like_the_truth(setting, surface, usual):
    quick = TouchPanel(rate_hz=1000.0, latency_s=0.0)
    fast = LiveSettings(reaction_s=1e-3)
    found = simulate(setting, surface, quick, fast)
    # The first touches say nothing of the speed yet; after that the finger is followed.
    assert found.parts["prediction"].error_rms_mu < usual.parts["prediction"].error_rms_mu
    late = simulate(setting, surface, TouchPanel(latency_s=0.06))
    assert late.parts["prediction"].error_rms_mu > usual.parts["prediction"].error_rms_mu
    # What comes before the touches does not depend on them.
    for name in ("finger", "surface", "modulation", "quantisation"):
        assert found.parts[name].error_rms_mu == pytest.approx(
            late.parts[name].error_rms_mu, rel=0.35
        )


def test_quantisation_goes_with_the_step_of_the_device(setting, surface, usual):
    coarse = simulate(setting, surface, PANEL, address="mock:full_scale_v=1000")
    # Not the rms: where the path ends, the device's ramp is counted here, too.
    ratio = coarse.parts["quantisation"].error_p95_mu / usual.parts["quantisation"].error_p95_mu
    # Four times the step; the errors of the samples of a period partly cancel, by chance.
    assert 2 < ratio < 8
    assert usual.parts["quantisation"].error_p95_jnd < 0.01


@pytest.mark.slow  # two simulations; the parts are tested above
def test_a_finger_that_follows_at_once_has_no_part(model, surface, path):
    # Friction that is the same everywhere leaves nothing to smooth, once it has faded in.
    flat = haptix.Texture(np.full((2, 2), 0.5), width_mm=100.0, beyond="hold")
    level = haptix.Trajectory(path.t_s, path.x_mm, path.y_mm, np.full_like(path.t_s, 0.5))
    found = simulate(Setting(model, flat, level), surface, PANEL)
    # The end of fading in, whose tail the last twentieth still holds: 4e-4 JND.
    assert found.parts["finger"].error_p95_mu < 1e-5
    waves = haptix.feel.materials.Grating(period_mm=1.0, wave="square", low=0.15, high=0.85)
    rough = simulate(Setting(model, waves, level), surface, PANEL)
    assert rough.parts["finger"].error_p95_mu > 1e-4


def test_direct_drive_has_its_parts(model, path, of_direct_drive):
    wide = haptix.feel.materials.Grating(period_mm=20.0, wave="sine", low=0.2, high=0.7)
    found = simulate(
        Setting(model, wide, path, DirectWave(125.0, "square")), of_direct_drive, PANEL
    )
    assert set(found.parts) == {"modulation", "surface", "quantisation", "prediction"}
    total = sum(part.bias_mu for part in found.parts.values())
    assert total == pytest.approx(found.evaluation.bias_mu, abs=1e-12)


def test_a_direct_sine_gives_each_period_its_mean_and_leaves_ripple(
    model, path, usual, of_direct_drive
):
    # Bricks: edges within a period, 0.48 mm here.
    edges = haptix.feel.materials.Grating(period_mm=6.0, wave="square", low=0.15, high=0.85)
    found = simulate(Setting(model, edges, path, DirectWave(125.0)), of_direct_drive, PANEL)
    assert found.periods.average_s == 1 / 125.0
    # The figure for 125 Hz; the pulses between are felt beside it.
    assert found.periods.error_p95_jnd < 0.15 < found.parts["modulation"].error_p95_jnd
    assert usual.periods is None


def test_only_a_mock_can_be_felt(setting, surface, monkeypatch):
    opened = []
    monkeypatch.setattr("haptix.play.simulation.run.open_device", opened.append)
    with pytest.raises(haptix.InputError, match=r"mock device.*usb:"):
        simulate(setting, surface, address="usb:")
    assert not opened


def rises(shares):
    return shares == sorted(shares) and len(shares) > 1 and shares[-1] <= 1.0


def test_progress_rises(usual, progress):
    assert rises(progress)


def test_without_a_panel_the_surface_and_16_bits_are_what_is_left(setting, surface, usual):
    shares = []
    found = simulate(setting, surface, on_progress=shares.append)
    assert rises(shares)
    assert found.parts == {}
    # 5 ms fade in and 1 ms fades out, 60 samples of 10 kHz; and the edges of the window.
    lost = found.evaluation.samples - found.evaluation.evaluated
    assert 60 < lost < 80
    expected = usual.parts["surface"].error_max_mu + usual.parts["modulation"].error_max_mu
    assert found.evaluation.error_max_mu <= 1.1 * expected
