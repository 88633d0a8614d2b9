"""Programs of a touch: their bytes against docs/program.md, and what is refused."""

import json
import struct
import zlib

import numpy as np
import pytest

import haptix
from haptix.feel.gallery import presets
from haptix.feel.materials import Grating, Noise, Texture
from haptix.play import DirectWave, LiveSettings, RenderCore, SineCarrier, compile_touch
from haptix.play.touch import InteractingSinger
from tests.command_line import run_haptix
from tests.play.render.conftest import CARRIER_HZ

LEVEL = np.random.default_rng(0).random((10, 16))
MOST_BYTES = 2_000_000


@pytest.fixture(scope="module")
def device():
    with haptix.open_device("mock:") as opened:
        yield opened


def uint(program, at):
    return struct.unpack_from("<I", program, at)[0]


def real(program, at, count=1):
    return np.frombuffer(program, "<f8", count, at)


def everything():
    """A layout with each thing that a program holds."""
    noise = Noise(pixels=64, tile_mm=16.0, seed=3, mean=0.4, deviation=0.1)
    layout = haptix.Layout(noise)
    ribs = Grating(period_mm=2.0, wave="square", duty=0.3, orientation_deg=30.0, phase=0.2)
    layout.add(ribs, 4.0, 5.0, 20.0, 10.0, z=2.0, blend="add", opacity=0.5, rotation_deg=40.0)
    layout.add(Texture(LEVEL, 8.0), 1.0, 2.0, scale=2.0, shape="ellipse", priority=-3)
    corners = ((0.0, 0.0), (6.0, 1.0), (3.0, 8.0))
    layout.add(ribs, 9.0, 9.0, 8.0, 8.0, z=3.0, shape=corners, mask=Texture(LEVEL, 8.0))
    return layout


def test_a_group_is_no_part_of_a_program(surface, device):
    def program(**group):
        layout = haptix.Layout(0.05)
        layout.add(Grating(period_mm=2.0), 4.0, 5.0, 20.0, 10.0, **group)
        return compile_touch(surface, layout, device, SineCarrier(CARRIER_HZ), LiveSettings())

    assert program() == program(group="g")


def test_the_header_is_as_the_page_says(surface, device):
    how = LiveSettings(combination="mean", compress=(0.1, 0.7))
    layout = haptix.Layout(0.05, target="contrast")
    program = compile_touch(surface, layout, device, SineCarrier(CARRIER_HZ), how)
    core = RenderCore(surface, layout, device, SineCarrier(CARRIER_HZ), how)
    assert program[:8] == bytes([137]) + b"HXP" + bytes([13, 10, 26, 10])
    assert uint(program, 8) == 2
    assert uint(program, 12) == zlib.crc32(program[16:])
    assert uint(program, 16) == len(program)
    assert [uint(program, at) for at in (20, 24, 28, 32)] == [core.step, 1, 2, 1 + 4]
    assert real(program, 80, 4).tolist() == [
        core.sample_rate_hz, CARRIER_HZ, core.highest_v, core.most_step_v,
    ]  # fmt: skip
    assert real(program, 112, 2).tolist() == [0.1, 0.7]
    touch = how.touch
    assert real(program, 168, 7).tolist() == [
        touch.force.assumed_n, touch.latency_s, touch.lost_after_s, touch.blend_s,
        how.sliding.fade_s, touch.slide_above_mm_s, touch.rest_below_mm_s,
    ]  # fmt: skip
    filtered = touch.filter
    assert isinstance(filtered, InteractingSinger)
    assert real(program, 224, 13).tolist() == [
        filtered.acceleration_mm_s2, filtered.acceleration_per_speed_hz, filtered.correlation_s,
        filtered.position_noise_mm, filtered.first_speed_mm_s, filtered.noise_reports,
        filtered.gentle, filtered.stay, touch.turn_above_mm_s, touch.turn_s,
        touch.slide_smoothing_s, touch.reorder_s, touch.least_interval_s,
    ]  # fmt: skip
    forces, drives, at = uint(program, 36), uint(program, 40), uint(program, 64)
    force_n = np.exp(real(program, at, forces))
    table = real(program, at + 8 * (forces + drives), forces * (drives + 2)).reshape(forces, -1)
    lowest, _ = core.reachable(force_n, force_n)
    assert -1 / table[:, 0] == pytest.approx(lowest, rel=1e-12)
    wave = real(program, uint(program, 68), uint(program, 48))
    turn = 2 * np.pi * CARRIER_HZ / core.sample_rate_hz
    assert wave == pytest.approx(np.sin(turn * np.arange(len(wave))), abs=1e-12)
    below = uint(program, 72) + 128 * uint(program, 60)
    assert (uint(program, below), uint(program, below + 4), real(program, below + 8)) == (
        0,
        1,
        0.05,
    )


def test_regions_and_materials_are_as_the_page_says(surface, device):
    program = compile_touch(surface, everything(), device)
    materials, regions = uint(program, 72), uint(program, 76)
    assert (uint(program, 52), uint(program, 56)) == (4, 3)  # one grating for two regions
    first, second, third = (regions + 88 * number for number in range(3))

    def material(at):
        return materials + 128 * at

    def of_region(at):
        return material(uint(program, at))

    # From the bottom up: the picture, the ribs that add, the masked polygon.
    assert [uint(program, at + 8) for at in (first, second, third)] == [1, 0, 2]
    assert [uint(program, at + 12) for at in (first, second, third)] == [0, 1, 0]
    assert struct.unpack_from("<i", program, first + 16) == (-3,)
    assert real(program, first + 32, 7).tolist() == [1.0, 2.0, 0.0, 2.0, 8.0, 5.0, 1.0]
    angle = np.radians(40.0)
    middle = np.array([14.0, 10.0])
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    corner = middle - turn @ [10.0, 5.0]
    assert real(program, second + 32, 3) == pytest.approx([*corner, angle])
    assert real(program, second + 80) == 0.5
    count, at = uint(program, third + 20), uint(program, third + 24)
    assert real(program, at, 2 * count).tolist() == [0.0, 0.0, 6.0, 1.0, 3.0, 8.0]
    assert uint(program, second + 4) == uint(program, first + 4) == 0xFFFFFFFF
    for record in (of_region(first), material(uint(program, third + 4))):
        assert uint(program, record) == 1
        rows, columns = uint(program, record + 36), uint(program, record + 40)
        values = np.frombuffer(program, "<f4", rows * columns, uint(program, record + 32))
        assert (rows, columns) == LEVEL.shape
        assert values.reshape(rows, columns) == pytest.approx(LEVEL, abs=1e-7)
        assert [uint(program, record + 44), uint(program, record + 48)] == [1, 1]  # it is held
        assert real(program, record + 56) == 0.5
    ribs = of_region(second)
    assert uint(program, ribs) == 2
    assert real(program, ribs + 56, 5).tolist() == [2.0, 0.2, 0.0, 1.0, 0.3]
    # A period with all its harmonics but the first of its numbers, which are the mean.
    at, tables = uint(program, ribs + 32), uint(program, ribs + 36)
    sizes = [16 * max(count, 4) for count in (0, *(2**n for n in range(tables - 1)))]
    assert real(program, at, sizes[0]) == pytest.approx(0.3)
    finest = real(program, at + 8 * sum(sizes[:-1]), sizes[-1])
    places = (np.arange(sizes[-1]) + 0.5) / sizes[-1]
    away = np.abs(places[:, None] - [0.0, 0.3, 1.0]).min(axis=1) > 0.01
    assert finest[away] == pytest.approx((places < 0.3).astype(float)[away], abs=0.01)


def test_a_region_that_fades_out_is_left_out_and_one_that_moves_has_arrived(surface, device):
    layout = haptix.Layout()
    gone = layout.add(Grating(period_mm=2.0), width_mm=5.0, height_mm=5.0)
    stays = layout.add(Grating(period_mm=3.0), width_mm=5.0, height_mm=5.0)
    layout.attach(lambda: 1.0)
    gone.remove()
    stays.move(7.0, 8.0)
    program = compile_touch(surface, layout, device)
    assert uint(program, 56) == 1
    assert real(program, uint(program, 76) + 32, 2).tolist() == [7.0, 8.0]


def test_a_mask_a_stranger_and_a_layout_within_are_named(surface, device):
    class Stranger(haptix.feel.FrictionField):
        target, outside = "share", 0.0

        def _sample(self, x_mm, y_mm, footprint_mm):
            return np.zeros(x_mm.shape)

    ribs = Grating(period_mm=2.0)
    for fields, name in (
        ({"material": ribs, "mask": Stranger()}, "mask of region 1"),
        ({"material": Stranger()}, "region 1"),
        ({"material": haptix.Layout()}, "region 1"),
    ):
        layout = haptix.Layout()
        layout.put(haptix.feel.Region(width_mm=9.0, height_mm=9.0, **fields))
        with pytest.raises(haptix.InputError, match=f"^{name}: expected a kind of material that"):
            compile_touch(surface, layout, device)


def test_a_drive_that_is_no_carrier_is_refused(surface, device, model):
    ribs = Grating(period_mm=2.0)
    direct = haptix.FrictionSurface.build(model, {"normal_force_n": 0.5, "frequency_hz": 125.0})
    with pytest.raises(haptix.InputError, match="drive: expected a carrier, which"):
        compile_touch(direct, ribs, device, DirectWave(125.0))
    with (
        haptix.open_device("mock:sample_rate_hz=48001") as odd,
        pytest.raises(haptix.InputError, match="drive: expected a carrier that repeats"),
    ):
        compile_touch(surface, ribs, odd, SineCarrier(CARRIER_HZ))


@pytest.mark.parametrize("preset", presets(), ids=lambda preset: preset.name)
def test_the_gallery_is_compiled_to_2_mb(surface, device, preset):
    program = compile_touch(surface, preset.material, device)
    assert len(program) <= MOST_BYTES
    assert uint(program, 12) == zlib.crc32(program[16:])


def test_the_command_writes_the_same_bytes(surface, device, tmp_path):
    table, out = tmp_path / "my.surface", tmp_path / "touch.hxp"
    surface.save(table)
    carrier = ("--carrier-hz", f"{CARRIER_HZ:g}")
    shown = run_haptix(
        *("compile", "gallery:islands", "--surface", str(table), "--out", str(out), *carrier)
    )
    assert shown.code == 0, shown.err
    made = compile_touch(
        haptix.FrictionSurface.load(table).limited(device.limits.ceiling_v),
        next(preset for preset in presets() if preset.name == "islands").material,
        device,
        SineCarrier(CARRIER_HZ),
    )
    assert out.read_bytes() == made
    again = run_haptix("compile", "gallery:islands", "--surface", str(table), "--out", str(out))
    assert again.code != 0
    assert "--overwrite" in again.err
    nested = {"name": "inner", "material": {"kind": "layout"}, "width_mm": 9, "height_mm": 9}
    document = tmp_path / "nested.json"
    document.write_text(json.dumps({"kind": "layout", "regions": [nested]}))
    refused = run_haptix(
        *("compile", str(document), "--surface", str(table), "--out", str(tmp_path / "no.hxp")),
        *carrier,
    )
    assert refused.code != 0
    assert "region 'inner': expected a kind of material that is haptix's own" in refused.err
    assert not (tmp_path / "no.hxp").exists()
