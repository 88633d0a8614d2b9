"""What becomes of profiles: installed for a driver, checked by new strokes, matched, practised."""

import json
from dataclasses import replace
from datetime import date

import numpy as np
import pytest
from typer.testing import CliRunner

import firmware_io
import haptix
from calibration import (
    Parameters,
    Protocol,
    Session,
    SessionInfo,
    Stroke,
    StrokePredictor,
    full_protocol,
)
from calibration.keep.practice import TRUTH, compare_with_truth, draw_truth
from calibration.keep.profile import check_profile, match_screens
from calibration.measure.reduction import Reduced
from calibration.verify.steadiness import Drift
from firmware_io import Device, MockDriver, MockLink
from haptix.model.friction import in_theory
from haptix.model.screen import NO_INSTRUMENT, Calibration, CalibrationWarning, VerifiedRange
from haptix.play.devices import install_profile, installed_profile, profile_of, profiles_for
from haptix.tasks.cli.application import app as whole
from haptix.tasks.cli.application import group_of

app = group_of("calibrate", "Calibrate a screen.")


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("HAPTIX_PROFILES", str(tmp_path / "profiles"))


def calibrated(screen, **changes):
    """A screen as a calibration of today leaves it."""
    made = Calibration(date=date.today(), verdict="passed", spread={"h0_m": 0.05}, **changes)
    own = screen.replace(calibration=made)
    return own.replace(calibration=made.model_copy(update={"content_hash": own.content_hash()}))


@pytest.fixture
def files(tmp_path, screen, finger):
    calibrated(screen).save(tmp_path / "screen.toml")
    finger.save(tmp_path / "finger.toml")
    return tmp_path / "screen.toml", tmp_path / "finger.toml"


def test_a_driver_finds_its_own_profile_and_no_other(files):
    install_profile("A/../7", *files)
    found = installed_profile("A/../7")
    assert haptix.Screen.load(found.screen) == haptix.Screen.load(files[0])
    assert found.finger.read_bytes() == files[1].read_bytes()
    assert installed_profile("A") is installed_profile("") is None
    with (
        haptix.open_device("mock:serial=A/../7") as own,
        haptix.open_device("mock:serial=B") as other,
    ):
        assert profiles_for(own, None, None) == (str(found.finger), str(found.screen))
        assert profiles_for(own, "wet", None) == ("wet", str(found.screen))
        assert profiles_for(other, None, None) == ("semi-wet", "3m-sct3250")


def test_installed_by_the_command(files):
    made = CliRunner().invoke(
        app, ["install", str(files[0]), "--device", "mock:serial=S1", "--json"]
    )
    assert made.exit_code == 0, made.exception
    (row,) = json.loads(made.stdout)
    assert (row["serial"], row["calibration_id"]) == (
        "S1",
        haptix.Screen.load(files[0]).calibration_id,
    )
    assert installed_profile("S1") is not None


def test_what_is_not_to_be_trusted_is_not_installed(files, screen):
    for spoilt, said in (
        (screen, "expected a profile of a calibration"),
        (calibrated(screen).replace(insulator_thickness_m=2e-6), "changed after the calibration"),
    ):
        spoilt.save(files[0])
        with pytest.raises(haptix.InputError, match=said):
            install_profile("S1", *files)
    assert installed_profile("S1") is None


def test_a_practice_is_installed_for_a_mock_alone(files, screen):
    calibrated(screen, instruments=(f"force sensor: virtual finger {NO_INSTRUMENT}",)).save(
        files[0]
    )
    refused = CliRunner().invoke(app, ["install", str(files[0]), "--serial", "S1"])
    assert "a virtual finger was measured, and no screen" in str(refused.exception)
    assert installed_profile("S1") is None
    mock = ["install", str(files[0]), "--device", "mock:serial=S1"]
    assert CliRunner().invoke(app, mock).exit_code == 0
    assert installed_profile("S1") is not None


@pytest.fixture
def measured(tmp_path, screen, finger):
    """A screen, and the finger that was measured with it, which is no preset."""
    own = finger.replace(frictional_shear_stress_pa=1.33 * finger.frictional_shear_stress_pa)
    calibrated(screen, finger_hash=own.content_hash()).save(tmp_path / "screen.toml")
    own.save(tmp_path / "finger.toml")
    return tmp_path / "screen.toml", tmp_path / "finger.toml"


QUERY = ["query", "--normal-force-n", "0.5", "--voltage-v", "100"]


def test_a_calibrated_screen_takes_the_finger_beside_it(measured):
    command = [*QUERY, "--screen", str(measured[0])]
    (row,) = json.loads(CliRunner().invoke(whole, [*command, "--json"]).stdout)
    own, screen = haptix.Finger.load(measured[1]), haptix.Screen.load(measured[0])
    assert row["mu"] == float(haptix.ContactModel(own, screen).solve(0.5, 100.0).mu)
    said = {"finger": "semi-wet", "screen": "panel 7", "pair": "measured together"}
    assert {name: row[name] for name in said} == said
    shown = CliRunner().invoke(whole, command).stdout
    assert shown.startswith("finger 'semi-wet', screen 'panel 7' (measured together)\n")
    named = CliRunner().invoke(whole, [*command, "--finger", "semi-wet"]).stdout
    assert named.startswith("finger 'semi-wet', screen 'panel 7' (screen measured with another")


def test_query_and_render_say_where_they_leave_the_verified_range(tmp_path, screen, finger):
    verified = VerifiedRange(
        normal_force_n=(0.2, 0.3),
        frequency_hz=(125.0, 4000.0),
        speed_mm_per_s=(45.0, 55.0),
        voltage_v=((125.0, 200.0), (4000.0, 80.0)),
    )
    own = calibrated(screen, finger_hash=finger.content_hash(), verified=verified)
    own.save(tmp_path / "screen.toml")
    finger.save(tmp_path / "finger.toml")
    panel = ["--screen", str(tmp_path / "screen.toml")]
    query = ["query", "--voltage-v", "100", "--frequency-hz", "4000", *panel]
    out = " ".join(CliRunner().invoke(whole, [*query, "--normal-force-n", "0.5"]).stdout.split())
    words = ("force 0.5 N: verified 0.2 to 0.3", "amplitude 100 V: verified to 80")
    assert "beyond the validated range" in out and all(said in out for said in words)
    json_out = CliRunner().invoke(whole, [*query, "--normal-force-n", "0.5", "--json"]).stdout
    assert json.loads(json_out)[0]["beyond_verified"] == "; ".join(words)
    query = ["query", "--voltage-v", "70", "--normal-force-n", "0.25", *panel]
    inside = CliRunner().invoke(whole, [*query, "--frequency-hz", "4000"])
    said = " ".join(inside.stdout.split())
    assert "verified for 0.2 to 0.3 N" in said and "beyond the validated range" not in said
    # The skin conducts then: another friction than that which strokes verified.
    said = " ".join(CliRunner().invoke(whole, query).stdout.split())
    assert "no frequency, so that the skin conducts: verified 125 to 4e+03 Hz" in said
    rows = "".join(f"{0.05 * k:g},{10 + 5 * k},20,0.5\n" for k in range(9))
    (tmp_path / "path.csv").write_text(f"t_s,x_mm,y_mm,normal_force_n\n{rows}")
    render = ["render", "--trajectory", str(tmp_path / "path.csv"), *panel]
    rendered = CliRunner().invoke(whole, [*render, "--out", str(tmp_path / "out"), "--json"])
    said = json.loads(rendered.stdout)[0]["beyond_verified"]
    assert said[:2] == [words[0], "speed 100 mm/s: verified 45 to 55"]


def test_without_the_finger_that_was_measured_with_it_a_screen_is_refused(measured):
    command = [*QUERY, "--screen", str(measured[0])]
    measured[1].rename(measured[1].with_name("moved.toml"))
    refused = str(CliRunner().invoke(whole, command).exception)
    assert "expected a finger: screen 'panel 7' is calibrated, and there is no" in refused
    haptix.Finger.preset("wet").save(measured[1])
    refused = str(CliRunner().invoke(whole, command).exception)
    assert "is not the finger that was measured with screen 'panel 7'" in refused
    named = CliRunner().invoke(whole, [*command, "--finger", str(measured[1])])
    assert named.exit_code == 0


def test_a_surface_says_of_which_pair_it_is(measured, tmp_path):
    made = ["build", str(tmp_path / "my.surface"), "--screen", str(measured[0]), "--json"]
    (row,) = json.loads(CliRunner().invoke(whole, [*made, "--tolerance", "0.01"]).stdout)
    assert row["pair"] == "measured together"
    invert = ["invert", str(tmp_path / "my.surface"), "--mu", "0.5", "--normal-force-n", "0.5"]
    first = "finger 'semi-wet', screen 'panel 7' (measured together)\n"
    assert CliRunner().invoke(whole, invert).stdout.startswith(first)
    (row,) = json.loads(CliRunner().invoke(whole, [*invert, "--json"]).stdout)
    assert (row["finger"], row["screen"], row["pair"]) == (
        "semi-wet", "panel 7", "measured together",
    )  # fmt: skip


def test_a_scene_of_a_calibrated_screen_takes_the_finger_beside_it(measured):
    drive = {"scheme": "carrier", "carrier_hz": 4000.0}
    fields = {"screen": "screen.toml", "normal_force_n": 0.5, "drive": drive}
    scene = haptix.Scene(**fields, folder=measured[0].parent)
    assert scene.finger == haptix.Finger.load(measured[1])
    assert haptix.Scene(**fields, finger="wet", folder=measured[0].parent).finger.name == "wet"
    with pytest.raises(haptix.InputError, match=r"Scene\.finger: field required"):
        haptix.Scene(**{**fields, "screen": "3m-sct3250"})


def test_a_screen_given_beside_an_installed_one_keeps_its_own_finger(files, tmp_path, screen):
    install_profile("S1", *files)
    (tmp_path / "other").mkdir()
    other, wet = tmp_path / "other" / "screen.toml", haptix.Finger.preset("wet")
    calibrated(screen, finger_hash=wet.content_hash()).save(other)
    wet.save(other.with_name("finger.toml"))
    with haptix.open_device("mock:serial=S1") as device:
        assert profiles_for(device, None, str(other)) == (
            str(other.with_name("finger.toml")),
            str(other),
        )
        assert profiles_for(device, None, "3m-sct3250") == ("semi-wet", "3m-sct3250")


def opened(calibration_id):
    driver = MockDriver(serial="S1", calibration_id=calibration_id)
    return Device(MockLink(driver))


def test_the_device_s_own_calibration_is_compared(files, recwarn):
    own = haptix.Screen.load(files[0]).calibration_id
    assert len(own) == 16  # bytes of the field in the driver's report (PROTOCOL.md)
    with pytest.warns(CalibrationWarning, match=r"'other'.*installed"):
        assert profile_of(opened("other")) is None
    install_profile("S1", *files)
    with pytest.warns(CalibrationWarning, match=f"'other'.*'{own}'"):
        assert profile_of(opened("other")) is not None
    recwarn.clear()
    assert profile_of(opened(own)) == profile_of(opened("")) == installed_profile("S1")
    assert not recwarn.list


def test_every_opening_compares(monkeypatch):
    monkeypatch.setattr(firmware_io, "open_device", lambda address: opened("other"))
    with pytest.warns(CalibrationWarning, match="calibrated as 'other'"):
        haptix.open_device("usb:").close()


@pytest.fixture(scope="module")
def strokes(predictor, reduced_of, finger, screen):
    truth = Parameters.of(finger, screen)
    return reduced_of(predictor, full_protocol(180.0), truth, np.random.default_rng(2))


def test_strokes_of_the_same_screen_show_no_drift(strokes, predictor):
    found = check_profile(strokes, predictor)
    assert found.passed
    # Strokes repeat within 1 % or 0.09 JND: the mean of 58 within three times 0.09 / sqrt(58).
    assert abs(found.drifts["all"].mean_jnd) < 0.04
    assert found.drifts["all"].strokes == 58


@pytest.mark.parametrize("name", ["panel 7", "panel 8"])
def test_a_check_by_strokes_of_another_screen_says_so(
    tmp_path, files, monkeypatch, strokes, screen, finger, name
):
    calibrated(screen.replace(name="panel 7")).save(files[0])
    info = SessionInfo(screen=screen.replace(name=name), finger=finger)
    Session.begin(tmp_path / "s", full_protocol(180.0), info)
    monkeypatch.setattr("calibration.steps.reduce_folder", lambda folder: strokes)
    command = ["check", str(tmp_path / "s"), "--profile", str(files[0])]
    made = CliRunner().invoke(app, command)
    assert made.exit_code == 0, made.exception
    said = " ".join(made.output.split())
    assert ("strokes are of screen 'panel 8'" in said) is (name == "panel 8")
    assert ("passed: panel 7, by strokes on panel 8" in said) is (name == "panel 8")


def test_a_thicker_insulator_shows_under_voltage_alone(strokes, finger, screen):
    thin = screen.replace(insulator_thickness_m=0.6e-6)
    found = check_profile(strokes, StrokePredictor(haptix.ContactModel(finger, thin)))
    assert not found.passed
    assert found.drifts["with_voltage"].mean_jnd < -0.5
    assert abs(found.drifts["without_voltage"].mean_jnd) < 0.1


def test_a_drift_s_uncertainty_is_that_of_its_mean():
    rng = np.random.default_rng(0)
    drawn = [Drift.of(rng.normal(0.2, 0.3, 8)) for _ in range(500)]
    held = [abs(one.mean_jnd - 0.2) <= one.uncertainty_jnd for one in drawn]
    assert np.mean(held) == pytest.approx(0.90, abs=0.04)  # three times sqrt(0.9 0.1 / 500)
    assert not Drift.of(np.array([0.1])).is_within


def test_too_few_strokes_for_a_check(strokes, predictor):
    still = Reduced(tuple(replace(one, voltage_v=0.0) for one in strokes.points))
    with pytest.raises(haptix.InputError, match=r"2 .*voltage.*got 0"):
        check_profile(still, predictor)


def test_matched_screens_give_the_same_friction(finger, screen):
    thick = screen.replace(insulator_thickness_m=1.6e-6, name="other")
    found = match_screens(calibrated(screen), thick, [finger], (0.3,), 4000.0, 4)
    (place,) = found
    assert len(place.levels) == 4
    for row in place.levels:
        for panel, volts in ((screen, row.voltage_a_v), (thick, row.voltage_b_v)):
            mu = float(haptix.ContactModel(finger, panel).solve(0.3, volts, 4000.0).mu)
            assert mu == pytest.approx(row.mu, rel=2e-4)  # 81 voltages, straight between
        assert np.isnan(row.uncertainty_jnd)  # one of the profiles states no spread
    assert place.levels[-1].voltage_b_v > place.levels[-1].voltage_a_v
    assert place.levels[-1].difference_jnd < -0.05
    assert place.levels[0].difference_jnd == pytest.approx(0.0, abs=0.01)


def test_the_uncertainty_of_a_match_is_that_of_both_profiles(finger, screen):
    one = calibrated(screen)
    (place,) = match_screens(one, one, [finger], (0.3,), 4000.0, 3)
    row = place.levels[-1]
    assert row.difference_jnd == pytest.approx(0.0, abs=1e-9)
    low, high = (
        float(haptix.ContactModel(finger, screen).solve(0.3, row.voltage_a_v, 4000.0, h0).mu)
        for h0 in (screen.h0_m * np.exp(0.05), screen.h0_m * np.exp(-0.05))
    )
    of_one = np.log(high / low) / 2
    expected = 1.645 * np.sqrt(2) * of_one / 0.11  # two independent profiles, in JND
    assert row.uncertainty_jnd == pytest.approx(expected, rel=0.02)


def test_what_is_the_screens_and_what_the_fingers(finger, screen):
    moist = finger.replace(frictional_shear_stress_pa=1.33 * finger.frictional_shear_stress_pa)
    thick = calibrated(screen.replace(insulator_thickness_m=1.6e-6, name="other"))
    (place,) = match_screens(calibrated(screen), thick, [finger, moist], (0.3,), 4000.0, 3)
    row = place.levels[-1]

    def mu(of, panel, volts=row.voltage_a_v):
        return float(haptix.ContactModel(of, panel).solve(0.3, volts, 4000.0).mu)

    shares = [mu(one, thick) / mu(one, screen) for one in (finger, moist)]
    both = np.sqrt(shares[0] * shares[1])
    assert row.difference_jnd == pytest.approx((both - 1) / 0.11, abs=2e-3)
    # A third more shear stress is a third more friction on any screen: three JND, and no screen's.
    assert row.fingers_jnd == pytest.approx(0.33 / 0.11, rel=2e-3)
    for share in shares:
        assert abs((share - 1) / 0.11 - row.difference_jnd) <= row.uncertainty_jnd
    at_b = np.sqrt(mu(finger, thick, row.voltage_b_v) * mu(moist, thick, row.voltage_b_v))
    assert at_b == pytest.approx(row.mu, rel=2e-4)  # 81 voltages, straight between


def test_a_match_allows_for_a_finger_of_another_law(finger, screen):
    """A finger that follows another form of the mean field than its profile says."""
    thick = calibrated(screen.replace(insulator_thickness_m=1.6e-6, name="other"))
    (place,) = match_screens(calibrated(screen), thick, [finger], (0.5,), 4000.0, 3)
    row = place.levels[-1]
    for law in ("corrected", "local"):
        other = in_theory(finger, law)
        mus = [
            float(haptix.ContactModel(other, panel).solve(0.5, row.voltage_a_v, 4000.0).mu)
            for panel in (screen, thick)
        ]
        assert abs((mus[1] / mus[0] - 1) / 0.11 - row.difference_jnd) <= row.uncertainty_jnd


def test_a_gauge_study_of_sessions_is_in_jnd(tmp_path, finger, screen):
    """Two panels by two operators, twice each; operators differ by 0.3 JND, trials by 0.1."""
    plan = Protocol(
        strokes=[Stroke(number=1, normal_force_n=0.5, voltage_v=0.0, frequency_hz=125.0)]
    )
    folders, usual = [], finger.frictional_shear_stress_pa
    for panel, of_panel in (("a", 0.0), ("b", 5.0)):
        for who, of_person in (("x", 0.0), ("y", 0.3)):
            for trial in (0.0, 0.1):
                folder = tmp_path / f"{panel}{who}{trial}"
                size = np.exp(0.11 * (of_panel + of_person + trial))
                own = finger.replace(frictional_shear_stress_pa=usual * size)
                named = screen.replace(name=panel)
                Session.begin(folder, plan, SessionInfo(screen=named, finger=own, operator=who))
                calibrated(named, finger_hash=own.content_hash()).save(folder / "screen.toml")
                own.save(folder / "finger.toml")
                folders.append(str(folder))
    found = json.loads(CliRunner().invoke(app, ["gauge", *folders, "--json"]).stdout)
    sds = {one["source"]: one["sd"] for one in found["components"]}
    # Two levels that are d apart have a standard deviation of d / sqrt(2), less that of their own.
    assert sds["repeatability"] == pytest.approx(0.1 / np.sqrt(2), rel=0.2)
    assert sds["operator"] == pytest.approx(0.3 / np.sqrt(2), rel=0.1)
    assert sds["panel"] == pytest.approx(5 / np.sqrt(2), rel=0.01)
    assert found["distinct_categories"] == int(np.sqrt(2) * sds["panel"] / found["gauge"])
    assert found["verdict"] == "not fit"  # six times 0.22 JND of a width of 1 JND


def test_match_lays_both_measured_fingers_on_both_screens(tmp_path, finger, screen):
    wet = haptix.Finger.preset("wet")
    paths = []
    for name, own in (("a", finger), ("b", wet)):
        (tmp_path / name).mkdir()
        panel = calibrated(screen.replace(name=name), finger_hash=own.content_hash())
        panel.save(tmp_path / name / "screen.toml")
        own.save(tmp_path / name / "finger.toml")
        paths.append(str(tmp_path / name / "screen.toml"))
    command = ["match", *paths, "--levels", "2", "--normal-force-n", "0.5"]
    (place,) = json.loads(CliRunner().invoke(app, [*command, "--json"]).stdout)
    (expected,) = match_screens(screen, screen, [finger, wet], (0.5,), 4000.0, 2)
    assert place["levels"][1]["fingers_jnd"] == pytest.approx(expected.levels[1].fingers_jnd)
    assert place["levels"][1]["difference_jnd"] == 0.0  # equal screens
    assert [one["pair"] for one in place["profiles"]] == ["measured together"] * 2
    (place,) = json.loads(CliRunner().invoke(app, [*command, "--json", "--finger", "wet"]).stdout)
    assert place["levels"][1]["fingers_jnd"] == 0.0


def test_match_and_its_json(files):
    command = ["match", str(files[0]), str(files[0]), "--levels", "2", "--normal-force-n", "0.5"]
    made = CliRunner().invoke(app, [*command, "--json"])
    assert made.exit_code == 0, made.exception
    (place,) = json.loads(made.stdout)
    assert place["levels"][1]["voltage_a_v"] == place["levels"][1]["voltage_b_v"]
    files[1].unlink()
    assert "expected a finger" in str(CliRunner().invoke(app, command).exception)


def test_a_practice_s_truth_is_its_own_and_light(tmp_path, finger, screen, predictor):
    plan = full_protocol(120.0)
    truth = draw_truth(finger, screen, plan, 3)
    assert truth == draw_truth(finger, screen, plan, 3) != draw_truth(finger, screen, plan, 4)
    truth.save(tmp_path / TRUTH)
    truth.screen.save(tmp_path / "screen.toml")
    truth.finger.save(tmp_path / "finger.toml")
    exact = compare_with_truth(tmp_path, 120.0)
    assert exact.h0_error == exact.friction_error_worst_jnd == 0
    stiff = truth.finger.replace(
        frictional_shear_stress_pa=1.11 * truth.finger.frictional_shear_stress_pa
    )
    stiff.save(tmp_path / "finger.toml")
    found = compare_with_truth(tmp_path, 120.0)
    assert found.friction_error_median_jnd == pytest.approx(1.0, rel=1e-6)
