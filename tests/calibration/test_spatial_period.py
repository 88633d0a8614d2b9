"""What repeats along a stroke: ridges under a tactile finger."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import haptix
from calibration import ColumnMap
from calibration.measure.segmentation import spatial_period
from haptix.tasks.cli.application import group_of

app = group_of("calibrate", "Calibrate a screen.")

CHANNELS = [f"channel{index}" for index in range(1, 17)]
DATA = Path(__file__).parents[3] / "shared" / "data" / "fabricslide"


def column_map(speed):
    columns = {
        "t_s": {"column": "timestamp", "unit": "ms"},
        "x_mm": {"speed_mm_per_s": speed},
        **{name: {"column": name, "unit": "raw"} for name in CHANNELS},
    }
    return ColumnMap(columns=columns)


def found_in(path, speed):
    found = column_map(speed).read(path)
    signals = np.stack([found[name] for name in CHANNELS], axis=-1)
    return spatial_period(found["t_s"], found["x_mm"], signals)


def write_csv(path, speed, period_mm, rng, shape=np.sin):
    """The columns, rate, resolution and drift of such a file, over ridges of a known period."""
    t_ms = 443_000 + np.cumsum(rng.choice([27, 28, 29], size=round(150_000 / speed / 28)))
    x = (t_ms - t_ms[0]) / 1000 * speed
    head = ["timestamp", "proximity1", "proximity2", *CHANNELS]
    rows = [t_ms, np.full_like(t_ms, 300), np.full_like(t_ms, 51_000)]
    for _ in CHANNELS:
        ridge = rng.uniform(0, 4) * shape(2 * np.pi * x / period_mm + rng.uniform(0, 6))
        drift = rng.uniform(-40, 40) * x / 150 + 20 * np.sin(x / 25)
        rows.append(np.round(150 + drift + ridge + rng.normal(0, 2, len(x))).astype(int))
    lines = [", ".join(head), *(",".join(map(str, row)) for row in zip(*rows, strict=True))]
    path.write_text("\n".join(lines) + "\n")


@pytest.mark.parametrize("speed", [5, 10, 20, 30])
@pytest.mark.parametrize("period", [3.0, 4.0, 5.0])
def test_a_known_period(tmp_path, speed, period):
    write_csv(tmp_path / "x.csv", speed, period, np.random.default_rng(speed))
    found = found_in(tmp_path / "x.csv", speed)
    # The same 1 % as for the real files: 150 mm hold 30 to 50 periods.
    assert found.period_mm == pytest.approx(period, rel=0.01)
    assert (found.harmonic, found.fundamental_mm) == (1, found.period_mm)
    assert found.is_significant


def harmonics(turn):
    """Of a wide ridge, as a finger rounds it: 1, 3 and 4 times its wave number."""
    return 3 * np.sin(turn) + np.sin(3 * turn) + 0.8 * np.sin(4 * turn)


@pytest.mark.parametrize(("longest", "number"), [(6.0, 4), (8.0, 3), (25.0, 1)])
def test_a_harmonic_is_said_to_be_one(tmp_path, longest, number):
    write_csv(tmp_path / "x.csv", 10, 20.0, np.random.default_rng(1), harmonics)
    found = column_map(10).read(tmp_path / "x.csv")
    signals = np.stack([found[name] for name in CHANNELS], axis=-1)
    one = spatial_period(found["t_s"], found["x_mm"], signals, longest_mm=longest)
    assert one.harmonic == number
    assert one.period_mm == pytest.approx(20 / number, rel=0.01)
    assert one.fundamental_mm == pytest.approx(20, rel=0.02)  # 7 periods
    assert ("harmonic" in one.summary) == (number > 1)


@pytest.mark.parametrize("channels", [1, 4])
def test_noise_has_no_significant_period(channels):
    """At most 1 in 100 is wanted: of 20 strokes, 3 or more have p = 0.001."""
    rng = np.random.default_rng(channels)
    x = np.arange(0, 150, 0.3)
    found = [spatial_period(x / 30, x, rng.normal(size=(len(x), channels))) for _ in range(20)]
    assert sum(one.is_significant for one in found) < 3
    assert "no significant period" in next(o for o in found if not o.is_significant).summary


def test_the_command(tmp_path):
    write_csv(tmp_path / "x.csv", 10, 20.0, np.random.default_rng(1), harmonics)
    column_map(99).save(tmp_path / "map.toml")
    command = ["period", str(tmp_path / "x.csv"), "--columns", str(tmp_path / "map.toml")]
    made = CliRunner().invoke(app, [*command, "--speed-mm-per-s", "10", "--json"])
    assert made.exit_code == 0, made.exception
    (row,) = json.loads(made.stdout)
    assert row["period_mm"] == pytest.approx(5.0, rel=0.01)
    assert row["harmonic"] == 4
    said = CliRunner().invoke(app, command[:2]).exception
    assert "--columns: expected a column map" in str(said)


@pytest.mark.optional
@pytest.mark.parametrize(("board", "period", "harmonic"), [("2mm", 4.0, 1), ("10mm", 5.0, 4)])
def test_ridges_of_a_real_tactile_finger(board, period, harmonic):
    """A board of 10 mm ridges and 10 mm gaps repeats after 20 mm."""
    files = sorted(DATA.glob(f"Board{board}_*.csv")) if DATA.is_dir() else []
    if not files:
        pytest.skip(f"no recordings in {DATA}")
    assert len(files) == 12
    for path in files:
        found = found_in(path, float(re.search(r"V-(\d+)mmps", path.name)[1]))
        # 1 % of the ridges' own; a stroke holds 7 of the 20 mm.
        assert found.period_mm == pytest.approx(period, rel=0.01), path.name
        assert found.harmonic == harmonic, path.name
        assert found.fundamental_mm == pytest.approx(period * harmonic, rel=0.03), path.name
        assert found.is_significant, path.name


def test_samples_too_far_apart_do_not_invent_a_period():
    # 0.84 mm apart: a period of 1.4 mm would look like others; none below 1.85 mm is offered.
    x = np.arange(0, 150, 0.84)
    found = spatial_period(x / 30, x, np.sin(2 * np.pi * x / 1.4))
    assert found.period_mm > 2 * 0.84


def test_too_short_a_stroke():
    t = np.arange(0, 1, 1e-2)
    with pytest.raises(haptix.InputError, match="24 mm"):
        spatial_period(t, 10 * t, np.sin(t))
