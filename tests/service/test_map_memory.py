"""Memory of generated materials: counted before it is taken, and given back."""

import gc
import io
from hashlib import sha256
from itertools import product
from weakref import ref

import numpy as np
import pytest
from PIL import Image

from haptix.base.errors import InputError
from haptix.feel import Noise, Texture
from haptix.feel.layout import Layout
from haptix.feel.materials.memory import MapMemory
from haptix.feel.materials.pyramid import Pyramid, pyramid_numbers
from haptix.service.engine import process, session_layout
from haptix.service.engine.session_layout import RegionError, SessionLayout

PIXELS = 64
ONE_BYTES = 8 * pyramid_numbers(PIXELS, PIXELS, "repeat", "repeat")


def noise(name, seed, **fields):
    material = {"kind": "noise", "pixels": PIXELS, "shortest_mm": 3.0, "seed": seed} | fields
    return {"name": name, "material": material, "width_mm": 20, "height_mm": 20}


def noises(count, seed=0):
    return {"regions": [noise(f"n{number}", seed + number) for number in range(count)]}


@pytest.fixture(autouse=True)
def only_what_is_new_is_collected():
    """Collections do not look through what other tests have left, half a second each time."""
    gc.freeze()


@pytest.fixture
def small(monkeypatch):
    """Budgets of ten noises for a session, and of fifteen for all."""
    monkeypatch.setattr(session_layout, "MOST_SESSION_MAP_BYTES", 10 * ONE_BYTES)
    return MapMemory(15 * ONE_BYTES, "all sessions' materials")


def test_the_memory_of_a_map_is_known_before_it_is_made():
    repeats = ("outside", "hold", "repeat")
    for rows, columns, beyond_x, beyond_y in product((1, 3, 8), (1, 7, 32), repeats, repeats):
        if (beyond_x == "repeat" and columns == 7) or (beyond_y == "repeat" and rows == 3):
            continue  # these need powers of two
        made = Pyramid(np.ones((rows, columns)), 1.0, 0.0, beyond_x, beyond_y)
        wanted = pyramid_numbers(rows, columns, beyond_x, beyond_y)
        assert made._numbers.size == wanted, (rows, columns, beyond_x, beyond_y)


def test_a_session_has_a_budget_and_so_have_all(tmp_path, small):
    one, other = (SessionLayout(tmp_path, small) for _ in range(2))
    one.set(noises(8))
    with pytest.raises(RegionError, match="this session's materials would take") as refused:
        one.change([{"op": "add", **noise(f"more{seed}", seed)} for seed in (90, 91, 92)])
    assert refused.value.path == "/ops/2" and len(one.regions) == 8
    with pytest.raises(RegionError, match="all sessions' materials would take"):
        other.set(noises(8, seed=20))
    assert small.used_bytes == 8 * ONE_BYTES
    other.set(noises(8))  # equal noises share a map
    assert small.used_bytes == 8 * ONE_BYTES
    del one, refused
    gc.collect()
    other.set(noises(9, seed=1))
    del other
    gc.collect()
    assert small.used_bytes == 0


def test_a_layout_that_is_replaced_gives_its_memory_back(tmp_path, small):
    layout = SessionLayout(tmp_path, small)
    for seed in range(0, 400, 40):
        layout.set({"regions": []})
        layout.set(noises(9, seed))
    assert small.used_bytes == 9 * ONE_BYTES
    layout.set({"regions": [noise("n", 0)]})
    for seed in range(1, 121):
        layout.change([{"op": "change", "name": "n", "material": noise("n", seed)["material"]}])
    assert small.used_bytes <= 2 * ONE_BYTES  # the one before fades out


def test_what_would_not_fit_is_not_made(tmp_path, small, monkeypatch):
    monkeypatch.setattr(Noise, "_tile", lambda self, rows: pytest.fail("it was made"))
    for fields in ({"pixels": 4096}, {"pixels": 2**24, "grain": "ribbed"}):
        with pytest.raises(RegionError, match="MiB"):
            SessionLayout(tmp_path, small).set({"regions": [noise("n", 0, **fields)]})
    content = b"position_mm,mu\n0,0.2\n10,0.4\n40,0.3\n"
    digest = sha256(content).hexdigest()
    (tmp_path / f"{digest}.csv").write_bytes(content)
    recording = {"kind": "recording", "file": f"sha256:{digest}", "step_mm": 1e-3}
    with pytest.raises(RegionError, match="larger step"):
        SessionLayout(tmp_path, small).set({"regions": [noise("n", 0) | {"material": recording}]})


def test_pictures_count_as_what_is_made_of_them(tmp_path, small):
    file = io.BytesIO()
    Image.fromarray(np.random.default_rng(0).integers(0, 255, (32, 32), np.uint8)).save(file, "png")
    digest = sha256(file.getvalue()).hexdigest()
    (tmp_path / f"{digest}.png").write_bytes(file.getvalue())

    def photograph(width_mm):
        material = {"kind": "photograph", "file": f"sha256:{digest}", "width_mm": width_mm}
        return noise(f"w{width_mm}", 0) | {"material": material}

    layout = SessionLayout(tmp_path, small)
    layout.set({"regions": [photograph(5.0)]})
    one_bytes = small.used_bytes
    assert one_bytes >= 8 * 32 * 32
    room = small.most_bytes // one_bytes
    with pytest.raises(RegionError, match="materials would take"):
        layout.set({"regions": [photograph(5.0 + number) for number in range(room + 1)]})
    layout.set({"regions": [noise("none", 0)]})  # and nothing of the refused is kept
    gc.collect()
    assert small.used_bytes <= ONE_BYTES + one_bytes


def test_effects_count_too(tmp_path):
    class Playing:
        def play(self, material, done):
            return Noise(pixels=PIXELS, seed=7).evaluator

    class Quiet:
        def write(self, data):
            return None

        flush = close = lambda self: None

    engine = process.EngineServer(Quiet())
    engine._assets, engine._renderer = tmp_path, Playing()
    engine._maps = MapMemory(ONE_BYTES - 1, "all")
    with pytest.raises(InputError, match="of all would take"):
        engine._do_play({"kind": "button"})


def test_a_copy_of_a_texture_lives_as_long_as_the_texture():
    layout, texture = Layout(), Texture([[0.0, 1.0]], width_mm=4.0)
    region = layout.add(texture, width_mm=4.0, height_mm=2.0)
    copy = ref(layout.store.shown.regions[0].evaluator)
    region.remove()
    again = layout.add(texture, width_mm=4.0, height_mm=2.0)
    assert layout.store.shown.regions[0].evaluator is copy()
    again.remove()
    layout.add(Noise(pixels=PIXELS), width_mm=4.0, height_mm=2.0).remove()
    del texture
    gc.collect()
    assert copy() is None
