"""Over days and panels: charts, gauges and the register, against published and injected numbers."""

import json
import multiprocessing
from datetime import date, timedelta

import numpy as np
import pytest
from typer.testing import CliRunner

import haptix
from calibration.keep.gauge import ControlChart, GaugeStudy
from calibration.measure.session import Instrument, Instruments
from calibration.register import Panel, Register, StandardReading, update_register
from haptix.tasks.cli.application import group_of

app = group_of("calibrate", "Calibrate a screen.")
DAY = date(2026, 3, 1)

# AIAG, Measurement Systems Analysis, 4th edition, chapter III: ten parts, three appraisers, three
# trials.
AIAG = """
 0.29 -0.56 1.34 0.47 -0.80 0.02 0.59 -0.31 2.26 -1.36
 0.41 -0.68 1.17 0.50 -0.92 -0.11 0.75 -0.20 1.99 -1.25
 0.64 -0.58 1.27 0.64 -0.84 -0.21 0.66 -0.17 2.01 -1.31
 0.08 -0.47 1.19 0.01 -0.56 -0.20 0.47 -0.63 1.80 -1.68
 0.25 -1.22 0.94 1.03 -1.20 0.22 0.55 0.08 2.12 -1.62
 0.07 -0.68 1.34 0.20 -1.28 0.06 0.83 -0.34 2.19 -1.50
 0.04 -1.38 0.88 0.14 -1.46 -0.29 0.02 -0.46 1.77 -1.49
 -0.11 -1.13 1.09 0.20 -1.07 -0.67 0.01 -0.56 1.45 -1.77
 -0.15 -0.96 0.67 0.11 -1.45 -0.49 0.21 -0.49 1.87 -2.16
"""


def published():
    """Shape (parts, appraisers, trials)."""
    return np.array(AIAG.split(), dtype=float).reshape(3, 3, 10).transpose(2, 0, 1)


def test_the_published_example_has_its_published_numbers():
    study = GaugeStudy.of(published(), ("part", "appraiser"))
    squares = {one.source: one.squares for one in study.components}
    assert squares["part"] == pytest.approx(88.3619, abs=1e-4)
    assert squares["appraiser"] == pytest.approx(3.1673, abs=1e-4)
    assert squares["repeatability"] == pytest.approx(0.3590 + 2.7589, abs=1e-4)  # pooled
    assert study.sd("repeatability") == pytest.approx(0.199933, abs=1e-6)
    assert study.reproducibility == pytest.approx(0.226838, abs=1e-6)
    assert study.gauge == pytest.approx(0.302373, abs=2e-6)  # of rounded parts
    assert study.sd("part") == pytest.approx(1.042327, abs=1e-6)
    assert study.distinct_categories == 4  # as published: 1.41 * 1.04233 / 0.30237 = 4.86
    assert study.share_of_tolerance(4.0) == pytest.approx(6 * 0.302373 / 8, abs=1e-5)
    assert (study.verdict(10.0), study.verdict(4.0), study.verdict(1.0)) == (
        "good", "conditional", "not fit",
    )  # fmt: skip


def exactly(rng, count, sd):
    """Effects whose sample variance is the injected one: few levels would scatter about it."""
    drawn = rng.normal(size=count)
    drawn -= drawn.mean()
    return sd * drawn / drawn.std(ddof=1)


def test_injected_variances_of_panels_fingers_and_days_come_back():
    """Five panels, three fingers, three days, four trials of 1 %: within 20 % in the mean."""
    sds = {"panel": 0.2, "finger": 0.1, "day": 0.05, "repeatability": 0.03}
    rng, found = np.random.default_rng(1), []
    for _ in range(20):
        panels, fingers, days = (
            exactly(rng, n, sd) for n, sd in zip((5, 3, 3), sds.values(), strict=False)
        )
        values = panels[:, None, None, None] + fingers[:, None, None] + days[:, None]
        values = values + rng.normal(0, sds["repeatability"], (5, 3, 3, 4))
        study = GaugeStudy.of(values, ("panel", "finger", "day"))
        found.append([study.sd(name) ** 2 for name in sds])
    ratio = np.array(found) / np.square(list(sds.values()))
    # Interactions that scatter made in one of four studies take 3 % of the repeatability.
    assert np.abs(ratio.mean(0) - 1).max() < 0.05
    assert np.abs(ratio - 1).max() < 0.2 + 0.25  # a single study: 180 values give 11 % of scatter
    assert (np.abs(ratio - 1) < 0.2).mean() > 0.9


def test_an_interaction_that_is_there_is_found():
    rng = np.random.default_rng(2)
    values = rng.normal(0, 1, (5, 1, 1)) + rng.normal(0, 0.5, (5, 3, 1))
    study = GaugeStudy.of(values + rng.normal(0, 0.05, (5, 3, 4)), ("panel", "operator"))
    assert study.sd("panel with operator") == pytest.approx(0.5, rel=0.5)
    assert study.sd("repeatability") == pytest.approx(0.05, rel=0.3)


def test_the_gauge_of_a_table(tmp_path):
    rows = ["panel,operator,value"]
    for (part, appraiser, _), value in np.ndenumerate(published()):
        rows.append(f"p{part},{'ABC'[appraiser]},{value}")
    (tmp_path / "g.csv").write_text("\n".join(rows) + "\n")
    made = CliRunner().invoke(app, ["gauge", str(tmp_path / "g.csv"), "--json"])
    assert json.loads(made.stdout)["gauge"] == pytest.approx(0.302373, abs=2e-6)
    (tmp_path / "g.csv").write_text("\n".join(rows[:-1]) + "\n")
    made = CliRunner().invoke(app, ["gauge", str(tmp_path / "g.csv")])
    assert "expected every panel with every operator, as often" in str(made.exception)


def test_a_chart_stays_quiet_and_speaks_up():
    rng = np.random.default_rng(3)
    steady = rng.normal(0.1, 0.05, 20)
    assert ControlChart.of(steady[:4]).findings == ()
    chart = ControlChart.of(steady)
    assert chart.findings == () and chart.alarms == ()
    # Three deviations of nineteen, by Student: 3.5 and more of a sample whose own scatters.
    assert 3.0 < (chart.high - chart.middle) / steady[:19].std(ddof=1) < 4.0
    assert "outside" in ControlChart.of([*steady, 0.5]).text
    shifted = ControlChart.of([*steady, *(0.2 + 0.01 * rng.normal(size=9))])
    assert any(one.startswith("shift") for one in shifted.findings)
    drifting = ControlChart.of([*steady, *(0.1 + 0.03 * np.arange(20))])
    assert any(one.startswith("shift") for one in drifting.findings)
    assert ControlChart.of([0.1] * 30).findings == ()


def test_the_rates_of_the_chart_are_those_it_states():
    rng, charts = np.random.default_rng(4), 250
    quiet = sum(bool(ControlChart.of(rng.normal(size=40)).alarms) for _ in range(charts))
    assert quiet / charts == pytest.approx(1 / 8, abs=3 * np.sqrt(1 / 8 * 7 / 8 / charts))
    for before, share in ((20, 0.9), (10, 0.7)):
        seen = sum(
            bool(ControlChart.of([*rng.normal(size=before), 5 + rng.normal()]).findings)
            for _ in range(charts)
        )
        assert seen / charts == pytest.approx(share, abs=3 * np.sqrt(share * (1 - share) / charts))
    waits = []
    for _ in range(100):
        values = rng.normal(size=60)
        values[20:] += 2.0
        after = [place for place in ControlChart.of(values).alarms if place >= 20]
        waits.append(after[0] - 19 if after else 40)
    assert 3 <= np.median(waits) <= 5


def panel(name, **fields):
    return Panel(panel=name, session=f"/{name}", state="passed", **fields)


def enter(path, name):
    update_register(path, DAY, lambda register: register.with_panel(panel(name)))


def test_two_rigs_at_once_lose_nothing(tmp_path):
    path, names = tmp_path / "register.json", [f"panel {n}" for n in range(16)]
    with multiprocessing.get_context("fork").Pool(4) as pool:
        pool.starmap(enter, [(path, name) for name in names])
    kept = Register.load(path)
    assert sorted(one.panel for one in kept.panels) == sorted(names)
    enter(path, names[0])
    assert len(Register.load(path).panels) == 16


def test_a_clock_that_was_set_back_and_a_damaged_register_change_nothing(tmp_path):
    path = tmp_path / "register.json"
    enter(path, "panel 1")
    before = path.read_bytes()
    with pytest.raises(haptix.InputError, match=r"clock shows 2026-02-28.*nothing was changed"):
        update_register(path, DAY - timedelta(days=1), lambda register: register)
    assert path.read_bytes() == before
    path.write_bytes(before[:-9])
    with pytest.raises(haptix.HaptixError, match=r"register\.json"):
        enter(path, "panel 2")
    assert path.read_bytes() == before[:-9]


def test_of_several_calibrations_the_newest_with_a_verdict_stands():
    def one(session, state, days=None, **more):
        day = None if days is None else DAY + timedelta(days=days)
        return Panel(panel="7", session=session, state=state, measured_on=day, **more)

    failed, older = one("b", "failed", 9), one("a", "passed", 1)
    kept = Register(written_on=DAY, panels=(failed,)).with_panel(older)
    assert kept.panels == (failed,) and kept.history == (older,)
    # Neither a session that has only begun nor a practice says more of the panel.
    kept = kept.with_panel(one("c", "open")).with_panel(one("d", "practice", 20))
    assert kept.panels == (failed,) and len(kept.history) == 3
    assert "practice" in one("d", "practice", 20).due(DAY)
    again = one("a", "passed", 12)  # its own earlier entry goes
    kept = kept.with_panel(again)
    assert kept.panels == (again,) and older not in kept.history and failed in kept.history
    assert Register(**kept.model_dump()) == kept


def test_a_session_that_was_copied_under_another_name_is_refused():
    first = Panel(panel="7", session="/a", state="passed", strokes=("ab", "cd"))
    copied = first.model_copy(update={"panel": "8", "session": "/b"})
    kept = Register(written_on=DAY).with_panel(first)
    with pytest.raises(haptix.InputError, match="copied under another name"):
        kept.with_panel(copied)
    moved = first.model_copy(update={"session": "/c"})  # the same session in another folder
    assert kept.with_panel(moved).panels == (moved,)


def test_due_dates():
    one = panel("7", due_on=DAY)
    assert one.due(DAY - timedelta(days=40)) == "not due"
    assert one.due(DAY - timedelta(days=10)) == "due in 10 days"
    assert one.due(DAY + timedelta(days=3)) == "overdue for 3 days"


def test_readings_are_charted_in_order_of_time():
    rows = [
        StandardReading(standard="s", measured_on=DAY + timedelta(days=n), change_jnd=0.1 * n)
        for n in (3, 1, 2)
    ]
    register = Register(written_on=DAY, readings=tuple(rows))
    assert register.chart("s").values == pytest.approx((0.1, 0.2, 0.3))


def instrument(**fields):
    usual = {"name": "force sensor", "serial": "FT1", "certificate": "DK-1"}
    dates = {"calibrated_on": DAY, "due_on": DAY + timedelta(days=365)}
    return Instrument(**{**usual, **dates, **fields})


@pytest.mark.parametrize(
    ("used", "day", "said"),
    [
        ({"force sensor": "FT1", "driver": "7"}, DAY, ""),
        (
            {"force sensor": "FT2"},
            DAY,
            'no instrument of the file has name = "force sensor" and serial = "FT2"',
        ),
        ({"force sensor": "FT1"}, DAY + timedelta(days=366), "expired on 2027-03-01"),
        ({"force sensor": "FT1"}, DAY - timedelta(days=1), "was a clock set back?"),
    ],
)
def test_instruments_hold_from_their_certificate_to_its_end(used, day, said):
    faults = Instruments(instruments=(instrument(),)).faults(used, day)
    assert bool(faults) == bool(said)
    assert said in "".join(faults)


def test_the_command_refuses_an_expired_instrument(tmp_path, finger):
    path = tmp_path / "instruments.toml"
    Instruments(instruments=(instrument(calibrated_on=date(2020, 1, 1), due_on=DAY),)).save(path)
    made = CliRunner().invoke(app, ["instruments", str(path), "--json"])
    assert made.exit_code == 1, made.exception
    assert "expired on 2026-03-01" in json.loads(made.stdout)[0]["remarks"]
    finger.save(tmp_path / "finger.toml")
    run = ["run", str(tmp_path / "s"), "--name", "x", "--practice", "--yes"]
    run += ["--finger", str(tmp_path / "finger.toml")]
    refused = CliRunner().invoke(app, [*run, "--instruments", str(path)])
    assert "no instrument of the file has" in str(refused.exception)
    assert not (tmp_path / "s" / "strokes").exists()
