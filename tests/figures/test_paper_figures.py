"""What the paper's figures show comes out of the model."""

from math import log, pi, sqrt

import numpy as np
import pytest

from haptix import ContactModel, Finger, Screen, Status
from haptix.figures import draw

VOLTAGES = (50, 100, 150, 200)
LEAKY = ("1e7", "1e6", "1e5")


# Fig. 3B


def test_friction_ripples_at_twice_the_frequency_of_the_drive(figures):
    columns = figures["fig3b"].columns
    time = columns["time_ms"] / 1e3
    step = time[1] - time[0]
    assert time[-1] + step == pytest.approx(0.04)
    frequency = np.fft.rfftfreq(len(time), step)
    drive = np.abs(np.fft.rfft(columns["drive_v"]))
    friction = np.abs(np.fft.rfft(columns["friction_200v_n"]))
    assert frequency[drive.argmax()] == pytest.approx(125.0)
    assert frequency[1:][friction[1:].argmax()] == pytest.approx(250.0)
    # The pull is the same for both signs of the voltage: only rounding is left at odd harmonics.
    odd = np.isclose(frequency % 250.0, 125.0)
    assert friction[odd].max() < 1e-6 * friction[1:].max()


def test_the_ripple_rises_from_the_friction_without_voltage(figures):
    columns = figures["fig3b"].columns
    on, off = columns["friction_200v_n"], columns["friction_0v_n"]
    assert np.ptp(off) == 0
    assert (on >= off * (1 - 1e-12)).all()
    assert (columns["status_200v"] != Status.PULL_IN).all()
    assert np.abs(columns["drive_v"]).max() == pytest.approx(200.0)
    pull = columns["attraction_pa"]
    # Full depth: the paper's h0 has no loss. What is left is one table's least attraction.
    assert pull.min() < 1e-9 * pull.max()
    # The depth of the ripple, next to what real screens reach with the time-averaged pull.
    assert on.max() / off[0] > 1.2


# Fig. 3C


def test_friction_without_voltage_is_that_of_the_paper(figures):
    columns = figures["fig3c"].columns
    # 0.26 in two digits; the usual model has it at the paper's load.
    np.testing.assert_allclose(columns["mu_as_published_0v"], 0.26, atol=0.005)
    middle = np.abs(columns["normal_force_n"] - 0.5).argmin()
    assert columns["mu_0v"][middle] == pytest.approx(0.26, abs=0.01)


@pytest.mark.parametrize("kind", ["mu_", "mu_as_published_"])
def test_friction_rises_with_voltage_and_as_the_force_falls(figures, kind):
    columns = figures["fig3c"].columns
    assert columns["normal_force_n"][[0, -1]] == pytest.approx([0.1, 1.0])
    mu = np.array([columns[f"{kind}{v}v"] for v in (0, *VOLTAGES)])
    assert (np.diff(mu, axis=0) > 0).all()
    assert (np.diff(mu[1:], axis=1) < 0).all()
    for voltage in VOLTAGES:
        assert (columns[f"{kind.replace('mu', 'status')}{voltage}v"] != Status.PULL_IN).all()


def test_friction_in_time_and_against_force_have_one_set_up(figures):
    """One h0 and one set of terms, those of a query."""
    model = ContactModel(Finger.preset("semi-wet"), Screen.preset("3m-sct3250"))
    against = figures["fig3c"].columns
    for voltage, force in ((0.0, 1.0), (200.0, 1.0), (200.0, 0.1)):
        row = np.flatnonzero(against["normal_force_n"] == force)[0]
        asked = float(model.solve(force, voltage, h0_m=0.2e-6).mu)
        # The tables of attraction are laid out for the forces asked for: some 1e-6.
        assert against[f"mu_{voltage:g}v"][row] == pytest.approx(asked, rel=1e-5)
    off = figures["fig3b"].columns["friction_0v_n"][0]
    assert off == pytest.approx(against["mu_0v"][-1], rel=1e-9)
    # At the peak of the drive the attraction is twice the mean: that of sqrt(2) times the volts.
    peak = figures["fig3b"].columns["friction_200v_n"].max()
    wider = ContactModel(model.finger, Screen(max_voltage_v=300.0))
    assert peak == pytest.approx(float(wider.solve(1.0, 200 * sqrt(2), h0_m=0.2e-6).mu), rel=1e-4)


def test_the_published_finite_size_is_a_kink_in_the_curve_of_200_volts(figures):
    columns = figures["fig3c"].columns
    force, mu = columns["normal_force_n"], columns["mu_as_published_200v"]
    slope = np.diff(mu) / np.diff(force)
    bend = np.abs(np.diff(slope))
    at = bend.argmax()
    assert 0.15 < force[at + 1] < 0.9
    # A kink and no curvature: the slope changes within a step or two, and not beside it.
    beside = np.r_[bend[at - 12 : at - 2], bend[at + 3 : at + 13]]
    assert bend[at] > 10 * beside.max()
    assert slope[at - 2] < 5 * slope[at + 3] < 0
    # There the gap is as wide as the highest asperity. Forces stand 1 % apart, and the gap goes
    # with the logarithm of the pressure.
    published = ContactModel(
        Finger.preset("semi-wet"), Screen.preset("3m-sct3250"), theory="as-published"
    )
    area = 45.65e-6 * force[at + 1] ** 0.1366
    height = 22e-6 * sqrt(2 * log(area * (3992.9 / (2 * pi)) ** 2))
    gap = float(published.solve(force[at + 1], 200.0, h0_m=0.2e-6).mean_gap_m)
    assert gap == pytest.approx(height, rel=0.01)


# Fig. 3D


def test_a_thinner_insulator_raises_the_area_strongly(figures):
    columns = figures["fig3d"].columns
    voltage = columns["voltage_v"]
    names = [name for name in columns if name.startswith("area_fraction")]
    thickness = [float(name.removeprefix("area_fraction_h0_").removesuffix("um")) for name in names]
    assert thickness == sorted(thickness)
    area = np.array([columns[name] for name in names])
    assert np.ptp(area[:, 0]) == pytest.approx(0, abs=1e-12 * area[0, 0])
    drawn = area[:, voltage > 0]
    both = ~np.isnan(drawn[:-1]) & ~np.isnan(drawn[1:])
    assert (drawn[:-1] > drawn[1:])[both].all()
    highest = dict(zip(thickness, np.nanmax(area, axis=1) / area[:, 0], strict=True))
    # 0.05 um is 20 times thinner than 1 um: a multiple of the area against some per cent.
    assert highest[0.05] > 2
    assert 1 < highest[1.0] < 1.05


def test_the_area_without_voltage_is_that_of_light_load(figures):
    area = figures["fig3d"].columns["area_fraction_h0_1um"][0]
    # sqrt(8/pi) p0 / (E* slope). The soft tissue below lets long waves bend more easily, which
    # takes them out of the slope: they hold about a per cent of it.
    # Of the light contact the corrected law (Xu 2024) makes 1/sqrt(g) of Persson's, g = 0.48.
    half_space = sqrt(8 / pi / 0.48) * 10e3 / (100e6 / (1 - 0.5**2) * 0.91)
    assert area == pytest.approx(half_space, rel=0.03)


def test_nothing_is_drawn_past_pull_in(figures):
    data = figures["fig3d"]
    lines = draw(data).axes[0].lines
    crosses = {
        tuple(np.ravel(line.get_xydata()))
        for line in lines
        if line.get_marker() == "X" and len(line.get_xdata())
    }
    snapped = 0
    for name in [name for name in data.columns if name.startswith("status_")]:
        past = data.columns[name] == Status.PULL_IN
        area = data.columns[name.replace("status", "area_fraction")]
        np.testing.assert_array_equal(np.isnan(area), past)
        # Past it the voltage only rises: no light contact comes back.
        assert (np.diff(past.astype(int)) >= 0).all()
        if past.any():
            snapped += 1
            last = np.flatnonzero(~past)[-1]
            assert (data.columns["voltage_v"][last], area[last]) in crosses
    assert snapped == len(crosses) > 0


# Fig. 4


def test_without_leakage_low_frequencies_pull_most(figures):
    ratio = figures["fig4"].columns["area_on_over_off_dry_gap"]
    assert ratio.argmax() == 0
    assert (np.diff(ratio) <= 1e-12).all()
    assert (ratio > 1).all()


def test_leakage_takes_low_frequencies_away_and_leaves_a_maximum(figures):
    columns = figures["fig4"].columns
    frequency, dry = columns["frequency_hz"], columns["area_on_over_off_dry_gap"]
    tops = []
    for resistivity in LEAKY:
        ratio = columns[f"area_on_over_off_leaky_gap_{resistivity}_ohm_m"]
        top = ratio.argmax()
        assert 0 < top < len(ratio) - 1
        assert (np.diff(ratio[: top + 1]) >= -1e-12).all()
        assert (np.diff(ratio[top:]) <= 1e-12).all()
        # It vanishes: at 1 Hz no more than a hundredth of the maximum is left.
        assert ratio[0] - 1 < 0.01 * (ratio[top] - 1)
        # |eps_g| > 1 weakens the field whatever the frequency.
        assert (ratio < dry + 1e-12).all()
        tops.append((frequency[top], ratio[top]))
    # The better the gap insulates, the lower the frequency and the higher the maximum.
    (f7, r7), (f6, r6), (f5, r5) = tops
    assert f7 < f6 < f5
    assert r7 > r6 > r5
    # At 1 MHz w eps0 rho = 556 for 1e7 Ohm m: its square is the leakage's share.
    last = columns["area_on_over_off_leaky_gap_1e7_ohm_m"][-1]
    assert last - 1 == pytest.approx(dry[-1] - 1, rel=1e-2)


def test_area_against_pressure_agrees_with_boundary_elements(figures):
    columns = figures["fig2d"].columns
    pressure = columns["pressure_pa"]
    worst = {"as-published": 0.0, "corrected": 0.0}
    for voltage in ("0v", "50v", "100v", "150v", "200v"):
        marks = columns[f"area_fraction_boundary_elements_{voltage}"]
        for name in worst:
            line = columns[f"area_fraction_{name}_{voltage}"]
            there, drawn = np.isfinite(marks), np.isfinite(line)
            first, last = pressure[drawn][[0, -1]]
            within = there & (pressure >= first) & (pressure <= last)
            assert within.sum() >= 4
            at = np.exp(np.interp(np.log(pressure[within]), np.log(pressure[drawn]),
                                  np.log(line[drawn])))  # fmt: skip
            worst[name] = max(worst[name], float(np.abs(at / marks[within] - 1).max()))
    # Six surfaces scatter by up to 18 % near the instability; 15 % is what is asked of the theory.
    assert worst["corrected"] < 0.20
    assert worst["as-published"] > 0.30
