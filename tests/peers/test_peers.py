"""The field's own tools, at pinned versions, read what haptix writes: `make test-peers`.

`scripts/setup-peers.sh` installs them. Those that cost little are met in other tests: pyxdf, the
validator of BIDS, schemathesis, the compilers of the clients' types.
"""

import json
import os
import subprocess
from pathlib import Path

import numpy as np
import pandas
import pytest

import haptix
from haptix.feel.materials import schema as material_schema
from haptix.lab.analysis.study import begin, export
from haptix.lab.experiment.psychometric import fit, function_named
from haptix.service.protocol.messages.reading import asyncapi, schema
from tests.clients.test_psychopy import stimulus_file
from tests.lab.test_bids import session
from tests.service.test_rest import made

ROOT = Path(__file__).parents[2]
PEERS = ROOT / "build" / "peers"
PYTHON = PEERS / "venv" / "bin" / "python"

pytestmark = pytest.mark.peers


def run(*command, folder, **environment):
    done = subprocess.run(
        [*map(str, command)], cwd=folder, capture_output=True, text=True, timeout=600, check=False,
        env={**os.environ, **environment},
    )  # fmt: skip
    assert done.returncode == 0, f"{command}: {done.stdout[-2000:]}{done.stderr[-2000:]}"
    return done.stdout


def python(code, folder, *arguments, display=False, **environment):
    (folder / "peer.py").write_text(code)
    display_server = ("xvfb-run", "-a") if display else ()
    return run(*display_server, PYTHON, "peer.py", *arguments, folder=folder, **environment)


def node(code, folder):
    (folder / "peer.mjs").write_text(code)
    (folder / "node_modules").symlink_to(PEERS / "node_modules")
    return run("node", "peer.mjs", folder=folder)


def test_asyncapi_parses_and_makes_models(tmp_path):
    (tmp_path / "a.json").write_text(json.dumps(asyncapi()))
    out = node(
        """
import fs from "fs";
import { Parser } from "@asyncapi/parser";
import { TypeScriptGenerator } from "@asyncapi/modelina";
const text = fs.readFileSync("a.json", "utf8");
const { document, diagnostics } = await new Parser().parse(text);
const errors = diagnostics.filter((one) => one.severity === 0).map((one) => one.message);
const models = await new TypeScriptGenerator().generate(JSON.parse(text));
console.log(JSON.stringify([errors, document.allMessages().length, models.length]));
""",
        tmp_path,
    )
    errors, messages, models = json.loads(out)
    assert errors == [] and messages == len(asyncapi()["components"]["messages"]) and models > 50


@pytest.mark.parametrize("language", ["cs", "go", "python", "ts"])
def test_quicktype_makes_types_of_the_session(tmp_path, language):
    (tmp_path / "session.json").write_text(json.dumps(schema()))
    (tmp_path / "node_modules").symlink_to(PEERS / "node_modules")
    command = ("node_modules/.bin/quicktype", "-s", "schema", "-l", language, "-o", "types")
    run(*command, "session.json#/$defs/", folder=tmp_path)
    assert len((tmp_path / "types").read_text().splitlines()) > 1000


def test_openapi_is_valid(tmp_path_factory, tmp_path):
    app = made(tmp_path_factory)[1]
    while not hasattr(app, "openapi"):
        app = vars(app)["_app"]
    (tmp_path / "openapi.json").write_text(json.dumps(app.openapi()))
    assert "OK" in run(PYTHON, "-m", "openapi_spec_validator", "openapi.json", folder=tmp_path)
    models(tmp_path, "openapi")


@pytest.mark.parametrize("document", ["session", "material"])
def test_models_are_made_of_the_schemas(tmp_path, document):
    table = schema() if document == "session" else material_schema()
    (tmp_path / f"{document}.json").write_text(json.dumps(table))
    models(tmp_path, document)


def models(folder, document):
    kind = "openapi" if document == "openapi" else "jsonschema"
    run(
        PYTHON, "-m", "datamodel_code_generator", "--input", f"{document}.json",
        "--input-file-type", kind, "--output", "made.py",
        "--output-model-type", "pydantic_v2.BaseModel", folder=folder,
    )  # fmt: skip
    counted = "import made; print(sum(name[0].isupper() for name in dir(made)))"
    assert int(python(counted, folder)) > 50


@pytest.fixture(scope="module")
def netcdf(tmp_path_factory):
    model = haptix.ContactModel(haptix.Finger(), haptix.Screen(), fidelity="closed-form")
    surface = haptix.FrictionSurface.build(model, {"normal_force_n": (0.1, 1.0)}, 0.02)
    path = tmp_path_factory.mktemp("netcdf") / "s.nc"
    surface.to_netcdf(path)
    return surface, path


def test_octave_reads_a_surface(netcdf):
    surface, path = netcdf
    code = (
        'pkg load netcdf; printf("%.17g\\n", ncread("s.nc", "mu"));'
        'disp(ncreadatt("s.nc", "/", "title")); disp(ncreadatt("s.nc", "mu", "units"));'
    )
    *numbers, title, unit = (
        run("octave-cli", "--eval", code, folder=path.parent).strip().splitlines()
    )
    # Octave counts the last axis first.
    mu = np.array(numbers, dtype=float).reshape(surface.mu_table.shape)
    np.testing.assert_array_equal(mu, surface.mu_table.numpy())
    assert (title, unit) == ("haptix friction surface", "1")


def test_ncdump_and_nco_read_a_surface(netcdf):
    surface, path = netcdf
    head = run("ncdump", "-h", "s.nc", folder=path.parent)
    assert 'mu:units = "1"' in head and 'mu:comment = "not for interp' in head
    assert "string" not in head  # of the kind that Octave cannot read
    run("ncwa", "-O", "-y", "max", "-v", "mu", "s.nc", "most.nc", folder=path.parent)
    most = run("ncks", "-H", "-C", "-s", "%.17g", "-v", "mu", "most.nc", folder=path.parent)
    assert float(most) == float(surface.mu_table.max())


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study")
    session(folder / "log.tsv")
    begin(folder / "study", "study")
    export(folder / "log.tsv", folder / "study", "01", "1", "detection")
    return folder


def test_hed_has_no_remark(study):
    code = """
from hed.tools import BidsDataset
print(len(BidsDataset("study").validate(check_for_warnings=True)))
"""
    assert int(python(code, study)) == 0


def test_pandas_reads_logs_and_onsets(study):
    log = pandas.read_csv(study / "log.tsv", sep="\t", skiprows=1, na_values="n/a")
    events = pandas.read_csv(next(study.rglob("*_events.tsv")), sep="\t", na_values="n/a")
    for name in ("level", "time_s", "onset_s", "reaction_s"):
        assert log[name].dtype == float
    # What SPM takes: onsets and durations by the kind of trial.
    assert [events[name].dtype.kind for name in ("onset", "duration")] == ["f", "f"]
    assert np.diff(events.onset) == pytest.approx(np.diff(log.onset_s), abs=2e-4)
    assert len(events.groupby("trial_type")) == log.kind.nunique()


def test_psignifit_finds_the_threshold(tmp_path):
    """Its Gumbel function of decibels is our Weibull function, by other priors: within 2 dB."""
    levels, trials = np.arange(10.0, 34.0, 4.0), 40
    share = function_named("weibull")(levels, 20.0, 2.5, 0.5, 0.02)
    right = np.random.default_rng(1).binomial(trials, share)
    answers = [(at, k < n) for at, n in zip(levels, right, strict=True) for k in range(trials)]
    ours = fit(answers, "weibull", 0.5)
    code = """
import json, math, sys, psignifit
fitted = psignifit.psignifit(json.loads(sys.argv[1]), sigmoid="gumbel", experiment_type="2AFC")
print(fitted.threshold(1 - math.exp(-1), unscaled=True)[0])
"""
    rows = [[float(at), int(n), trials] for at, n in zip(levels, right, strict=True)]
    theirs = float(python(code, tmp_path, json.dumps(rows)))
    assert ours.low < theirs < ours.high
    assert theirs == pytest.approx(ours.threshold, abs=2.0)


def test_psychopy_runs_the_example(tmp_path):
    (tmp_path / "stimuli").mkdir()
    for name in ("weak.wav", "strong.wav"):
        stimulus_file(tmp_path / "stimuli", name)
    example = ROOT / "clients" / "psychopy" / "example.py"
    code = f"""
import runpy
from psychopy import event
event.waitKeys = lambda **options: [("1", 0.5)]  # nobody sits here
runpy.run_path({str(example)!r})
"""
    *rows, keys = [
        line for line in python(code, tmp_path, display=True).splitlines() if "WARN" not in line
    ]
    onsets = [float(row.split()[1]) for row in rows[-2:]]
    assert [row.split()[2] for row in rows[-2:]] == ["driver", "driver"] and "1" in keys
    assert onsets[1] - onsets[0] > 0.2  # of a stimulus of 0.2 s


def test_psychopy_compiles_the_component(tmp_path):
    stimulus_file(tmp_path, "a.wav")
    code = """
from psychopy import plugins
plugins.activatePlugins()
from psychopy import experiment
from psychopy.experiment.components import getAllComponents
from psychopy.scripts.psyexpCompile import compileScript
made = experiment.Experiment()
routine = made.addRoutine("trial")
made.flow.addRoutine(routine, 0)
kind = getAllComponents(fetchIcons=False)["HapticStimulusComponent"]
routine.addComponent(kind(
    exp=made, parentName="trial", name="haptic", address="mock:pace=real", stimulus="a.wav",
    code=5, stopVal="",
))
made.settings.params["Show info dlg"].val = False
made.saveToXML("exp.psyexp")
compileScript("exp.psyexp", None, "exp_run.py")
"""
    python(code, tmp_path, display=True)
    text = (tmp_path / "exp_run.py").read_text(encoding="utf-8-sig")
    assert "haptic.play()" in text and "Unknown component" not in text
    compile(text, "exp_run.py", "exec")
