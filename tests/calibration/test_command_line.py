"""All steps as a technician takes them, on the virtual finger."""

import json
import re
import shutil
from functools import partial
from itertools import pairwise
from pathlib import Path

import pytest
from jinja2 import Template
from matplotlib.backends.backend_agg import FigureCanvasAgg
from typer.testing import CliRunner

import haptix
from calibration import Fit, Protocol, Session, steps
from calibration.keep import session_report
from calibration.keep.practice import VIRTUAL_RIG
from calibration.keep.session_report import _Sheets
from calibration.measure.rig import RIG
from calibration.steps import RESTS_ON, fit_folder, reduce_folder, verify_folder
from haptix.base.errors import InputError
from haptix.model.screen import NO_INSTRUMENT
from haptix.tasks.campaign import run_campaign
from haptix.tasks.campaign.plans import CalibrationFits
from haptix.tasks.cli.application import app as whole
from haptix.tasks.cli.application import group_of

app = group_of("calibrate", "Calibrate a screen.")

run = CliRunner()


@pytest.fixture(scope="module")
def folder(tmp_path_factory, finger):
    """A session of few strokes, measured."""
    folder = tmp_path_factory.mktemp("calibration")
    finger.save(folder / "finger.toml")
    known = ["--finger", str(folder / "finger.toml")]
    planning = ["plan", str(folder / "plan.toml"), "--minutes", "1.7", "--json", *known]
    made = run.invoke(app, planning)
    assert made.exit_code == 0, made.output
    assert_for_machines(made.stdout)
    plan = Protocol.load(folder / "plan.toml")
    short = [one.model_copy(update={"length_mm": 14.0}) for one in plan.strokes]
    plan.model_copy(update={"strokes": tuple(short)}).save(folder / "plan.toml")
    arguments = ["measure", str(folder / "s"), "--plan", str(folder / "plan.toml"), *known]
    arguments += ["--source", "virtual", "--device", "mock:", "--name", "panel 7", "--json"]
    made = run.invoke(app, arguments)
    assert made.exit_code == 0, made.output
    assert json.loads(made.stdout)[0]["still_open"] == []
    return folder


@pytest.fixture(scope="module")
def fitted(folder, tmp_path_factory):
    """A copy of the session, reduced and fitted."""
    copy = tmp_path_factory.mktemp("fitted") / "s"
    shutil.copytree(folder / "s", copy, ignore=shutil.ignore_patterns("*.toml", "*.zip"))
    shutil.copy(folder / "s" / "protocol.toml", copy)
    reduce_folder(copy)
    known = {"youngs_modulus_pa": 4e7, "h_rms_m": 22e-6}
    fit_folder(copy, known, {"apparent_area_at_1n_m2": (45.65e-6, 0.05)}, compare=False)
    return copy


def fits_of(folder, **fields):
    known = {"youngs_modulus_pa": 4e7, "h_rms_m": 22e-6}
    given = {"sessions": (str(folder),), "fixed": known, "compare": False, **fields}
    return CalibrationFits(name="priors", kind="calibration-fits", **given)


@pytest.mark.slow
def test_a_campaign_has_a_task_for_each_session_and_prior(fitted):
    plan = fits_of(fitted, priors={"apparent_area_at_1n_m2": (0.05, 0.4)})
    tasks = [*plan.tasks()]
    assert [task.labels["prior_spread"] for task in tasks] == [None, 0.05, 0.4]
    assert len({task.key for task in tasks}) == 3
    with pytest.raises(InputError, match="youngs_modulus"):
        [*fits_of(fitted, priors={"youngs_modulus": (1,)}).tasks()]


@pytest.mark.slow
def test_a_campaign_fits_as_the_command_and_by_other_priors(fitted, tmp_path):
    plan = fits_of(fitted, priors={"apparent_area_at_1n_m2": (0.05,)})
    usual, close = run_campaign(plan, tmp_path).rows
    own = Fit.load(fitted / "fit.json")  # by 45.65 mm2, within 5 %
    there = tmp_path / "results" / close["key"][:2] / close["key"] / "fit.json"
    assert Fit.load(there).log_values.tolist() == own.log_values.tolist()
    assert Fit.load(there).covariance.tolist() == own.covariance.tolist()
    assert close["apparent_area_at_1n_m2 spread"] < usual["apparent_area_at_1n_m2 spread"]


def assert_for_machines(text):
    """Keys are snake_case; a numeric field has a number or null in every row."""

    def walk(value):
        if isinstance(value, dict):
            for key, one in value.items():
                assert re.fullmatch(r"[a-z][a-z0-9_]*|\d+", key), key
                words = (
                    "name",
                    "verdict",
                    "contrast_verdict",
                    "advice",
                    "remarks",
                    "term",
                    "need",
                    "what",
                    "failures",
                    "group",
                    "theory",
                    "quantity",
                    "source",
                    "kind",
                    "unit",
                    "outlier",  # why a stroke is none of the fit, or empty
                )
                if isinstance(one, str):
                    assert key.startswith(words), (key, one)
                walk(one)
        elif isinstance(value, list):
            for one in value:
                walk(one)

    walk(json.loads(text, parse_constant=lambda name: pytest.fail(f"{name} is no JSON")))


@pytest.mark.slow
def test_all_the_way_to_a_surface(folder):
    session = str(folder / "s")
    made = run.invoke(app, ["reduce", session, "--json"])
    assert made.exit_code == 0, made.output
    assert len(json.loads(made.stdout)) == 10
    assert_for_machines(made.stdout)
    # Six strokes are few: the finger is known from elsewhere.
    knowledge = ["--fix", "youngs_modulus_pa=4e7", "--fix", "h_rms_m=22e-6"]
    knowledge += ["--prior", "apparent_area_at_1n_m2=45.65e-6,0.05", "--no-compare"]
    made = run.invoke(app, ["fit", session, *knowledge, "--json"])
    assert made.exit_code == 0, made.exception
    assert_for_machines(made.stdout)
    found = {one["name"]: one for one in json.loads(made.stdout)["estimates"]}
    assert found["h0_m"]["value"] == pytest.approx(1.25e-7, rel=0.1)
    done = run.invoke(app, ["verify", session, "--json"])
    assert json.loads(done.stdout)["verdict"] == "provisional", done.output
    right = VIRTUAL_RIG
    right.save(folder / "s" / "rig.toml")
    # The fit takes the sensor's bandwidth from the check.
    early = run.invoke(app, ["verify", session])
    assert "rig.toml was added after the fit" in str(early.exception)
    assert run.invoke(app, ["fit", session, *knowledge]).exit_code == 0
    done = run.invoke(app, ["verify", session, "--json"])
    assert json.loads(done.stdout)["verdict"] == "passed", done.output
    assert_for_machines(done.stdout)
    assert done.exit_code == 0
    for name in ("screen.toml", "finger.toml", "report.html", "archive.zip"):
        assert (folder / "s" / name).stat().st_size > 100
    screen = haptix.Screen.load(folder / "s" / "screen.toml")
    query = ["query", "--normal-force-n", "0.5", "--voltage-v", "100", "--json"]
    query += ["--screen", str(folder / "s" / "screen.toml")]  # whose finger is beside it
    answer = run.invoke(whole, query)
    assert answer.exit_code == 0, answer.output
    finger = haptix.Finger.load(folder / "s" / "finger.toml")
    mu = float(haptix.ContactModel(finger, screen).solve(0.5, 100.0).mu)
    assert json.loads(answer.stdout)[0]["mu"] == pytest.approx(mu, rel=1e-4)


def certify(folder):
    """A certificate is written where all instruments hold, and refused where one does not."""
    command = ["certificate", str(folder), "--json"]
    assert "expected --instruments" in str(run.invoke(app, command).exception)
    dates = "calibrated_on = 2020-01-01\ndue_on = {}\n"
    kept = 'schema_version = 1\n[[instruments]]\nname = "force sensor"\ncertificate = "D-1"\n'
    kept += f'serial = "virtual finger {NO_INSTRUMENT}"\n' + dates
    (folder / "instruments.toml").write_text(kept.format("2020-12-31"))
    late = str(run.invoke(app, command).exception)
    assert "D-1 expired on 2020-12-31 (strokes 1, 2," in late
    assert "the strokes are kept" in late
    (folder / "instruments.toml").write_text(kept.format("2999-12-31"))
    made = json.loads(run.invoke(app, command).stdout)[0]
    content = (folder / "certificate.pdf").read_bytes()
    assert content.startswith(b"%PDF") and f"Certificate {made['number']}".encode() in content
    assert len(re.findall(rb"/Type /Page\b", content)) >= 2
    (folder / "certificate.toml").write_text(
        'laboratory = "Tactile metrology"\ncustomer = "K"\nagreed_due_on = 2027-01-05\n'
        'template = "ours.txt"\n'
    )
    (folder / "ours.txt").write_text("# {{ about.laboratory }}\n{{ about.typo }}\n")
    assert "ours.txt: expected a Jinja template" in str(run.invoke(app, command).exception)
    (folder / "ours.txt").write_text("# {{ about.laboratory }}\nDue :: {{ about.agreed_due_on }}\n")
    assert run.invoke(app, command).exit_code == 0
    register = [str(folder.parent / "panels.json"), str(folder), "--json"]
    page = ["--page", str(folder.parent / "panels.html")]
    rows = json.loads(run.invoke(app, ["register", *register, *page]).stdout)
    assert [(row["panel"], row["state"], row["due"]) for row in rows] == [
        ("panel 7", "practice", "a practice, of no panel")  # by a virtual finger
    ]
    assert "panel 7" in (folder.parent / "panels.html").read_text()


def test_a_certificate_names_traceability_that_is_not_stated():
    template = Path(session_report.__file__).with_name("certificate_template.txt")
    _, _, rest = template.read_text("utf-8").partition("## Traceability")
    part = Template(rest.partition("## Signature")[0])
    about = session_report.CertificateText(traceability={"weight": "NIST", "place": "bench 2"})
    lines = part.render(about=about, missing="not stated", instruments=[], rig_checked="")
    stated = dict(line.split(" :: ") for line in lines.splitlines() if line)
    assert stated == {
        "weight": "NIST", "voltmeter": "not stated", "driver": "not stated", "place": "bench 2",
    }  # fmt: skip


def test_rows_of_a_certificate_stand_in_one_table_beneath_headings_that_do_not_touch():
    sheets = _Sheets("foot")
    sheets.write("| quantity = mu(0) | degrees of freedom = 19 | k = 2 |\n\n| quantity = h0 |"
                 " degrees of freedom = 7 | k = 3 |\n")  # fmt: skip
    (page,) = sheets._figures
    shown = [text.get_text() for text in page.texts]
    assert shown == ["quantity", "degrees of freedom", "k", "mu(0)", "19", "2", "h0", "7", "3"]
    renderer = FigureCanvasAgg(page).get_renderer()
    heads = [text.get_window_extent(renderer) for text in page.texts[:3]]
    assert all(left.x1 + 5 < right.x0 for left, right in pairwise(heads))  # of 600 pixels


@pytest.mark.slow
def test_a_finished_session_is_not_computed_again(fitted, tmp_path, monkeypatch):
    shutil.copytree(fitted, tmp_path / "s")
    known = {"youngs_modulus_pa": 4e7, "h_rms_m": 22e-6}
    area = {"apparent_area_at_1n_m2": (45.65e-6, 0.05)}
    quick = partial(fit_folder, fixed=known, priors=area, compare=False)
    monkeypatch.setattr(steps, "fit_folder", quick)
    command = ["run", str(tmp_path / "s"), "--name", "panel 7", "--source", "virtual", "--json"]
    first = run.invoke(app, command)
    calls = []
    monkeypatch.setattr(steps, "reduce_folder", lambda path: calls.append(path))
    again = run.invoke(app, command)
    assert (again.stdout, again.exit_code) == (first.stdout, first.exit_code)
    assert json.loads(again.stdout)["verdict"] == "provisional"
    shown = " ".join(run.invoke(app, command[:-1]).stdout.split())
    assert "finished before, and nothing is computed again" in shown
    assert not calls
    monkeypatch.setattr(steps, "reduce_folder", reduce_folder)
    right = VIRTUAL_RIG
    right.save(tmp_path / "s" / RIG)
    assert json.loads(run.invoke(app, command).stdout)["verdict"] == "passed"
    certify(tmp_path / "s")
    (tmp_path / "s" / "finished.json").write_text("{")
    assert json.loads(run.invoke(app, command).stdout)["verdict"] == "passed"


def test_another_panel_is_refused_on_resume(folder):
    plan = ["--plan", str(folder / "plan.toml"), "--source", "virtual", "--resume"]
    made = run.invoke(app, ["measure", str(folder / "s"), *plan, "--name", "panel 8"])
    assert "is a session of the screen 'panel 7', got 'panel 8'" in str(made.exception)
    made = run.invoke(app, ["measure", str(folder / "s"), *plan, "--finger", "wet"])
    assert "is a session of the finger 'semi-wet', got 'wet'" in str(made.exception)
    # Nothing is left to be measured: what is named, or nothing, may be resumed.
    for name in ([], ["--name", "panel 7"]):
        made = run.invoke(app, ["measure", str(folder / "s"), *plan, *name, "--json"])
        assert made.exit_code == 0, made.output


def edit_estimate(folder):
    fit = json.loads((folder / "fit.json").read_text())
    fit["log_values"][0] += 0.05
    (folder / "fit.json").write_text(json.dumps(fit))


def another_version(folder):
    fit = Fit.load(folder / "fit.json")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("calibration.fit.result.__version__", "0.0.9")
        fit.signed(fit.made_from).save(folder / "fit.json")


def copy_over(folder):
    shutil.copy(folder / "strokes" / "stroke-003.h5", folder / "strokes" / "stroke-007.h5")


def edit_table(folder):
    lines = (folder / "reduced.csv").read_text().splitlines()
    cells = lines[4].split(",")
    cells[5] = f"{1.05 * float(cells[5]):.17g}"  # mu
    (folder / "reduced.csv").write_text("\n".join([*lines[:4], ",".join(cells), *lines[5:]]))
    session = Session.open(folder)  # a fit of the edited table
    Fit.load(folder / "fit.json").signed(session.hashes(*RESTS_ON)).save(folder / "fit.json")


def edit_plan(folder):
    plan = (folder / "protocol.toml").read_text()
    (folder / "protocol.toml").write_text(plan.replace("idle_s = 0.3", "idle_s = 0.25"))


def check_rig(folder):
    VIRTUAL_RIG.save(folder / RIG)


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (edit_estimate, r"fit\.json was edited"),
        (another_version, r"made by haptix 0\.0\.9"),
        (copy_over, r"stroke-007\.h5: expected stroke 7: .* got stroke 3: "),
        (lambda s: (s / "strokes" / "stroke-002.h5").unlink(), r"stroke-002\.h5 was deleted"),
        (edit_table, r"reduced\.csv: stroke 4 is not what its recording gives"),
        (edit_plan, r"protocol\.toml was changed after the fit"),
        (check_rig, r"rig\.toml was added after the fit"),
        (lambda s: (s / "terms.json").write_text("[ ]"), r"terms\.json was changed after the fit"),
    ],
    ids=["estimate", "version", "copied", "deleted", "table", "plan", "rig", "terms"],
)
def test_a_fit_is_bound_to_its_session(tmp_path, fitted, spoil, said):
    copy = tmp_path / "s"
    shutil.copytree(fitted, copy)
    spoil(copy)
    with pytest.raises(haptix.HaptixError, match=said):
        verify_folder(copy)
    assert not (copy / "screen.toml").exists()


def test_a_preset_has_to_be_given_a_name_of_its_own(tmp_path, folder):
    screen = tmp_path / "screen.toml"
    haptix.Screen().save(screen)
    arguments = ["measure", str(tmp_path / "s"), "--plan", str(folder / "plan.toml")]
    made = run.invoke(app, [*arguments, "--source", "virtual", "--screen", str(screen)])
    assert "name of its own" in str(made.exception)
