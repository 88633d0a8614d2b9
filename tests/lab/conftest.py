"""One finger on one screen, solved once; stimuli of it."""

import numpy as np
import pytest

from firmware_io import open_device
from haptix import ContactModel, FrictionSurface
from haptix.lab.stimuli import rendering


@pytest.fixture(scope="session")
def surface(model):
    """Force and frequency vary, so that slicing has something to blend."""
    ranges = {"normal_force_n": (0.3, 0.8), "frequency_hz": (100.0, 6000.0)}
    return FrictionSurface.build(model, ranges, "0.05 JND")


@pytest.fixture(scope="session")
def response(surface):
    return surface.column(0.5, 4000.0)


_models = {}


@pytest.fixture
def own_cache(tmp_path_factory, monkeypatch):
    """Surfaces and solved contacts of one session are kept for its tests, and nowhere else."""
    root = tmp_path_factory.getbasetemp() / "surfaces"
    monkeypatch.setenv("HAPTIX_CACHE", str(root))

    def once(finger, screen):
        key = (finger.model_dump_json(), screen.model_dump_json())
        if key not in _models:
            _models[key] = ContactModel(finger, screen)
        return _models[key]

    monkeypatch.setattr(rendering, "ContactModel", once)
    return root


@pytest.fixture(autouse=True)
def undrawn(monkeypatch):
    """No sheet of a set, which takes longer than the rest of it; test_pictures.py draws one."""
    monkeypatch.setattr("haptix.lab.stimuli.drawing.contact_sheet", lambda *given: b"no picture")


@pytest.fixture
def rng():
    return np.random.default_rng(20)


@pytest.fixture
def device():
    opened = open_device("mock:")
    yield opened
    opened.close()
