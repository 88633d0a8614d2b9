"""Compact spectral models of recordings in time: against closed forms and made-up recordings."""

from functools import cache

import numpy as np
import pytest

from haptix.base.errors import FileFormatError, InputError
from haptix.feel.materials import Spectral, load, material_of
from haptix.feel.materials.spectral import (
    BANDS_HZ,
    Energies,
    Stretch,
    band_energies,
    distance_db,
    fit,
    stretch_of,
    stretches,
)
from haptix.feel.motion import Motion

RATE_HZ = 4000.0


def recording(path, change, length_mm=90.0, speed=40.0, force=0.5, mu=0.6, columns="position"):
    """A stroke after a rest, and back; `change` gives relative changes of friction at places."""
    t = np.arange(0, 2 * length_mm / speed + 0.4, 1 / RATE_HZ)
    x = np.interp(
        t, [0.2, 0.2 + length_mm / speed, 0.4 + length_mm / speed], [0, length_mm, length_mm]
    )
    x = np.where(t > 0.4 + length_mm / speed, length_mm - speed * (t - 0.4 - length_mm / speed), x)
    pressed = np.full(len(t), force)
    pull = mu * (1 + change(x)) * pressed * np.where(np.gradient(x, t) < -1, -1, 1)
    table = {"t_s": t, "normal_force_n": pressed, "tangential_force_n": pull}
    table |= {"position_mm": x} if columns == "position" else {"speed_mm_per_s": np.gradient(x, t)}
    rows = np.column_stack([*table.values()])
    lines = [",".join(table), *(",".join(f"{v:.7g}" for v in row) for row in rows)]
    path.write_text("\n".join(lines))
    return path


def noise(exponent, deviation, seed=1):
    """Gaussian noise of a power law in k over 0.05 to 45 waves per millimetre."""
    rng = np.random.default_rng(seed)
    k = np.linspace(0.05, 45, 2500)
    power = k**-exponent
    size = deviation * np.sqrt(2 * power / power.sum())
    phase = rng.uniform(0, 2 * np.pi, len(k))
    return lambda x: (size * np.cos(2 * np.pi * np.outer(np.unique(x), k) + phase)).sum(1)[
        np.unique(x, return_inverse=True)[1]
    ]


@cache
def noise_and_fit(folder, exponent):
    """Stretches of a noise, and the material of them: three tests look at them."""
    found = stretches(recording(folder / f"{exponent:g}.csv", noise(exponent, 0.05)))
    return found, fit(found)


@pytest.fixture(scope="module")
def noises(tmp_path_factory):
    folder = tmp_path_factory.mktemp("noises")
    return lambda exponent: noise_and_fit(folder, exponent)


def levels_of(material, speed):
    """Levels of what a material asks for, over one tile and without a window."""
    x = np.arange(32768) * material.tile_mm / 32768
    value = material.evaluator.wanted(Motion.of(x, 0.0))
    return 10 * np.log10(band_energies(value, 32768 / material.tile_mm * speed, is_periodic=True))


@pytest.mark.parametrize("columns", ["position", "speed"])
def test_a_grating_is_a_wave_of_its_period_and_amplitude(tmp_path, columns):
    def ridges(x):
        return 0.1 * np.sin(2 * np.pi * x / 1.25)

    found = stretches(recording(tmp_path / "a.csv", ridges, columns=columns))
    assert len(found) == 2
    # The speed is that over 20 ms: a stroke loses 10 ms at its ends.
    assert [one.length_mm for one in found] == pytest.approx([90, 90], abs=1)
    assert [one.mu for one in found] == pytest.approx([0.6, 0.6], rel=0.01)
    assert found[0].speed_mm_per_s == pytest.approx(40, rel=0.01)
    material = fit(found)
    period, amplitude = material.waves[0]
    assert period == pytest.approx(1.25, rel=0.01)  # 90 mm hold 72 waves
    assert amplitude == pytest.approx(0.1, rel=0.06)  # half a decibel
    energies = Energies(found)
    for speed in (20.0, 45.0, 100.0):
        band = np.searchsorted(BANDS_HZ, speed / 1.25) - 1
        wanted = 20 * np.log10(0.1 / np.sqrt(2))
        assert energies.levels_db(speed)[band] == pytest.approx(wanted, abs=0.2)
        assert levels_of(material, speed)[band] == pytest.approx(wanted, abs=0.5)


@pytest.mark.parametrize(
    "exponent", [0.0, *(pytest.param(one, marks=pytest.mark.slow) for one in (1.0, 2.0))]
)
def test_noise_is_within_a_decibel_in_95_percent_of_the_bands(noises, exponent):
    found, material = noises(exponent)
    energies = Energies(found)
    off = np.concatenate(
        [levels_of(material, v) - energies.levels_db(v) for v in np.linspace(20, 100, 9)]
    )
    off = off[np.isfinite(off)]
    assert len(off) > 70
    assert (np.abs(off) <= 1).mean() >= 0.95


def test_levels_of_white_noise_are_those_of_its_density():
    rng = np.random.default_rng(0)
    step = 0.005
    flat = Energies([Stretch(step, 0.1 * rng.standard_normal(1 << 16), 0.5, 40.0, 0.5)])
    k = BANDS_HZ / 100.0
    wanted = 10 * np.log10(0.01 * np.diff(k) * 2 * step)
    # 328 mm hold 22 lines of the lowest band: 0.9 dB, and less of the others.
    np.testing.assert_allclose(flat.levels_db(100.0), wanted, atol=2.5)
    np.testing.assert_allclose(flat.levels_db(100.0)[4:], wanted[4:], atol=0.8)


def test_the_distance_of_a_texture_and_of_its_double_is_6_db(tmp_path):
    one, two = (Energies([Stretch(0.01, gain * noise(1.0, 0.05)(np.arange(0, 60, 0.01)), 0.5,
                                  40.0, 0.5)]) for gain in (1, 2))  # fmt: skip
    assert distance_db(one, one) == 0
    assert distance_db(one, two) == distance_db(two, one) == pytest.approx(20 * np.log10(2))


def test_a_material_is_at_a_short_distance_from_its_recording(noises):
    (smooth, material), (rough, _) = noises(2.0), noises(0.0)
    made = Energies([stretch_of(material)])
    assert distance_db(Energies(smooth), made) < 2 < distance_db(Energies(rough), made)


def test_what_was_not_recorded_is_not_known(tmp_path):
    step = 0.25  # as of a sensor that is read 20 times a second
    few = Energies([Stretch(step, noise(1.0, 0.05)(np.arange(0, 60, step)), 0.5, 5.0, 0.5)])
    known = np.isfinite(few.levels_db(20.0))
    assert known.tolist() == [True] * 2 + [False] * 7  # up to 1.6 waves per millimetre
    assert (
        len(fit([Stretch(step, noise(1.0, 0.05)(np.arange(0, 60, step)), 0.5, 5.0, 0.5)]).level_db)
        == 13
    )
    with pytest.raises(InputError, match="in common"):
        distance_db(few, Energies([Stretch(0.01, np.ones(900), 0.5, 5.0, 0.5)]), (1.0,))


def test_a_document_is_read_back_and_repeats_with_its_tile(tmp_path):
    material = Spectral(mean=0.3, waves=((2.0, 0.1),), seed=7, tile_mm=64.0)
    material.save(tmp_path / "a.toml")
    assert load(tmp_path / "a.toml") == material
    x = np.linspace(0, 60, 500)
    here, next_tile = (material.wanted(Motion.of(x + by, 0.0)) for by in (0.0, 64.0))
    np.testing.assert_allclose(here, next_tile, atol=1e-9)
    assert not np.allclose(here, material.replace(seed=8).wanted(Motion.of(x, 0.0)))


@pytest.mark.parametrize(
    ("text", "wrong", "said"),
    [
        ("t_s,x\n0,1\n1,2\n", FileFormatError, "expected columns t_s"),
        ("t_s,position_mm,mu\n0,0,0.5\n0,1,0.5\n", InputError, "increases"),
        ("t_s,position_mm,mu\n0,0,0.5\n1,1,0.5\n2,1,0.5\n", InputError, "10 mm or more"),
        ("t_s,position_mm,mu\n0,0,a\n1,40,0.5\n", FileFormatError, "number"),
    ],
)
def test_what_is_no_recording_is_refused(tmp_path, text, wrong, said):
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(wrong, match=said):
        stretches(tmp_path / "a.csv")


def test_wrong_numbers_and_shares_are_refused():
    for fields in ({"level_db": [0.0] * 12}, {"waves": [[0.001, 0.1]]}, {"target": "share"}):
        with pytest.raises(InputError):
            material_of({"kind": "spectral", **fields})
    with pytest.raises(InputError, match="one screen only"):
        stretch_of(material_of({"kind": "grating", "period_mm": 2.0}))
