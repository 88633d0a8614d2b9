"""Tables and JSON of the commands, against the library."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

import haptix
from haptix.base.terminal import show
from haptix.model.surface import FrictionSurface
from haptix.tasks.cli import COMMANDS as LISTED

ROOT = Path(haptix.__file__).parents[1]
COMMANDS = ["demo", "build", "query", "invert", "devices", "doctor", "cache"]


def model(finger="semi-wet", screen="3m-sct3250"):
    return haptix.ContactModel(haptix.Finger.preset(finger), haptix.Screen.preset(screen))


def in_a_process(*arguments, **options):
    return subprocess.run(
        [sys.executable, *arguments], capture_output=True, text=True, check=False, **options
    )


def in_a_folder(monkeypatch):
    """Let a process started elsewhere find the packages under test."""
    monkeypatch.setenv("PYTHONPATH", str(ROOT))


@pytest.mark.parametrize("command", [None, *COMMANDS])
def test_help_names_what_it_takes(haptix_cli, command):
    shown = haptix_cli(*([command] if command else []), "--help")
    assert shown.code == 0
    assert "Usage" in shown.out
    assert max(map(len, shown.out.splitlines())) <= 80
    wanted = {
        None: COMMANDS,
        "demo": ["--out", "--image", "--trajectory", "--width-mm", "--polarity", "--json"],
        "build": ["--normal-force-n", "--voltage-v", "--tolerance", "--overwrite", "--json"],
        "query": ["--normal-force-n", "--voltage-v", "--surface", "--json"],
        "invert": ["--mu", "--normal-force-n", "--json"],
        "devices": ["--json"],
        "doctor": ["--json"],
        "cache": ["--clear", "--json"],
    }[command]
    for word in wanted:
        assert word in shown.out


@pytest.mark.parametrize("command", ["build", "query", "invert"])
def test_help_keeps_its_units_and_defaults(haptix_cli, command):
    # Square brackets are markup to rich, which drops them unless told otherwise.
    shown = re.sub(r"[\s│]+", " ", haptix_cli(command, "--help").out)
    assert "[m]" in shown
    assert "screen's own" in shown


def test_the_list_of_commands_says_what_each_says_itself(haptix_cli):
    # The list is made without loading the commands, so it has sentences of its own.
    for name, (_, sentence) in LISTED.items():
        shown = " ".join(haptix_cli(name, "--help").out.split())
        assert f" {sentence} " in shown, name


@pytest.mark.parametrize("columns", ["40", "80", "200"])
def test_the_help_without_typer_is_the_one_with_it(haptix_cli, monkeypatch, columns):
    monkeypatch.setenv("COLUMNS", columns)
    fast = haptix_cli("--help")
    slow = haptix_cli("--help", "--help")
    assert (fast.code, fast.err) == (slow.code, slow.err) == (0, "")
    # The first line names the program, which Typer takes pytest for.
    usage, lines = fast.out.split("\n\n", 1)
    assert usage == "Usage: haptix [OPTIONS] COMMAND [ARGS]..."
    assert slow.out.split("\n\n", 1)[1] == lines


def test_a_typing_error_names_the_command_that_is_nearest(haptix_cli):
    assert "'demo'" in haptix_cli("demmo").err


def test_help_loads_nothing_heavy():
    code = f"""
import sys
from haptix.tasks.cli import main
for command in {[None, *COMMANDS]!r}:
    sys.argv = ["haptix", *([command] if command else []), "--help"]
    try:
        main()
    except SystemExit as end:
        assert not end.code
print(sorted({{"torch", "numpy", "scipy", "matplotlib", "skimage"}} & set(sys.modules)))
"""
    done = in_a_process("-c", code, cwd=ROOT)
    assert done.stdout.splitlines()[-1] == "[]", done.stderr


def test_without_a_command_there_is_help(haptix_cli):
    shown = haptix_cli()
    assert "Usage" in shown.out + shown.err
    assert "demo" in shown.out + shown.err


def test_query_of_the_model(haptix_cli):
    shown = haptix_cli("query", "--normal-force-n", "0.2,1", "--voltage-v", "0,100,200", "--json")
    assert shown.code == 0
    rows = json.loads(shown.out)
    assert [(r["normal_force_n"], r["voltage_v"]) for r in rows] == [
        (f, v) for f in (0.2, 1.0) for v in (0.0, 100.0, 200.0)
    ]
    for row in rows:
        state = model().solve(row["normal_force_n"], row["voltage_v"])
        assert row.pop("status") == "OK"
        assert (row.pop("finger"), row.pop("screen")) == ("semi-wet", "3m-sct3250")
        assert row.pop("pair") == "screen not measured"
        assert row.pop("h_rms_m") == model().finger.roughness.h_rms_m
        del row["normal_force_n"], row["voltage_v"], row["roughness_spread_jnd"]
        for name, value in row.items():
            # The tables of attraction are laid out for the forces asked for, and so differ between
            # one force and two by their interpolation, some 1e-6.
            assert value == pytest.approx(float(getattr(state, name)), rel=1e-5), name
        assert set(row) == {
            "mu",
            "x",
            "area_fraction",
            "attraction_pa",
            "pull_in_voltage_v",
            "pull_past_breakdown",
        }


def test_query_with_frequency_and_thickness(haptix_cli):
    shown = haptix_cli(
        *("query", "--finger", "wet", "--normal-force-n", 0.5, "--voltage-v", 50),
        *("--frequency-hz", "100,4000", "--h0-m", "1e-7,2e-7", "--json"),
    )
    rows = json.loads(shown.out)
    assert [(r["frequency_hz"], r["h0_m"]) for r in rows] == [
        (f, h) for f in (100.0, 4000.0) for h in (1e-7, 2e-7)
    ]
    for row in rows:
        state = model("wet").solve(0.5, 50.0, row["frequency_hz"], row["h0_m"])
        assert row["mu"] == pytest.approx(float(state.mu), rel=1e-6)


def test_query_with_another_skin_dielectric(haptix_cli):
    given = ("query", "--normal-force-n", 0.5, "--voltage-v", 100, "--frequency-hz", 125)
    named = (*given, "--skin-dielectric", "gabriel-dry")
    (row,) = json.loads(haptix_cli(*named, "--json").out)
    skin = haptix.Finger.preset("semi-wet").replace(dielectric="gabriel-dry")
    screen = haptix.Screen.preset("3m-sct3250")
    state = haptix.ContactModel(skin, screen).solve(0.5, 100.0, 125.0)
    assert row["mu"] == pytest.approx(float(state.mu), rel=1e-12)
    assert row["skin_dielectric_spread_jnd"] > 0.1
    assert row["roughness_spread_jnd"] > 0.1
    assert "others in their place: skin dielectric" in " ".join(haptix_cli(*named).out.split())


def test_query_says_pull_in(haptix_cli):
    shown = haptix_cli(
        "query", "--normal-force-n", 0.5, "--voltage-v", "10,200", "--h0-m", "1e-8", "--json"
    )
    rows = json.loads(shown.out)
    assert [row["status"] for row in rows] == ["OK", "PULL_IN"]
    assert 10 < rows[0]["pull_in_voltage_v"] < 200


def test_query_of_a_finger_and_a_screen_in_files(haptix_cli, things):
    shown = haptix_cli(
        *("query", "--finger", "soft.toml", "--screen", "fragile.toml"),
        *("--normal-force-n", 0.5, "--voltage-v", 120, "--json"),
    )
    (row,) = json.loads(shown.out)
    # "soft.toml" has the numbers of the preset "wet".
    # The file names no theory, and has the paper's tau_f of wet skin.
    soft = haptix.Finger.preset("wet").replace(frictional_shear_stress_pa=5e6, theory="open-gaps")
    expected = haptix.ContactModel(soft, haptix.Screen.preset("3m-sct3250")).solve(0.5, 120.0).mu
    assert row["mu"] == pytest.approx(float(expected), rel=1e-9)


def test_query_of_a_surface(haptix_cli, surface_file):
    shown = haptix_cli(
        *("query", "--surface", surface_file),
        *("--normal-force-n", "0.1,0.5", "--voltage-v", "0,150", "--json"),
    )
    assert shown.code == 0
    surface = FrictionSurface.load(surface_file)
    rows = json.loads(shown.out)
    assert [row["status"] for row in rows] == ["OUT_OF_RANGE"] * 2 + ["OK"] * 2
    for row in rows:
        names = {"finger", "screen", "pair"}
        intervals = {"interval_jnd", "contrast_interval_jnd"}
        assert set(row) == {"normal_force_n", "voltage_v", "mu", "status", *names, *intervals}
        cell = surface.intervals(row["normal_force_n"]).mu_jnd
        shown_jnd = row["interval_jnd"]
        assert float(cell) == (float("inf") if shown_jnd is None else shown_jnd)
        # Outside, the value is that of the nearest force, 0.2 N.
        force = max(row["normal_force_n"], 0.2)
        assert row["mu"] == pytest.approx(float(surface.mu(force, row["voltage_v"])), rel=1e-12)


def test_invert_of_a_surface(haptix_cli, surface_file):
    shown = haptix_cli(
        *("invert", surface_file, "--mu", "0.3,0.5,0.1,9"),
        *("--normal-force-n", "0.25,0.7", "--json"),
    )
    assert shown.code == 0
    rows = json.loads(shown.out)
    assert [row["mu"] for row in rows] == [0.3, 0.3, 0.5, 0.5, 0.1, 0.1, 9, 9]
    surface = FrictionSurface.load(surface_file)
    for row in rows:
        voltage = row["voltage_v"]
        if row["status"] == "OK":
            back = float(surface.mu(row["normal_force_n"], voltage))
            assert back == pytest.approx(row["mu"], rel=1e-9)
        else:
            assert (row["status"], voltage) == (
                ("BELOW", 0.0) if row["mu"] == 0.1 else ("ABOVE", pytest.approx(200.0))
            )
    assert sum(row["status"] == "OK" for row in rows) == 4


def test_build_writes_a_surface_that_keeps_its_promise(haptix_cli):
    shown = haptix_cli(
        *("build", "sub/my.surface", "--normal-force-n", "0.4,0.6", "--voltage-v", 150),
        *("--frequency-hz", 2000, "--tolerance", 0.01, "--json"),
    )
    assert shown.code == 0
    (row,) = json.loads(shown.out)
    path = Path("sub/my.surface")
    assert row["file"] == str(path)
    assert row["bytes"] == path.stat().st_size
    assert (row["tolerance"], row["unit"], row["met"]) == (0.01, "mu", True)
    assert 0 < row["error_p99"] <= row["error_max"] <= 0.01
    surface = FrictionSurface.load(path)
    assert row["grid"] == " x ".join(str(n) for n in surface.mu_table.shape if n > 1)
    assert surface.voltage_limit_v == 150.0
    assert (surface.normal_force_n.low, surface.normal_force_n.high) == (0.4, 0.6)
    solved = model()
    assert row["mu_low"] == pytest.approx(float(solved.solve(0.5, 0.0, 2000.0).mu), rel=1e-3)
    for force, voltage in ((0.43, 140.0), (0.55, 60.0)):
        expected = float(solved.solve(force, voltage, 2000.0).mu)
        assert float(surface.mu(force, voltage, 2000.0)) == pytest.approx(expected, abs=0.01)
    assert list(path.parent.iterdir()) == [path]  # and no temporary file beside it


@pytest.mark.slow
def test_build_says_when_a_tolerance_cannot_be_met(haptix_cli):
    asked = ("build", "my.surface", "--normal-force-n", "0.3,0.9", "--tolerance", "1e-6")
    refused = haptix_cli(*asked, "--largest-mb", "0.001")
    assert refused.code == 3
    assert "tolerance 1e-06 mu cannot be met within 1,000 bytes: reached" in refused.err
    assert "--accept-best" in refused.err
    assert not Path("my.surface").exists()
    accepted = haptix_cli(*asked, "--largest-mb", "0.001", "--accept-best", "--json")
    assert accepted.code == 0
    (row,) = json.loads(accepted.out)
    assert row["met"] is False
    assert row["error_max"] > 1e-6
    surface = FrictionSurface.load("my.surface")
    assert surface.nbytes <= 1000
    error = abs(float(surface.mu(0.5, 150.0)) - float(model().solve(0.5, 150.0).mu))
    assert error <= row["error_max"]


@pytest.mark.parametrize(
    ("tolerance", "unit"),
    [("0.05 thresholds", "JND"), ("0.05 JND", "JND"), ("0.5 %", "percent of range")],
)
def test_tolerances_in_units_of_people(haptix_cli, tolerance, unit):
    asked = ("build", "my.surface", "--tolerance", tolerance, "--overwrite", "--json")
    (row,) = json.loads(haptix_cli(*asked).out)
    assert (row["unit"], row["met"]) == (unit, True)


def test_build_overwrites_only_if_told(haptix_cli):
    path = Path("my.surface")
    path.write_text("precious")
    arguments = ("build", path, "--normal-force-n", 0.5, "--tolerance", 0.05)
    refused = haptix_cli(*arguments)
    assert refused.code == 2
    assert "--overwrite" in refused.err
    assert path.read_text() == "precious"
    assert haptix_cli(*arguments, "--overwrite").code == 0
    assert FrictionSurface.load(path).normal_force_n.low == 0.5


def test_devices(haptix_cli):
    shown = haptix_cli("devices", "--json")
    assert shown.code == 0
    mock, *others = json.loads(shown.out)
    assert (mock["address"], mock["usable"]) == ("mock:", True)
    assert not any(device["usable"] for device in others)


def test_doctor(haptix_cli, tmp_path):
    shown = haptix_cli("doctor", "--json")
    assert shown.code == 0
    rows = {row["check"]: row for row in json.loads(shown.out)}
    buses = {"usb", "hid", "audio", "serial", "daq"}
    assert {
        "haptix",
        "packages",
        "torch",
        "cache",
        "solver",
        "udev rule",
        "firmware",
        "timing",
        "touchscreen",
        "driver",
        "audio output",
        "permissions",
        "clock",
    } | buses == set(rows)
    for name in ("haptix", "packages", "torch", "cache", "solver", "firmware"):
        assert rows[name]["ok"] == "yes"
    assert haptix.__version__ in rows["haptix"]["detail"]
    assert rows["cache"]["detail"] == str(tmp_path / "cache")


def test_doctor_fails_a_cache_that_is_a_file(haptix_cli, monkeypatch, things):
    monkeypatch.setenv("HAPTIX_CACHE", str(things / "file"))
    shown = haptix_cli("doctor", "--json")
    assert {row["check"]: row["ok"] for row in json.loads(shown.out)}["cache"] == "no"
    assert shown.code == 1


def test_doctor_fails_a_wrong_solver(haptix_cli, monkeypatch):
    from haptix.model.contact import MeanField

    right = MeanField.area_fraction
    monkeypatch.setattr(MeanField, "area_fraction", lambda self, p: 1.01 * right(self, p))
    shown = haptix_cli("doctor", "--json")
    assert {row["check"]: row["ok"] for row in json.loads(shown.out)}["solver"] == "no"
    assert shown.code == 1


WIDE = ("--frequency-hz", "1234,4000", "--h0-m", "1.25e-8,1e-7")


@pytest.mark.parametrize("more", [pytest.param((), id="narrow"), pytest.param(WIDE, id="wide")])
def test_a_table_fits_its_terminal_whole(haptix_cli, more):
    arguments = ("query", "--normal-force-n", "0.25,0.5", "--voltage-v", "0,199.5", *more)
    rows = json.loads(haptix_cli(*arguments, "--json").out)
    shown = haptix_cli(*arguments)
    assert shown.code == 0
    lines = shown.out.splitlines()
    assert max(map(len, lines)) <= 80
    # The least load and the largest share of a pull past breakdown stand in the title alone.
    assert f"from {min(row.pop('x') for row in rows):.2g};" in " ".join(shown.out.split())
    assert f"up to {max(row.pop('pull_past_breakdown') for row in rows):.0%}" in " ".join(
        shown.out.split()
    )
    # What others in place of placeholders change has no columns: the title says it, whole.
    spreads = [[row.pop(name) for row in rows] for name in [*rows[0]] if name.endswith("_jnd")]
    # Nor have finger and screen: they stand in the first line.
    names = [{row.pop(name) for row in rows} for name in ("finger", "screen", "pair")]
    assert all(name in lines[0] for (name,) in names)
    # One number of the finger alone, for programs.
    assert {row.pop("h_rms_m") for row in rows} == {2.2e-5}
    assert all(f"{max(spread):.2g} JND" in " ".join(lines) for spread in spreads)
    assert "from gaps whose field is past what they bear:" in " ".join(shown.out.split())
    # Every word of the headings, where there is room for words, and every value in one piece.
    heading = " ".join(lines[: next(i for i, line in enumerate(lines) if "──" in line)])
    for name in rows[0] if not more else ():
        for word in name.split("_"):
            assert word in heading.split(), name
    body = [line.split() for line in lines if re.search(r"\b(OK|PULL_IN)$", line.rstrip())]
    assert len(body) == len(rows)
    for cells, row in zip(body, rows, strict=True):
        *numbers, status = row.values()
        assert cells[-1] == status
        assert [float(cell) for cell in cells[:-1]] == pytest.approx(numbers, rel=1e-3)


def test_a_table_wider_than_its_terminal_loses_no_value(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "20")
    title = "a title of [m] that is longer than a line"
    show(
        title, [{"one_column": 1.25e-08, "another": 123.4, "a_third": -9876.5, "last": "OK"}], False
    )
    lines = capsys.readouterr().out.splitlines()
    assert " ".join(" ".join(lines[:3]).split()).startswith(title)
    assert any(line.split() == ["1.25e-08", "123.4", "-9876", "OK"] for line in lines)


@pytest.mark.slow  # demos and their summaries: tests/play/simulation
def test_demo_prints_its_summary(haptix_cli, things):
    arguments = ("demo", "--out", "out", "--image", "photo.png", "--trajectory", "short.csv")
    shown = haptix_cli(*arguments, "--json")
    assert shown.code == 0
    (summary,) = json.loads(shown.out)
    assert summary == json.loads(Path("out/summary.json").read_text())
    table = haptix_cli(*arguments, "--carrier-hz", 3000).out
    assert max(map(len, table.splitlines())) <= 80
    assert "photo.png" in table
    assert "placeholders" in table


def test_no_json_of_nan(haptix_cli):
    # NaN is no JSON; a force that no finger has is a wrong input.
    shown = haptix_cli("query", "--normal-force-n", "1e300", "--voltage-v", 1, "--json")
    assert shown.code == 2 or json.loads(shown.out, parse_constant=pytest.fail)


@pytest.mark.slow  # a process with torch; test_interruptions.py has lighter ones
def test_as_a_module_in_a_process(monkeypatch):
    in_a_folder(monkeypatch)
    query = ("-m", "haptix.tasks.cli", "query", "--normal-force-n", "0.5", "--voltage-v")
    done = in_a_process(*query, "100", "--json")
    assert (done.returncode, done.stderr) == (0, "")
    (row,) = json.loads(done.stdout)
    assert row["mu"] == pytest.approx(float(model().solve(0.5, 100.0).mu), rel=1e-9)


@pytest.mark.slow
def test_an_ascii_terminal(monkeypatch):
    in_a_folder(monkeypatch)
    monkeypatch.setenv("PYTHONIOENCODING", "ascii")
    build = ("-m", "haptix.tasks.cli", "build", "a.surface", "--normal-force-n", "0.5")
    done = in_a_process(*build)
    assert done.returncode == 0, done.stderr
    assert "a.surface" in done.stdout


def test_an_interrupted_build_leaves_nothing(haptix_cli, monkeypatch, own_folder):
    def interrupted(*arguments, **options):
        raise KeyboardInterrupt

    monkeypatch.setattr(FrictionSurface, "build", interrupted)
    shown = haptix_cli("build", "my.surface")
    assert shown.code == 130  # what a shell expects after Ctrl-C
    assert "Traceback" not in shown.err
    assert list(own_folder.iterdir()) == []
