"""Without the extras: what is left works, and what is not says which one brings it."""

import ast
import json
import re
import subprocess
import sys
import tomllib
from importlib import import_module
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

import haptix
from calibration.measure.sources import NationalInstrumentsReader
from haptix.base.errors import MissingExtraError, from_extra

ROOT = Path(haptix.__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
EXTRAS = PROJECT["optional-dependencies"]
OURS = ("haptix", "firmware_io", "calibration")
KEPT = ROOT / "tests" / "data" / "kept-files" / "direct.surface"
BLOCKED = (
    "matplotlib", "skimage", "PIL", "tifffile", "imageio", "h5py", "xarray", "h5netcdf", "serial",
    "nidaqmx", "pyvisa", "pylsl", "evdev", "fastapi", "uvicorn", "websockets", "SurfaceTopography",
    "distributed", "lvm_read", "nptdms",
)  # fmt: skip
# What a person would do that needs each extra.
NEEDS = {
    "photographs": "haptix.Texture.from_image('photo.png', 60)",
    "figures": "import_module('haptix.plan.tradeoff').write_tradeoff(None, None)",
    "calibration": "calibration.StrokeRecording",
    "stimuli": "import_module('haptix.lab.stimuli.drawing')",
    "serve": "import_module('haptix.service.client.connection')",
    "netcdf": "surface.to_netcdf('my.nc')",
    "serial": "haptix.open_device('serial:port=COM3')",
    "generator": "import_module('firmware_io').FunctionGenerator('TCPIP0::a::INSTR', None)",
    "cluster": "import_module('haptix.tasks.campaign.cluster').DaskWorkers.on('dask')",
    "lab": "import_module('haptix.play.render.lab_streams').LabOutlets(None)",
    "evdev": "import_module('haptix.play.touch').Touchscreen('/dev/input/event5')",
}
COMMANDS = {
    "figures": ("tradeoff", "--quick"),
    "serve": ("studio", "--no-open"),
    "netcdf": ("export", "my.surface", "my.nc"),
    "photographs": ("play", "--image", "photo.png", "--width-mm", "60"),
}
BARE = f"""
import contextlib, io, json, sys
from importlib import import_module

class Blocker:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {BLOCKED!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name.partition(".")[0])

sys.meta_path.insert(0, Blocker())
import calibration, haptix
from haptix.tasks.cli import main

open("photo.png", "wb").write(b"PNG")
surface = haptix.FrictionSurface.load({str(KEPT)!r})
surface.save("my.surface")

def said(code):
    try:
        eval(code)
    except haptix.base.errors.MissingExtraError as error:
        return str(error)

def run(arguments):
    err, sys.argv = io.StringIO(), ["haptix", *arguments]
    with contextlib.redirect_stderr(err), contextlib.redirect_stdout(io.StringIO()) as out:
        try:
            main()
        except SystemExit as end:
            return [end.code or 0, out.getvalue() + err.getvalue()]

open("path.csv", "w").write("t_s,x_mm,y_mm,normal_force_n\\n0,5,5,0.5\\n0.02,20,9,0.5\\n")
print(json.dumps({{
    "said": {{extra: said(code) for extra, code in {NEEDS!r}.items()}},
    "commands": {{extra: run(arguments) for extra, arguments in {COMMANDS!r}.items()}},
    "demo": run(["demo", "--trajectory", "path.csv", "--json"]),
}}))
"""


@pytest.fixture(scope="module")
def without_extras(tmp_path_factory):
    """What a program with nothing but the base said."""
    done = subprocess.run(
        [sys.executable, "-c", BARE],
        capture_output=True,
        text=True,
        cwd=tmp_path_factory.mktemp("bare"),
        check=False,
        timeout=300,  # a service that starts would wait for ever
    )
    assert not done.returncode, done.stderr
    return json.loads(done.stdout)


def test_every_extra_that_the_code_needs_is_named_where_it_is_missing(without_extras):
    for_developers = {"dev", "docs", "release", "all"}
    # Its objects come from the caller, who has it; daq: below.
    assert set(EXTRAS) - for_developers - {"topography", "daq"} == set(NEEDS)
    for extra, sentence in without_extras["said"].items():
        assert sentence is not None, f"{extra} was not needed"
        assert f"[{extra}]" in sentence


def test_a_command_says_so_in_one_sentence(without_extras):
    for extra, (code, text) in without_extras["commands"].items():
        assert code == 2, text
        assert text.count("\n") == 1
        assert f"pip install 'haptix-electrovibration[{extra}]'" in text


def test_the_demo_plays_without_photograph_and_picture_and_says_so(without_extras):
    code, text = without_extras["demo"]
    assert code == 0, text
    # A slow machine says after the document, on the standard error, how far it was.
    summary = json.JSONDecoder().raw_decode(text)[0][0]
    for key in ("photograph", "picture"):
        assert "haptix-electrovibration[figures]" in summary[key]
    assert summary["stream"]["underruns"] == summary["stream"]["faults"] == 0


def test_inputs_without_their_package_name_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "nidaqmx", None)
    with pytest.raises(MissingExtraError, match=r"nidaqmx.*\[daq\]"):
        NationalInstrumentsReader(["Dev1/ai0"], 1000.0, 10.0)


def test_what_is_missing_further_down_keeps_its_extra():
    with (
        pytest.raises(MissingExtraError, match=r"\[serial\]") as missing,
        from_extra("serve"),
        from_extra("serial"),
    ):
        import_module("no_such_package")
    assert missing.value.name == "no_such_package"


def test_all_has_every_extra_that_installs_everywhere():
    named = EXTRAS["all"][0].partition("[")[2].rstrip("]").split(",")
    alone = {"all", "dev", "docs", "release", "daq", "evdev"}
    assert set(named) | {"photographs"} == set(EXTRAS) - alone
    assert EXTRAS["dev"][0] == "haptix-electrovibration[all,docs,release]"


def imported(source):
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (alias.name.partition(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and not node.level:
            yield node.module.partition(".")[0]


def test_what_is_imported_is_declared():
    distributions = packages_distributions()
    extras = [line for name, of in EXTRAS.items() if name not in ("dev", "docs") for line in of]
    lines = [*PROJECT["dependencies"], *extras]
    # With its extras: dask[distributed].
    words = {word.lower() for line in lines for word in re.split(r"[\],\[]|[<>=;~!].*", line)}
    declared = {word.replace("_", "-") for word in words}
    sources = (path for name in OURS for path in (ROOT / name).rglob("*.py"))
    names = {name for path in sources for name in imported(path.read_text(encoding="utf-8"))}
    for name in names - set(OURS) - set(sys.stdlib_module_names):
        brings = {one.lower().replace("_", "-") for one in distributions.get(name, [name])}
        brings |= {"evdev"} if name == "evdev" else set()  # here by another distribution
        assert brings & declared, name
