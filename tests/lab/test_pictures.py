"""Pictures: that they show what the sidecar says, and need no contact model."""

import numpy as np
import pytest
from skimage.io import imread

from haptix.base.errors import FileFormatError
from haptix.feel import Sine, TimeNoise
from haptix.lab import Population
from haptix.lab.stimuli import Stimulus, StimulusSet
from haptix.lab.stimuli.drawing import contact_sheet, draw_stimulus, read_for_drawing

pytestmark = pytest.mark.usefixtures("own_cache")


@pytest.fixture(scope="module")
def made(tmp_path_factory, finger, screen):
    stimuli = (
        Stimulus("tone", (Sine(0.05, 10.0) + 0.08).lasting(0.5)),
        Stimulus("noise", (TimeNoise(0.01, (20.0, 80.0), seed=3) + 0.1).lasting(0.2)),
        Stimulus(
            "direct", Sine(60.0, 120.0).lasting(0.2), "volts", carrier_hz=None, drive_hz=120.0
        ),
        Stimulus("blink", (Sine(0.01, 10.0) + 0.03).lasting(2e-4)),
    )
    folder = tmp_path_factory.mktemp("made")
    people = Population.around(finger, 2, {"frictional_shear_stress_pa": 0.1}, seed=1)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HAPTIX_CACHE", str(tmp_path_factory.mktemp("cache")))
        one = StimulusSet("one", stimuli, finger, (screen,)).make(folder / "one")
        two = StimulusSet("two", stimuli[:1], people, (screen,)).make(folder / "two")
    return one, two


def test_the_friction_drawn_is_the_friction_wanted(made):
    """From the file's samples alone, by demodulation and the sidecar's table."""
    drawn = read_for_drawing(made[0].folder / "tone.wav")
    wanted = 1.08 + 0.05 * np.sin(2 * np.pi * 10 * drawn.amplitude_t_s)
    ground = drawn.table["predicted"]["mu_without_voltage"]
    # The table has 65 nodes, and a period of the carrier is fitted by one amplitude.
    np.testing.assert_allclose(drawn.mu, ground * wanted, rtol=2e-3)
    direct = read_for_drawing(made[0].folder / "direct.wav")
    # A direct sine has its own amplitude in each of its periods.
    np.testing.assert_allclose(direct.amplitude_v, 60.0, rtol=1e-3)


@pytest.mark.slow
def test_pictures_are_drawn(made, tmp_path):
    one, two = made
    for path in (one.folder / "direct.wav", one.folder / "blink.wav", two.folder / "tone.wav"):
        (tmp_path / "a.png").write_bytes(draw_stimulus(path))
        picture = imread(tmp_path / "a.png")
        assert picture.shape[0] > 600 and picture.std() > 10
    sheet = (one.folder / "sheet.png").read_bytes()
    assert imread(one.folder / "sheet.png").std() > 10
    files = [one.folder / table["file"] for table in one.sidecars]
    assert contact_sheet("one", files, one.sidecars) == sheet  # equal inputs, equal bytes


def test_files_without_a_sidecar_are_refused(made, tmp_path):
    data = (made[0].folder / "tone.wav").read_bytes()
    (tmp_path / "a.wav").write_bytes(data)
    with pytest.raises(FileFormatError, match=r"a\.json"):
        draw_stimulus(tmp_path / "a.wav")
    (tmp_path / "a.json").write_text("{}")
    with pytest.raises(FileFormatError, match="sidecar"):
        draw_stimulus(tmp_path / "a.wav")
    (tmp_path / "tone.json").write_bytes((made[0].folder / "tone.json").read_bytes())
    (tmp_path / "tone.wav").write_bytes(b"no sound")
    with pytest.raises(FileFormatError, match=r"tone\.wav"):
        draw_stimulus(tmp_path / "tone.wav")
