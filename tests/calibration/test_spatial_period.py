"""What repeats along a stroke: ridges under a tactile finger."""

import re
from pathlib import Path

import numpy as np
import pytest

import haptix
from calibration import ColumnMap
from calibration.segmentation import spatial_period_mm

CHANNELS = [f"channel{index}" for index in range(1, 17)]
DATA = Path(__file__).parents[3] / "shared" / "data" / "fabricslide"


def column_map(speed):
    columns = {
        "t_s": {"column": "timestamp", "unit": "ms"},
        "x_mm": {"speed_mm_per_s": speed},
        **{name: {"column": name, "unit": "raw"} for name in CHANNELS},
    }
    return ColumnMap(columns=columns)


def period_of(path, speed):
    found = column_map(speed).read(path)
    signals = np.stack([found[name] for name in CHANNELS], axis=-1)
    return spatial_period_mm(found["t_s"], found["x_mm"], signals)


def write_csv(path, speed, period_mm, rng):
    """The columns, rate, resolution and drift of such a file, over ridges of a known period."""
    t_ms = 443_000 + np.cumsum(rng.choice([27, 28, 29], size=round(150_000 / speed / 28)))
    x = (t_ms - t_ms[0]) / 1000 * speed
    head = ["timestamp", "proximity1", "proximity2", *CHANNELS]
    rows = [t_ms, np.full_like(t_ms, 300), np.full_like(t_ms, 51_000)]
    for _ in CHANNELS:
        ridge = rng.uniform(0, 4) * np.sin(2 * np.pi * x / period_mm + rng.uniform(0, 6))
        drift = rng.uniform(-40, 40) * x / 150 + 20 * np.sin(x / 25)
        rows.append(np.round(150 + drift + ridge + rng.normal(0, 2, len(x))).astype(int))
    lines = [", ".join(head), *(",".join(map(str, row)) for row in zip(*rows, strict=True))]
    path.write_text("\n".join(lines) + "\n")


@pytest.mark.parametrize("speed", [5, 10, 20, 30])
@pytest.mark.parametrize("period", [3.0, 4.0, 5.0])
def test_a_known_period(tmp_path, speed, period):
    write_csv(tmp_path / "x.csv", speed, period, np.random.default_rng(speed))
    # The same 1 % as for the real files: 150 mm hold 30 to 50 periods.
    assert period_of(tmp_path / "x.csv", speed) == pytest.approx(period, rel=0.01)


@pytest.mark.optional
def test_ridges_of_a_real_tactile_finger():
    files = sorted(DATA.glob("Board2mm_F150_*.csv")) if DATA.is_dir() else []
    if not files:
        pytest.skip(f"no recordings in {DATA}")
    for path in files:
        speed = float(re.search(r"V-(\d+)mmps", path.name)[1])
        assert period_of(path, speed) == pytest.approx(4.0, rel=0.01), path.name


def test_samples_too_far_apart_do_not_invent_a_period():
    # 0.84 mm apart: a period of 1.4 mm would look like others; none below 1.85 mm is offered.
    x = np.arange(0, 150, 0.84)
    found = spatial_period_mm(x / 30, x, np.sin(2 * np.pi * x / 1.4))
    assert found > 2 * 0.84


def test_too_short_a_stroke():
    t = np.arange(0, 1, 1e-2)
    with pytest.raises(haptix.InputError, match=r"slides for 24 mm or more, got"):
        spatial_period_mm(t, 10 * t, np.sin(t))
