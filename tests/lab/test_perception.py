"""Thresholds and the rule of two channels: data, closed forms, and what is refused."""

import numpy as np
import pytest

from haptix.base.errors import HaptixError, InputError
from haptix.lab.stimuli.designs import matched_intensity
from haptix.model.perception.thresholds import (
    DEFAULT_FILE,
    WEBER_FRACTION,
    Channel,
    Component,
    Perception,
    components_of_pull,
    detection,
)

RATE = 48_000.0


@pytest.mark.parametrize(
    ("drive_hz", "threshold_db"), [(80, 25.8), (120, 24.5), (180, 18.8), (270, 18.5), (400, 25.3)]
)
def test_the_thresholds_of_bau_2010(drive_hz, threshold_db):
    """Physics page, section 7; a drive is felt at twice its frequency."""
    known = Perception.default()
    channel = next(one for one in known.channels if one.name == "pacinian")
    assert channel.threshold(2 * drive_hz) == pytest.approx(threshold_db)
    assert not channel.is_placeholder and channel.source
    assert WEBER_FRACTION == known.weber_fraction == 0.11
    assert known.amplitude.step_db == 1.2


def test_the_most_sensitive_channel_decides():
    known = Perception.default()
    assert known.channel_at(300).name == "pacinian"
    with pytest.raises(InputError, match=r"30 Hz.*160 to 800"):
        known.channel_at(30)  # not known, and nothing is put in its place
    assert known.channel_at(360).threshold(360) == pytest.approx(18.8)
    with pytest.raises(InputError, match=r"5000 Hz.*160 to 800"):
        known.channel_at(5000)


def test_a_sine_drive_is_its_own_measure():
    t = np.arange(4800) / RATE
    (found,) = components_of_pull(37.0 * np.sin(2 * np.pi * 120 * t), RATE)
    assert found.felt_hz == pytest.approx(240)
    assert found.drive_v == pytest.approx(37.0, rel=1e-9)
    level = detection([found])
    assert level.channel == "pacinian"
    assert level.sensation_db == pytest.approx(20 * np.log10(37) - 24.5, abs=1e-9)


def test_a_square_drive_pulls_steadily_and_is_felt_by_its_edges_alone():
    """An ideal square wave's pull does not change: nothing is felt where nothing disperses."""
    drive = np.tile(np.r_[np.ones(200), -np.ones(200)], 12)
    assert len(components_of_pull(50 * drive, RATE)) == 0
    with pytest.raises(InputError, match="no component"):
        detection([])


def test_energies_add_within_a_channel_and_not_between():
    two = Perception.default().replace(
        channels=(
            Channel(name="a", felt_hz=(10.0, 100.0), threshold_db=(20.0, 20.0)),
            Channel(name="b", felt_hz=(200.0, 900.0), threshold_db=(20.0, 20.0)),
        )
    )
    one = detection([Component(50.0, 20.0)], two)
    both = detection([Component(50.0, 20.0), Component(80.0, 20.0)], two)
    # Twice the energy of a pull, which goes with the fourth power of the voltage.
    assert both.sensation_db - one.sensation_db == pytest.approx(5 * np.log10(2))
    across = detection([Component(50.0, 20.0), Component(500.0, 20.0)], two)
    assert across.sensation_db == pytest.approx(one.sensation_db)
    assert detection([Component(50.0, 20.0), Component(500.0, 21.0)], two).channel == "b"


@pytest.mark.parametrize("drive", ["direct", "carrier"])
def test_matched_tones_are_at_one_sensation_level(drive, response):
    from haptix.lab.stimuli import Rendering

    made = matched_intensity("m", [170.0, 250.0, 500.0, 750.0], 9.0, 1.0, drive, fade_s=0.0)
    for one in made:
        block = Rendering(one, response).block(0, 48_000)
        (*rest, strongest) = sorted(
            components_of_pull(block.instant_v / np.sqrt(2), RATE, 0.01), key=lambda c: c.drive_v
        )
        assert strongest.felt_hz == pytest.approx(one.conditions["felt_hz"])
        assert detection([strongest]).sensation_db == pytest.approx(9.0, abs=1e-6)
        assert all(other.drive_v < 0.05 for other in rest)
        assert one.conditions["channel"] == "pacinian"
    with pytest.raises(InputError, match="2000 Hz"):
        matched_intensity("m", [2000.0], 9.0, 1.0)


def test_every_number_says_where_it_was_read():
    known = Perception.default()
    for one in (known.difference, *known.alternatives):
        assert one.source and one.condition and one.read_from
    for channel in known.channels:
        assert channel.source and channel.condition and channel.read_from
    assert known.jnd().of(0.5) == known.difference_mu(0.5) == pytest.approx(0.055)
    assert known.jnd().direction == "falling"
    assert known.jnd("samur-2009").of(0.5) == pytest.approx(0.09)
    with pytest.raises(InputError, match="gueorguiev-2017"):
        known.jnd("nobody-1900")


def test_data_are_replaced_by_a_file(tmp_path):
    text = DEFAULT_FILE.read_text().replace("weber_fraction = 0.11", "weber_fraction = 0.18")
    (tmp_path / "mine.toml").write_text(text)
    assert Perception.load(tmp_path / "mine.toml").difference_mu(0.5) == pytest.approx(0.09)


@pytest.mark.parametrize(
    ("old", "new", "pattern"),
    [
        ("weber_fraction = 0.11", "", "weber_fraction"),
        ("weber_fraction = 0.11", "weber_fraction = -1", "weber_fraction.*-1"),
        ("felt_hz = [160.0, 240.0", "felt_hz = [240.0", "felt_hz"),
        ("felt_hz = [160.0, 240.0", "felt_hz = [240.0, 160.0", "increase"),
        ("[difference]", "[difference", "TOML"),
        ("low_hz = 20.0", "low_hz = 0.0", "low_hz"),
    ],
)
def test_wrong_files_say_what(tmp_path, old, new, pattern):
    path = tmp_path / "mine.toml"
    path.write_text(DEFAULT_FILE.read_text().replace(old, new, 1))
    with pytest.raises(HaptixError, match=f"mine.toml.*{pattern}"):
        Perception.load(path)
    with pytest.raises(HaptixError, match=r"nowhere\.toml"):
        Perception.load(tmp_path / "nowhere.toml")
