"""Nothing above half of the envelope's rate: sweeps of speed across textures of every kind.

A finger of speed v is sampled at rate r, so the footprint is v/r and every wave shorter than two
footprints would be felt as another, longer one. The field is read along the path 32 times as
densely as the drive would, at that footprint: what this finds above half of the rate is what
sampling folds down. The reference is the point values on the same dense path: their part below half
of the rate is what an ideal low-pass would keep.
"""

import numpy as np
import pytest
from skimage.data import brick, gravel

from haptix import Layout
from haptix.feel.materials import FrictionField, Grating, Noise, RecordedProfile, Texture, power_law
from haptix.feel.motion import Motion

DENSE = 32
PIXELS = 256
PIXEL_MM = 0.125
SIZE_MM = PIXELS * PIXEL_MM


def spectra(field, footprint_mm, angle):
    """Wavenumbers, and power at the footprint and of the point values, along one stroke."""
    step = footprint_mm / DENSE
    along = np.arange(int(24.0 / step)) * step
    x, y = 3.0 + along * np.cos(angle), 4.0 + along * np.sin(angle)
    window = np.hanning(len(along))

    def power(value):
        value = value - np.average(value, weights=window)
        return np.abs(np.fft.rfft(value * window)) ** 2

    limited, whole = (field.wanted(Motion.of(x, y, footprint_mm=f)) for f in (footprint_mm, 0.0))
    return np.fft.rfftfreq(len(along), step), power(limited), power(whole)


def chirp():
    """Waves across, from 10 mm to two pixels, the shortest that there are."""
    x = (np.arange(PIXELS) + 0.5) * PIXEL_MM
    slow, fast = 0.1, 1 / (2 * PIXEL_MM)
    wave = np.sin(2 * np.pi * (slow * x + (fast - slow) / SIZE_MM * x**2 / 2))
    return Texture(np.tile(0.5 + 0.5 * wave, (PIXELS, 1)), SIZE_MM)


def white():
    return Texture(np.random.default_rng(3).random((PIXELS, PIXELS)), SIZE_MM)


def screen(blend):
    layout = Layout(Grating(period_mm=3.0, wave="square", orientation_deg=70.0))
    layout.add(Texture.from_image(brick()[::2, ::2], SIZE_MM), 6.0, 5.0, blend=blend)
    return layout


def scattered():
    rng = np.random.default_rng(4)
    return RecordedProfile(np.cumsum(rng.uniform(0.1, 0.3, 200)), rng.uniform(0.2, 0.6, 200))


# The highest part of a field's variance that may be folded down. Bilinear interpolation of pixels
# that alternate leaves a triangle wave: (1/9)^2 of it, -19 dB, is in the third harmonic, and some
# -25 dB in the mean over all waves of white pixels. Of the levels, the kernel leaves 6 % of a wave
# at the limit, -24 dB, where most of a picture's variance is elsewhere.
IMAGES = {
    "chirp": (chirp, -25.0),
    "white": (white, -24.0),
    "brick": (lambda: Texture.from_image(brick()[::2, ::2], SIZE_MM), -25.0),
    "gravel": (lambda: Texture.from_image(gravel()[::2, ::2], SIZE_MM), -25.0),
    "noise": (lambda: Noise(spectrum=power_law(2, 0.3, 8), tile_mm=32, pixels=256), -25.0),
    "recording": (scattered, -25.0),
    "region on a grating": (lambda: screen("over"), -25.0),
    "region times a grating": (lambda: screen("multiply"), -25.0),
}
SHARES = [0.1, 0.3, 0.5, 0.6, 0.75, 0.9, 1.0, 1.4, 1.9, 2.0, 2.7, 3.6, 4.0, 6.0, 9.0, 16.0]


@pytest.mark.parametrize("angle", [0.0, 0.4])
@pytest.mark.parametrize("name", IMAGES)
def test_a_sweep_of_speed_across_sampled_fields(name, angle):
    make, highest_db = IMAGES[name]
    field = make()
    for share in SHARES:
        footprint = share * PIXEL_MM
        k, limited, whole = spectra(field, footprint, angle)
        folded = limited[k > 1 / (2 * footprint)].sum()
        assert 10 * np.log10(folded / whole.sum()) < highest_db, f"footprint {share} pixels"


@pytest.mark.parametrize("pixels", [1, 3, 8])
def test_a_sweep_of_speed_across_a_small_plate(pixels):
    plate = Texture(np.ones((pixels, pixels)), 2.0)
    along = np.arange(-64, 64, 1 / 64)
    for footprint in (0.25, 0.5, 1.0, 2.0, 4.0):
        value = plate.friction(along, 1.0, footprint)
        power = np.abs(np.fft.fft(value)) ** 2
        k = np.abs(np.fft.fftfreq(len(along), 1 / 64))
        # Against its own power: at one place there is no variance of which this could be a part.
        folded = power[k > 1 / (2 * footprint)].sum()
        assert 10 * np.log10(folded / power.sum()) < -20, f"footprint {footprint} mm"


@pytest.mark.parametrize("wave", ["sine", "square", "sawtooth"])
def test_a_sweep_of_speed_across_gratings(wave):
    grating = Grating(period_mm=2.0, wave=wave, orientation_deg=20.0, duty=0.3)
    for footprint in (0.01, 0.04, 0.1, 0.2, 0.3, 0.45, 0.6, 0.8, 0.95, 1.2, 2.5):
        k, limited, whole = spectra(grating, footprint, 0.0)
        folded = limited[k > 1 / (2 * footprint)].sum()
        # Series without higher harmonics; a table of 16 points for the highest leaves
        # (1/15^2)^2 of it, and the window's side lobes are below that.
        assert 10 * np.log10(folded / whole.sum() + 1e-30) < -45, f"footprint {footprint} mm"


def test_without_the_footprint_the_same_sweep_does_alias():
    # Else the sweep would show nothing.
    k, _, whole = spectra(white(), 2 * PIXEL_MM, 0.0)
    assert whole[k > 1 / (4 * PIXEL_MM)].sum() > 0.2 * whole.sum()
    k, _, whole = spectra(Grating(period_mm=2.0, wave="square"), 0.5, 0.0)
    assert whole[k > 1].sum() > 0.05 * whole.sum()


@pytest.mark.parametrize("footprint_mm", [0.02, 0.06, 0.1, 0.2, 0.5, 1.0])
@pytest.mark.parametrize("kind", ["image", "grating"])
def test_waves_eight_footprints_long_stay(kind, footprint_mm):
    # The price of the limit: what an ideal low-pass would keep in full, and this still has most of.
    period = max(8 * footprint_mm, 1.0)
    if kind == "grating":
        field: FrictionField = Grating(period_mm=period)
    else:
        x = (np.arange(PIXELS) + 0.5) * PIXEL_MM
        field = Texture(np.tile(0.5 + 0.5 * np.sin(2 * np.pi * x / period), (PIXELS, 1)), SIZE_MM)
    along = np.linspace(8, 8 + period, 400)
    # The binomial kernels' response at an eighth of the footprint's rate, 0.5 at the least.
    assert np.ptp(field.friction(along, 16.0, footprint_mm)) > (0.99 if kind == "grating" else 0.5)


FIELDS = {
    "texture": white,
    "square": lambda: Grating(period_mm=2.0, wave="square", orientation_deg=30.0),
    "noise": lambda: Noise(spectrum=power_law(1, 0.3, 8), tile_mm=16, pixels=128),
    "recording": scattered,
}


@pytest.mark.parametrize("name", FIELDS)
def test_one_footprint_for_each_place_is_the_same_as_one_at_a_time(name):
    field = FIELDS[name]()
    rng = np.random.default_rng(6)
    x, y = rng.uniform(-3, 35, (2, 60))
    footprint = np.concatenate([[0.0, 1e-9, 1e3, np.inf], 10 ** rng.uniform(-3, 1.5, 56)])
    footprint[:4] = [0.001, 1e-9, 1e3, 1e9]
    one = [field.friction(*at) for at in zip(x, y, footprint.tolist(), strict=True)]
    # Two orders of the same sums.
    np.testing.assert_allclose(field.friction(x, y, footprint), one, rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", FIELDS)
def test_nothing_jumps_when_the_speed_changes(name):
    field = FIELDS[name]()
    x, y = np.random.default_rng(7).uniform(1, 30, (2, 200))
    footprints = np.geomspace(2e-3, 30, 1500)
    values = np.array([field.friction(x, y, float(f)) for f in footprints])
    # A step of 0.64 % in the footprint moves a blend by 0.0093 of the levels' difference, below 1,
    # and the ramp of an edge by as little.
    assert np.abs(np.diff(values, axis=0)).max() < 0.02


@pytest.mark.parametrize("name", FIELDS)
@pytest.mark.parametrize("footprint", [-1.0, np.nan, -np.inf])
def test_a_footprint_that_is_none_is_a_point(name, footprint):
    field = FIELDS[name]()
    x, y = np.random.default_rng(8).uniform(1, 30, (2, 9))
    expected = field.friction(x, y)
    np.testing.assert_array_equal(field.friction(x, y, footprint), expected)
    np.testing.assert_array_equal(field.friction(x, y, np.full(9, footprint)), expected)
