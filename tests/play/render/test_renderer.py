"""From touches to what the mock driver played."""

import re

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import map_coordinates

import haptix
from firmware_io import DeviceError, DeviceFaultError
from haptix import InputError, LimitError, Renderer, Texture
from haptix.play.render import DirectWave, RenderSettings, SineCarrier

RATE = 48_000.0
CARRIER_HZ = 3000.0
STEP_V = 250.0 / 32767  # the mock's full scale is 250 V
CONTROL = 4  # samples from one control point to the next, at 48 kHz
FADE = 240  # samples in which the drive fades in

# Smooth hills between 0.1 and 0.9, on 30 mm by 15 mm.
_ROWS, _COLUMNS = np.mgrid[0:20, 0:40]
HILLS = Texture(0.5 + 0.4 * np.sin(_COLUMNS / 4) * np.cos(_ROWS / 5), width_mm=30.0)

START, END = (0.0, 2.0, 3.0, 0.3), (0.1, 25.0, 11.0, 0.9)


def between(share, start=START, end=END):
    return tuple(a + share * (b - a) for a, b in zip(start, end, strict=True))


def render(surface, texture, touches, address="mock:", **options):
    device = haptix.open_device(address)
    settings = RenderSettings(keep_blocks=True, **options)
    renderer = Renderer(surface, texture, device, settings=settings)
    with renderer:
        for touch in touches:
            renderer.touch(*touch)
    return device, renderer


def level_at(texture, x, y):
    """The texture's level by scipy instead."""
    pixel = texture.width_mm / texture.level.shape[1]
    return map_coordinates(texture.level, [y / pixel - 0.5, x / pixel - 0.5], order=1)


def assert_at_rest(device):
    assert not device.is_armed
    assert not device.mock.is_armed
    assert device.last_v == 0.0
    assert device.mock.played_codes[-1] == 0


def test_what_is_played_is_what_the_surface_says(surface):
    middle = (0.04, 20.0, 4.0, 0.8)
    device, renderer = render(surface, HILLS, [START, middle, END])

    # Friction is asked for at control points, the amplitude is a line in between.
    n = np.arange(CONTROL, 4801, CONTROL)
    times = [0.0, 0.04, 0.1]
    x, y, force = (
        np.interp(n / RATE, times, column)
        for column in zip(START[1:], middle[1:], END[1:], strict=True)
    )
    load = torch.from_numpy(force)
    low = surface.mu(load, 0.0, CARRIER_HZ).numpy()
    high = surface.mu(load, 200.0, CARRIER_HZ).numpy()
    target = low + level_at(HILLS, x, y) * (high - low)
    amplitude = surface.voltage(torch.from_numpy(target), load, CARRIER_HZ).voltage_v.numpy()
    amplitude = amplitude * np.minimum(n / FADE, 1.0)
    sample = np.arange(4800)
    line = np.interp(sample, [0, *n], [0.0, *amplitude])
    expected = line * np.sin(2 * np.pi * CARRIER_HZ * sample / RATE)

    assert renderer.stats.samples == 4800
    played = device.mock.played_v[:4800]
    # Half a code, and 1e-6 V for the rounding of places and friction: above level 0.1 voltage
    # changes by some 1000 V per unit of level, and levels round at 1e-13.
    assert np.abs(played - expected).max() <= STEP_V / 2 + 1e-6
    assert np.abs(played).max() > 100  # and it is not silence that agrees
    # What follows is the device's ramp of 5 ms to 0 V.
    assert len(device.mock.played_v) in (4800, 4800 + 240)
    assert_at_rest(device)
    blocks = renderer.blocks
    np.testing.assert_allclose(np.concatenate([b.target_mu for b in blocks]), target, rtol=1e-11)
    np.testing.assert_allclose(
        np.concatenate([b.amplitude_v for b in blocks]), amplitude, rtol=1e-9
    )
    np.testing.assert_array_equal(np.concatenate([b.sample for b in blocks]), n)


@given(st.lists(st.floats(0.001, 0.999), max_size=30, unique=True), st.floats(1e-4, 0.05))
@settings(max_examples=15, deadline=None)
def test_the_chunking_of_touches_does_not_matter(surface, shares, block_s):
    shares = [
        s for s, gap in zip(sorted(shares), np.diff([0, *sorted(shares)]), strict=True) if gap
    ]
    straight, _ = render(surface, HILLS, [START, END])
    device, _ = render(surface, HILLS, [START, *map(between, shares), END], block_s=block_s)
    a, b = straight.mock.played_codes, device.mock.played_codes
    assert len(a) == len(b)
    # The same places but for rounding, so the same voltage up to the rounding to a code.
    assert np.abs(a.astype(int) - b.astype(int)).max() <= 1


def test_touches_between_two_samples(surface):
    # 1 us apart, 21 us between samples: most touches bring no sample, and none is lost.
    touches = [between(share) for share in np.linspace(0, 1e-2, 1001)]
    device, renderer = render(surface, HILLS, touches)
    straight, _ = render(surface, HILLS, [START, between(1e-2)])
    assert renderer.stats.samples == 48
    a, b = straight.mock.played_codes, device.mock.played_codes
    assert np.abs(a.astype(int) - b.astype(int)).max() <= 1


def test_the_clock_starts_at_the_first_touch(surface):
    late = [(t + 5.0, *rest) for t, *rest in (START, END)]
    a, _ = render(surface, HILLS, [START, END])
    b, _ = render(surface, HILLS, late)
    difference = a.mock.played_codes.astype(int) - b.mock.played_codes.astype(int)
    assert np.abs(difference).max() <= 1


def test_blocks_are_no_longer_than_asked_for(surface):
    _, renderer = render(surface, HILLS, [START, END], block_s=0.003)
    lengths = [len(block.drive_v) for block in renderer.blocks]
    assert max(lengths) == 144  # 3 ms at 48 kHz
    assert sum(lengths) == 4800
    assert len(renderer.stats.block_s) == len(lengths)


def test_an_exception_ends_at_zero(surface):
    device = haptix.open_device("mock:")
    with pytest.raises(ZeroDivisionError), Renderer(surface, HILLS, device) as renderer:
        renderer.touch(*START)
        renderer.touch(*END)
        assert device.last_v != 0
        raise ZeroDivisionError
    assert_at_rest(device)


def test_a_device_fault_ends_at_zero_and_the_renderer_starts_again(surface):
    device = haptix.open_device("mock:")
    renderer = Renderer(surface, HILLS, device)
    with pytest.raises(DeviceFaultError, match="Arm it again"), renderer:
        renderer.touch(*START)
        renderer.touch(*between(0.5))
        device.mock.advance(1.0)  # a host that falls silent
        assert device.mock.played_codes[-1] == 0
        renderer.touch(*END)
    assert_at_rest(device)
    assert device.mock.faults == 1

    before = device.mock.samples_played
    with renderer:
        renderer.touch(*START)
        renderer.touch(*END)
    assert_at_rest(device)
    assert device.mock.fault is None
    fresh, _ = render(surface, HILLS, [START, END])
    np.testing.assert_array_equal(device.mock.played_codes[before:], fresh.mock.played_codes)


def test_statistics_count_from_the_last_entry(surface):
    device = haptix.open_device("mock:")
    renderer = Renderer(surface, HILLS, device, settings=RenderSettings(keep_blocks=True))
    for _ in range(2):
        with renderer:
            renderer.touch(*START)
            renderer.touch(*END)
    assert renderer.stats.samples == 4800
    assert sum(len(block.drive_v) for block in renderer.blocks) == 4800


def test_a_renderer_that_was_not_entered_plays_nothing(surface):
    device = haptix.open_device("mock:")
    renderer = Renderer(surface, HILLS, device)
    with pytest.raises(DeviceError, match="armed"):
        renderer.touch(*START)
        renderer.touch(*END)
    assert device.mock.samples_played == 0


@pytest.mark.parametrize("limit_v", [120.0, 200.0])
def test_the_screens_limit_holds(model, limit_v):
    screen = model.screen.replace(name="fragile", max_voltage_v=limit_v)
    scene = {"normal_force_n": (0.2, 1.0), "frequency_hz": CARRIER_HZ}
    fragile = haptix.FrictionSurface.build(haptix.ContactModel(model.finger, screen), scene)
    full = Texture(np.ones((2, 2)), width_mm=30.0)
    device, _ = render(fragile, full, [START, END])
    loudest = np.abs(device.mock.played_v).max()
    # The carrier has samples at its peaks, 12 a period; at the limit codes round down by a step.
    assert limit_v - STEP_V <= loudest <= limit_v
    assert device.limits.ceiling_v == limit_v
    with pytest.raises(LimitError, match=f"{limit_v} V"), device:
        device.write([limit_v + 0.1])


def test_the_screens_limit_holds_at_one_force(model):
    screen = model.screen.replace(name="fragile", max_voltage_v=120.0)
    scene = {"normal_force_n": 0.5, "frequency_hz": CARRIER_HZ}
    fragile = haptix.FrictionSurface.build(haptix.ContactModel(model.finger, screen), scene)
    full = Texture(np.ones((2, 2)), width_mm=30.0)
    device, _ = render(fragile, full, [(0.0, 2, 3, 0.5), (0.02, 9, 9, 0.5)])
    # The carrier has samples at its peaks, 12 a period; at the limit codes round down by a step.
    assert 120.0 - STEP_V <= np.abs(device.mock.played_v).max() <= 120.0
    assert device.limits.ceiling_v == 120.0


def test_more_than_the_device_gives_is_rejected_at_rest(surface):
    full = Texture(np.ones((2, 2)), width_mm=30.0)
    device = haptix.open_device("mock:ceiling_v=150")
    with pytest.raises(LimitError, match="150"), Renderer(surface, full, device) as renderer:
        renderer.touch(*START)
        renderer.touch(*END)
    assert not device.is_armed
    assert np.abs(device.mock.played_v).max(initial=0.0) <= 150.0
    assert device.last_v == 0.0


def test_the_refusal_names_the_command_that_builds_the_right_surface(surface):
    device = haptix.open_device("mock:ceiling_v=150")
    with (
        pytest.raises(LimitError) as refused,
        Renderer(surface, Texture(np.ones((2, 2)), 30.0), device),
    ):
        pass
    command = re.search("haptix (build .*?);", str(refused.value)).group(1).split()
    values = dict(zip(command[2::2], command[3::2], strict=True))
    assert values["--voltage-v"] == "150"
    ends = [float(end) for end in values["--normal-force-n"].split(",")]
    assert ends == pytest.approx([surface.normal_force_n.low, surface.normal_force_n.high])
    assert float(values["--frequency-hz"]) == CARRIER_HZ


@pytest.mark.parametrize("ceiling_v", [1.0, 150.0, 300.0])
def test_a_surface_is_limited_to_what_a_device_gives(surface, ceiling_v):
    limited, least_v = surface.limited(ceiling_v), min(ceiling_v, surface.voltage_limit_v)
    assert limited.voltage_limit_v == least_v
    for voltage_v in (0.3 * least_v, least_v):
        assert limited.mu(0.5, voltage_v, CARRIER_HZ) == surface.mu(0.5, voltage_v, CARRIER_HZ)
    column = limited.column(0.5, CARRIER_HZ)
    assert column.end_v <= least_v
    voltage_v, _ = column.voltage(np.array([1.0]))  # a friction beyond reach
    assert voltage_v <= least_v
    full = Texture(np.ones((2, 2)), width_mm=30.0)
    address = f"mock:ceiling_v={least_v:g}"
    with Renderer(limited, full, haptix.open_device(address)) as renderer:
        renderer.touch(*START)
        renderer.touch(*END)
    loudest = np.abs(renderer.device.mock.played_v).max()
    assert least_v - 2 * STEP_V <= loudest <= least_v


def test_friction_out_of_reach_is_counted(surface):
    # From 0.1, below what there is without voltage (0.26), to 1, above what 200 V gives (0.33).
    level = np.repeat(np.linspace(0, 1, 40)[None, :], 4, axis=0)
    texture = Texture(level, width_mm=40.0, target="mu", low=0.1, high=1.0)
    start, end = (0.0, 0.0, 2.0, 0.5), (0.1, 40.0, 2.0, 0.5)
    device, renderer = render(surface, texture, [start, end])

    x = 40.0 * np.arange(CONTROL, 4801, CONTROL) / 4800
    wanted = 0.1 + 0.9 * np.interp(x, np.arange(40) + 0.5, level[0])
    lowest, highest = (float(surface.mu(0.5, v, CARRIER_HZ)) for v in (0.0, 200.0))
    stats = renderer.stats
    assert stats.below == CONTROL * int((wanted < lowest).sum()) > 0
    assert stats.above == CONTROL * int((wanted > highest).sum()) > 0
    assert stats.outside == 0
    within = (wanted >= lowest) & (wanted <= highest)
    assert stats.samples - stats.below - stats.above == CONTROL * int(within.sum()) > 0
    # Nothing where too little is wanted, everything where too much is.
    played = np.abs(device.mock.played_v[:4800]).reshape(-1, CONTROL).max(axis=1)
    assert played[wanted < lowest].max() == 0
    # Codes round to the nearest within half a step.
    assert abs(played[wanted > highest].max() - 200.0) <= STEP_V


def test_force_outside_the_surface_is_counted(surface):
    start, end = (0.0, 2.0, 3.0, 0.5), (0.1, 25.0, 11.0, 1.9)
    _, renderer = render(surface, HILLS, [start, end])
    force = 0.5 + 1.4 * np.arange(CONTROL, 4801, CONTROL) / 4800
    # The axis ends at 1 N; the point nearest to it is 3e-4 N away, far beyond any slack.
    assert np.abs(force - 1.0).min() > 5e-5
    assert renderer.stats.outside == CONTROL * int((force > 1.0).sum()) > 0
    assert (renderer.stats.below, renderer.stats.above) == (0, 0)


BAD_TOUCHES = {
    "time is NaN": (np.nan, 1, 1, 0.5),
    "x is infinite": (0.2, np.inf, 1, 0.5),
    "y is NaN": (0.2, 1, np.nan, 0.5),
    "force is NaN": (0.2, 1, 1, np.nan),
    "no force": (0.2, 1, 1, 0.0),
    "pulling": (0.2, 1, 1, -0.5),
    "time leaps": (1e6, 1, 1, 0.5),
    "time stands": (END[0], 1, 1, 0.5),
    "time goes back": (0.05, 1, 1, 0.5),
}


@pytest.mark.parametrize("name", BAD_TOUCHES)
def test_a_bad_touch_is_one_sentence_and_plays_nothing(surface, name):
    device = haptix.open_device("mock:")
    with Renderer(surface, HILLS, device) as renderer:
        renderer.touch(*START)
        renderer.touch(*END)
        with pytest.raises(InputError, match="touch") as caught:
            renderer.touch(*BAD_TOUCHES[name])
        assert "\n" not in str(caught.value)
        assert renderer.stats.samples == device.mock.samples_played == 4800
        # The finger may go on from where it was.
        renderer.touch(0.11, 25.0, 11.0, 0.9)
        assert renderer.stats.samples == 5280
    assert_at_rest(device)


@pytest.mark.parametrize("bad", [(np.nan, 1, 1, 1), (0, 1, 1, 0)])
def test_a_bad_first_touch_leaves_the_renderer_fresh(surface, bad):
    device = haptix.open_device("mock:")
    with Renderer(surface, HILLS, device) as renderer:
        with pytest.raises(InputError):
            renderer.touch(*bad)
        renderer.touch(*START)
        assert renderer.stats.samples == 0


def test_the_carrier_must_be_on_the_surface(surface):
    device = haptix.open_device("mock:")
    for carrier_hz in (2900.0, 4100.0, 0.0, -4000.0, np.nan):
        with pytest.raises(InputError, match="frequency_hz"):
            Renderer(surface, HILLS, device, SineCarrier(carrier_hz))
    with pytest.raises(InputError, match="h0_m"):
        Renderer(surface, HILLS, device, settings=RenderSettings(h0_m=3e-7))


def test_a_carrier_too_fast_for_the_device(model):
    fast = haptix.FrictionSurface.build(model, {"normal_force_n": 0.5, "frequency_hz": 15e3})
    with pytest.raises(InputError, match="48000"):
        Renderer(fast, HILLS, haptix.open_device("mock:"))
    device = haptix.open_device("mock:sample_rate_hz=96000")
    assert Renderer(fast, HILLS, device).drive.frequency_hz == 15e3


def test_the_carrier_without_being_told(model, surface):
    device = haptix.open_device("mock:")
    assert Renderer(surface, HILLS, device).drive.frequency_hz == CARRIER_HZ
    for span, expected in (
        (None, 4000.0),
        ((1000.0, 2000.0), 2000.0),
        ((5e3, 6e3), 5e3),
        ((1e3, 6e3), 4e3),
    ):
        scene = {"normal_force_n": 0.5, "frequency_hz": span}
        wide = haptix.FrictionSurface.build(model, scene, tolerance=0.05)
        assert Renderer(wide, HILLS, device).drive.frequency_hz == expected


def test_the_screens_own_thickness_without_being_told(model):
    scene = {"normal_force_n": 0.5, "frequency_hz": CARRIER_HZ, "h0_m": (1e-7, 3e-7)}
    wide = haptix.FrictionSurface.build(model, scene, tolerance=0.05)
    touches = [(0.0, 2.0, 3.0, 0.5), (0.02, 20.0, 3.0, 0.5)]
    untold, _ = render(wide, HILLS, touches)
    told, _ = render(wide, HILLS, touches, h0_m=1e-6 / 8)  # 1 um with eps 8
    other, _ = render(wide, HILLS, touches, h0_m=3e-7)
    np.testing.assert_array_equal(untold.mock.played_codes, told.mock.played_codes)
    # Relative textures reach their share at any thickness, but by other voltages.
    assert (untold.mock.played_codes != other.mock.played_codes).any()


@pytest.mark.parametrize("force", [0.25, 0.6, 0.95])
@pytest.mark.parametrize("level", [0.1, 0.5, 0.9])
def test_the_model_itself_reaches_the_wanted_friction(model, surface, level, force):
    flat = Texture(np.full((2, 2), level), width_mm=30.0)
    device, renderer = render(surface, flat, [(0.0, 1, 1, force), (0.02, 20, 10, force)])
    _, amplitude = renderer.drive.demodulate(device.mock.played_v[:960], RATE)
    amplitude = amplitude[FADE // 16 :]
    state = model.solve(torch.full((45,), force), torch.from_numpy(amplitude), CARRIER_HZ)
    reached = state.mu.numpy()

    low, high = (float(model.solve(force, v, CARRIER_HZ).mu) for v in (0.0, 200.0))
    wanted = low + level * (high - low)
    # Least squares over the 16 samples of a period, sine values 0, 0.38, 0.71, 0.92 and 1: the sum
    # of |sin| is 10.06 and of its square 8, so half a code becomes at most 10.06/8 of one half.
    error_v = STEP_V / 2 * 10.06 / 8
    steepest = float(model.solve(force, 200.0, CARRIER_HZ).mu) - float(
        model.solve(force, 199.0, CARRIER_HZ).mu
    )  # mu per volt rises with voltage
    # The surface errs in the ends of the range as well as in between.
    bound = 2 * surface.info["error_max"] + error_v * steepest
    assert np.abs(reached - wanted).max() <= bound
    # The target in the stats is the surface's: there its error enters once.
    target = np.concatenate([block.target_mu for block in renderer.blocks])
    assert np.abs(reached - target[:45]).max() <= surface.info["error_max"] + error_v * steepest
    assert bound < 0.05 * (high - low)  # tight enough to notice a wrong level


def test_a_driver_that_makes_the_carrier_is_sent_amplitudes(surface):
    device = haptix.open_device("mock:mode=envelope,sample_rate_hz=16000")
    flat = Texture(np.full((2, 2), 0.5), width_mm=30.0)
    renderer = Renderer(surface, flat, device, settings=RenderSettings(keep_blocks=True))
    with renderer:
        renderer.touch(0.0, 1, 1, 0.5)
        renderer.touch(0.05, 20, 10, 0.5)
    assert device.carrier_hz == CARRIER_HZ
    played = device.mock.output_v
    low, high = surface.reachable(0.5, CARRIER_HZ)
    (voltage,) = surface.voltage(0.5 * (low + high), 0.5, CARRIER_HZ).voltage_v.reshape(1).tolist()
    assert renderer.blocks[-1].amplitude_v[-1] == pytest.approx(voltage, rel=1e-9)
    # The driver's own carrier swings to that amplitude: 12 of its samples a period, in 16 bits.
    assert np.abs(played).max() == pytest.approx(voltage, abs=2 * STEP_V)
    assert played.min() < -0.99 * voltage

    with pytest.raises(InputError, match="carrier itself"):
        Renderer(surface, flat, device, DirectWave(125.0))
