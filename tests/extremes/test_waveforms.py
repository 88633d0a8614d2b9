"""The attraction within a period, and its mean."""

import math

import numpy as np
import pytest
import torch
from torch import Tensor

from haptix import ContactModel, Finger, Screen, Status
from haptix.base.errors import InputError
from haptix.model.contact import HalfSpace, MeanField, RoughnessSpectrum
from haptix.model.contact.persson import GapHistogram
from haptix.model.electro import Pull, SkinDielectric
from haptix.model.electro.attraction import field_in_time
from haptix.model.terms import ActiveTerms, Properties
from haptix.model.waves import Waveform

EPS0 = 8.8541878128e-12
H0, VOLTAGE, FREQUENCY = 2e-7, 100.0, 200.0
PHASE = torch.arange(64, dtype=torch.float64) * (2 * math.pi / 64)
COSINE = Waveform(shift_turns=0.25)
SKIN = SkinDielectric(frequency_hz=(1.0,), permittivity=(2000.0,), resistivity_ohm_m=(1e5,))
INSULATORS = ActiveTerms(
    Properties(Finger(dielectric=SKIN, layer_thickness_m=2e-4), Screen()), {"skin-dielectric"}
)


@pytest.fixture(scope="module")
def contact() -> MeanField:
    return MeanField(RoughnessSpectrum.self_affine(5e-6, 0.8, 1e4, 1e4, 1e8), HalfSpace(40e6, 0.5))


@pytest.fixture(scope="module")
def gaps(contact: MeanField) -> GapHistogram:
    return contact.gap_histogram(2e5)


def lossless(frequency: Tensor) -> Tensor:
    return torch.full_like(frequency, H0).to(torch.complex128)


def lossy(frequency: Tensor) -> Tensor:
    # A constant voltage meets the screen's insulator alone: skin that conducts at all is short.
    return INSULATORS.thickness(torch.full_like(frequency, H0), frequency)


def stress(wave: Waveform, gaps: GapHistogram, thickness: object) -> tuple[Tensor, Tensor]:
    pull = Pull.of_field(
        gaps.edges_m, lambda gap_m: field_in_time(wave, gap_m, VOLTAGE, FREQUENCY, thickness, PHASE)
    )
    return gaps.mass @ pull.kernel[:, 0].T, 0.01 * pull.spot[:, 0]


@pytest.mark.parametrize("thickness", [lossless, lossy])
def test_a_sine_pulls_at_twice_its_frequency(
    thickness: object, gaps: GapHistogram, contact: MeanField
) -> None:
    open_, spots = stress(COSINE, gaps, thickness)
    h0 = thickness(torch.tensor([FREQUENCY], dtype=torch.float64))
    # Of the spots' 1 + cos(2wt + phase) everything is known: the field is V/h0, at its phase.
    turn = 2 * (PHASE + float(torch.angle(h0)))
    expected = EPS0 * VOLTAGE**2 / 4 * 0.01 / float(h0.abs()) ** 2 * (1 + torch.cos(turn))
    torch.testing.assert_close(spots, expected, rtol=1e-12, atol=1e-10)
    # The gaps: a mean and one harmonic of 2w, nothing else, to rounding.
    harmonic = torch.fft.rfft(open_).abs() / len(PHASE)
    others = torch.cat([harmonic[1:2], harmonic[3:]])
    assert float(others.max()) < 1e-12 * float(harmonic[0])
    # Their field turns by a phase of its own where h0 is complex: the ripple just misses zero.
    depth = float(2 * harmonic[2] / harmonic[0])
    assert depth <= 1 + 1e-12
    assert depth == pytest.approx(1.0, abs=1e-12 if thickness is lossless else 0.02)
    # The mean is eps0 V^2 I/4. The waveform takes the field at the geometric middle of each bin,
    # the table its exact mean over the bin; 400 bins over 11 decades are 6.5 % wide: up to
    # 0.065^2/12 = 4e-4 of curvature, and the first bin, from zero, holds next to nothing.
    pull = float(gaps.inverse_square(h0)[0])
    assert float(open_.mean()) == pytest.approx(EPS0 * VOLTAGE**2 / 4 * pull, rel=1e-3)


def test_a_square_wave_over_lossless_insulators_pulls_steadily(gaps: GapHistogram) -> None:
    # As samples it has no overshoot: 64 of them, seen at their own phases.
    samples = torch.where(torch.arange(64) < 32, 1.0, -1.0)
    open_, spots = stress(Waveform.of_samples(samples), gaps, lossless)
    for value, expected in (
        (open_, 2 * float(stress(COSINE, gaps, lossless)[0].mean())),
        (spots, EPS0 / 2 * VOLTAGE**2 * 0.01 / H0**2),
    ):
        assert value.tolist() == pytest.approx([expected] * 64, rel=1e-10)  # rounding
    # The series of 99 harmonics: Parseval's sum lacks 4/pi^2/99 = 0.4 % of the mean square.
    series = Waveform("square").harmonics(99)
    missing = 1 - float((np.abs(series) ** 2).sum() / 2)
    assert missing == pytest.approx(4 / (math.pi**2 * 100), rel=0.01)
    turns = np.array([[0.25], [0.75]])
    middle = (series * np.exp(2j * np.pi * np.arange(100) * turns)).real.sum(-1)
    assert middle.tolist() == pytest.approx([1.0, -1.0], abs=0.01)  # its ripple there is 1/(50 pi)


def test_samples_of_a_sine_are_the_sine(gaps: GapHistogram) -> None:
    sampled = Waveform.of_samples(torch.cos(torch.arange(16, dtype=torch.float64) * math.pi / 8))
    series = sampled.harmonics(8)
    assert series[:2].tolist() == pytest.approx([0, 1], abs=1e-15)
    assert np.abs(series[2:]).max() < 1e-15
    for thickness in (lossless, lossy):
        for one, other in zip(
            stress(sampled, gaps, thickness), stress(COSINE, gaps, thickness), strict=True
        ):
            torch.testing.assert_close(one, other, rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("count", [4, 5, 16, 33])
def test_samples_come_back_and_parseval_holds(count: int) -> None:
    generator = torch.Generator().manual_seed(count)
    samples = 2 * torch.rand(count, generator=generator, dtype=torch.float64) - 0.7
    wave = Waveform.of_samples(samples)
    scaled = samples / samples.abs().max()
    assert wave.at(np.arange(count) / count).tolist() == pytest.approx(scaled.tolist(), abs=1e-14)
    series = wave.harmonics(count // 2)
    weight = np.full(len(series), 0.5)
    weight[0] = 1.0
    if count % 2 == 0:
        weight[-1] = 1.0  # seen at the samples only, the highest harmonic has no phase
    power = float((weight * np.abs(series) ** 2).sum())
    assert power == pytest.approx(float((scaled**2).mean()), rel=1e-12)


@pytest.mark.parametrize("bad", [[1.0], [0.0] * 8, [[1.0] * 4], [1, 2, 3, math.nan]])
def test_bad_samples(bad: object) -> None:
    with pytest.raises(InputError, match="samples"):
        Waveform.of_samples(bad)


def test_no_voltage_is_friction_at_rest():
    model = ContactModel(Finger.preset("semi-wet"), Screen.preset("3m-sct3250"))
    period = model.over_period(0.5, 0.0, 125.0)
    assert set(period.status.tolist()) == {int(Status.OK)}
    assert float(period.drive_v.abs().max()) == 0.0
    expected = float(model.solve(0.5, 0.0, 125.0).mu)
    assert period.mu.tolist() == pytest.approx([expected] * len(period.mu), rel=1e-9)
