"""Files of the wrong kind, damaged tables, wrong words: each is refused in one sentence."""

import os
import shlex
import subprocess
import sys

import numpy as np
import pytest
import torch
from safetensors.torch import save_file
from skimage.io import imsave

from calibration.plan.protocol import paper_protocol
from tests.programs import ROOT

# What is typed, and facts that the sentence must have: what was wrong, so that it can be mended.
CASES = """
demoo | No such command 'demoo'. Did you mean 'demo'?
QUERY | No such command 'QUERY'
haptix query | No such command 'haptix'
query.exe | Did you mean 'query'?
material shwo m.toml | Did you mean 'show'?
stimuli mkae t.toml | Did you mean 'make'?
help me | No such command 'me'
cache clear | unexpected extra argument(s) (clear)
cache --clear=yes | does not take a value
--verison | --version
--log | requires an argument
--log loud query | 'loud'
--log debug | Missing command
-- | Missing command
query 0.5 100 | Missing option '--normal-force-n'
query --force 0.5 --voltage 100 | No such option: --force
query --normal_force_n 0.5 | --normal-force-n
query —normal-force-n 0.5 | Missing option '--normal-force-n'
query --normal-force-n 0.5 --voltage-v | requires an argument
query --normal-force-n --voltage-v 100 | --normal-force-n: expected numbers
query --normal-force-n 0.5 --normal-force-n 0.6 --voltage-v abc | 'abc'
query --normal-force-n 50g --voltage-v 100 | with the unit N, got '50g'
query --normal-force-n 0.5 --voltage-v 100Vpp | with the unit V, got '100Vpp'
query --normal-force-n 0.5 --voltage-v "100 V rms" | with the unit V
query --normal-force-n 0.5 --voltage-v 0..200 | '0..200'
query --normal-force-n 0.5 --voltage-v 0:10:200 | '0:10:200'
query --normal-force-n 0.5 --voltage-v +-100 | '+-100'
query --normal-force-n 0.5 --voltage-v 1 --frequency-hz 4khz | with the unit Hz
query --normal-force-n 0.5 --voltage-v 1 --frequency-hz 4e3,DC | '4e3,DC'
query --normal-force-n 0.5 --voltage-v 1 --h0-m 200nm, | '200nm,'
query --normal-force-n ٠٫٥ --voltage-v 1 | --normal-force-n
query --normal-force-n 0,5 --voltage-v 1 | the decimal sign is a point: 0.5
query --normal-force-n 1e-300 --voltage-v 1 | 1e-300
query --normal-force-n 0.5 --voltage-v 1 --finger "semi wet" | did you mean semi-wet?
query --normal-force-n 0.5 --voltage-v 1 --finger soft.toml | youngs_modulus_pa: expected a number
query --normal-force-n 0.5 --voltage-v 1 --finger list.toml | expected a number, got [1, 2]
query --normal-force-n 0.5 --voltage-v 1 --finger photo.png | unknown preset 'photo.png'
query --normal-force-n 0.5 --voltage-v 1 --theory Local | did you mean local?
query --normal-force-n 0.5 --voltage-v 1 --with plasticity | finger.hardness_pa
query --normal-force-n 0.5 --voltage-v 1 --surface zeros.surface | zeros.surface is not a friction
query --normal-force-n 0.5 --voltage-v 1 --surface huge.surface | huge.surface is not a friction
query --normal-force-n 0.5 --voltage-v 1 --surface loop | cannot read loop
build photo.png | photo.png exists
build a.surface b.surface | unexpected extra argument(s) (b.surface)
build a.surface --frequency-hz 4000,100 | LOW <= HIGH
build a.surface --tolerance "0.05 JDN" | got '0.05 JDN'
build a.surface --tolerance "5 %%" | got '5 %%'
build cut.toml | cut.toml: expected a TOML file
build empty.toml | empty.toml: expected the fields of a Scene
build json.toml | json.toml: expected a TOML file
build latin.toml | save it as UTF-8
plan m.toml | Scene.kind
plan table.csv | expected a TOML file
invert zeros.surface --mu 30% --normal-force-n 0.5 | '30%'
export m.toml out.nc | m.toml is not a friction surface
demo photo.png | unexpected extra argument(s) (photo.png)
demo --image half.png | half.png is not an image
demo --image drawing.png | an SVG drawing, which is not read
demo --image paper.pdf | a PDF, which is not read
demo --image empty.toml | not an image
demo --image grey.png | contrast
demo --image dangling | cannot read dangling
demo --image https://example.org/a.png | there is no such file
demo --image photo.png --width-mm 60px | '60px'
demo --image photo.png --polarity dark | did you mean dark-high?
demo --image photo.png --mu-range 0.9,0.1 | LOW <= HIGH
demo --trajectory semicolon.csv | found: t_s;x_mm
demo --trajectory tabs.csv | expected a first line naming
demo --trajectory utf16.csv | save it as UTF-8
demo --trajectory no-heading.csv | expected a first line naming
demo --trajectory heading.csv | at least 2 numbers
demo --trajectory nan.csv | x_mm: expected finite numbers, but number 6 is nan
demo --trajectory blank.csv | line 7: x_mm: expected a number, got ''
demo --trajectory short.csv | line 7: expected 4 values, got 2
demo --trajectory long.csv | expected 4 values, got 5
demo --trajectory twice.csv | missing or repeated: x_mm, y_mm
demo --trajectory units.csv | found: t_ms
demo --trajectory words.csv | t_s: expected a number, got 'eins'
demo --trajectory gap.csv | milliseconds
demo --trajectory negative.csv | 0 N (lifted) or more
demo --trajectory same.csv | increasing numbers
demo --trajectory photo.png | save it as UTF-8
render --direct-hz 125 --carrier-hz 4000 | --carrier-hz or --direct-hz
render --reaction-ms 1e9 | --reaction-ms
render --material kind.toml | material.kind
render --material negative.toml | period_mm
render --material cut.json | expected a JSON file
render --material gallery:nothing | expected one of comb
render --device com3 | an address begins with
play --device mock:ceiling_v=5000 | at most 200 V
play --device mock:sample_rate_hz=1 | sample_rate_hz must lie in
play --device tcp:localhost:99999 | a host and a port
play --device /dev/ttyUSB0 | an address begins with
material show gallery: | expected one of comb
material show gallery:../brick | expected one of comb
material show deep.json | more than 64 deep
material show list.json | expected a JSON object
material show photo.png | save it as UTF-8
material show m.toml --out m.pdf | a name that ends in .png
material fit m.csv --out photo.png | a name that ends in .toml or .json
material fit nan.csv | expected columns
campaign kindless.toml | whose kind is one of
campaign module.toml | 'os:system'
campaign module.toml --on cluster | expected one of processes, dask
stimuli make m.toml | Recipe.kind
stimuli show photo.png | name another file
stimuli simulate m.toml --runs 0 | --runs
stimuli run m.toml --log a.tsv --study s | either --log FILE or --study
stimuli analyse table.csv | is not a log of trials
stimuli analyse folder | has no log of trials
stimuli new folder/full | is not empty
calibrate plan photo.png | a name that ends in .toml or .json
calibrate run s --practice --minutes 1e6 | --minutes
calibrate run s --practice --max-voltage-v 500 | at most the 200 V
calibrate run s --name x --source csv | expected --csv FOLDER
calibrate reduce folder | is no session
calibrate rig s --weight-n 1kg | '1kg'
calibrate register table.csv | table.csv: expected a TOML file
calibrate gauge short.csv | line 7: expected 4 values
calibrate period table.csv | --columns
enroll photo.png | a name that ends in .toml or .json
serve --port 80x | '--port'
serve --port 70000 | 65535
serve --listen localhost | --listen: & --certificate & --key & TLS
studio 8080 | unexpected extra argument(s) (8080)
completion powershell | 'powershell'
doctor --proof-test /dev/null | an address begins with
build | Missing argument
query --normal-force-n -0.2 --voltage-v 100 | normal-force-n & -0.2
query --normal-force-n 0 --voltage-v 100 | normal-force-n & above 0
query --normal-force-n 1e300 --voltage-v 100 | normal-force-n
query --normal-force-n 500 --voltage-v 100 | --normal-force-n
query --normal-force-n 0.5 --voltage-v -1 | voltage-v & -1
query --normal-force-n 0.5 --voltage-v 0,201 | 201 V & limit of 200 V
query --normal-force-n 0.5 --voltage-v 121 --screen fragile.toml | 121 V & limit of 120 V & fragile
query --normal-force-n 0.5 --voltage-v 1 --frequency-hz 0 | frequency-hz
query --normal-force-n 0.5 --voltage-v 1 --frequency-hz 1e12 | --frequency-hz
query --normal-force-n 0.5 --voltage-v 1 --h0-m 0 | h0-m
query --normal-force-n 0.5 --voltage-v 1 --h0-m 0.2 | --h0-m & metres & 0.001
query --normal-force-n 0.5 --voltage-v 1 --with finite-size --without finite-size | finite-size
query --normal-force-n 0.5 --voltage-v 1 --finger nobody | 'nobody' & semi-wet & wet
query --normal-force-n 0.5 --voltage-v 1 --finger cut.toml | cut.toml & TOML
query --normal-force-n 0.5 --voltage-v 1 --finger unknown.toml | unknown.toml & colour
query --normal-force-n 0.5 --voltage-v 1 --screen ipad | 'ipad' & 3m-sct3250
query --normal-force-n 0.5 --voltage-v 1 --screen minus.toml | minus.toml & max_voltage_v & -3
query --normal-force-n 0.5 --voltage-v 1 --screen later.toml | later.toml & schema_version
query --normal-force-n 0.5 --voltage-v 1 --surface empty.toml | empty.toml
query --normal-force-n 0.5 --voltage-v 1 --surface foreign.surface | foreign.surface
query --normal-force-n 0.5 --voltage-v 1 --surface damaged.surface | damaged.surface & damaged
query --normal-force-n 0.5 --voltage-v 1 --surface short.surface | short.surface
query --normal-force-n 0.5 --voltage-v 1 --surface folder | surface
query --normal-force-n 0.5 --voltage-v 201 --surface good.surface | 201 V & limit of 200 V
query --normal-force-n 0.5 --voltage-v 1 --surface good.surface --frequency-hz 9 | without
query --fidelity boundary-element --normal-force-n 1 --voltage-v 2000 | above the limit
query --fidelity boundary-element --normal-force-n 1 --voltage-v 0 --with finite-size | finite-size
query --fidelity boundary-element --normal-force-n 1 --voltage-v SEVENTY | at most 64 states
invert good.surface --mu 0.3 --normal-force-n 0 | force
invert good.surface --mu 0.3 --normal-force-n 1 --frequency-hz 9 | frequency_hz & without
reach --normal-force-n 200 | --normal-force-n
reach --frequency-hz 4e9 | --frequency-hz
build a.surface --normal-force-n 0.1,0.5,1 | LOW,HIGH & 0.1,0.5,1
build a.surface --normal-force-n 50,500 | --normal-force-n
build a.surface --frequency-hz 4e9 | --frequency-hz
build a.surface --h0-m 0,1e-7 | --h0-m
build a.surface --h0-m 0.1,0.2 | --h0-m & metres
build a.surface --tolerance 0 | tolerance & above 0
build a.surface --tolerance -0.1 | tolerance
build a.surface --largest-mb 0 | largest-mb & above 0
build a.surface --out b.surface | --out
build a.surface --voltage-v 201 | 201 V & limit of 200 V
build a.surface --voltage-v 130 --screen fragile.toml | 130 V & limit of 120 V
build a.surface --voltage-v 0 | --voltage-v
build a.surface --voltage-v 0,4 | --voltage-v & 0.4
build a.surface --voltage-v high | --voltage-v & number & 150 V
build empty.toml --h0-m 1e-7 | --h0-m & scene
build . --overwrite --normal-force-n 0.5 | folder
plan magic.toml | 'magic'
plan square.toml | sine
demo --trajectory empty.toml | empty.toml
demo --trajectory metres.csv | metres & 1000
demo --trajectory milliseconds.csv | 8 s apart & milliseconds & 1000
demo --width-mm 0 | --width-mm
demo --carrier-hz 0 | 1000
demo --carrier-hz 20000 | quarter & 20000
render --carrier-hz 60 | --carrier-hz
render --carrier-hz 20000 | quarter & 20000
render --reaction-ms -1 | reaction-ms & -1
render --touch-hz 0 | touch-hz & 1
render --touch-latency-ms -1 | latency-ms & 0
render --image photo.png | photo.png & photo.json & --width-mm
render --image photo.png --width-mm 0 | --width-mm & 0.1
render --mu-range 0.2,0.3,0.4 | LOW,HIGH & 0.2,0.3,0.4
render --direct-hz 100 --waveform saw | 'saw'
render --surface empty.toml --trajectory path.csv | empty.toml
play --device mock:pace=real --surface empty.toml --trajectory path.csv | empty.toml
play --device mock:pace=real --carrier-hz 20000 | quarter & 20000
play --device mock:pace=real --reaction-ms 0.5 | reaction_s & 0.0005
play --device mock:pace=real --horizon-ms 2000 | horizon_s & 2
calibrate plan p.toml --max-voltage-v 300 | 200 V
calibrate measure s | --plan
calibrate measure s --plan nowhere.toml --name x | nowhere.toml
calibrate run s --name x --source inputs | --inputs FILE
calibrate run s --name x --inputs empty.toml | empty.toml
calibrate run s --name x --inputs number.toml | number.toml
calibrate run s --source virtual | --name
calibrate measure s --plan plan.toml --source virtual | --name
calibrate measure s --plan plan.toml --name x --source csv | --csv & --columns
calibrate measure s --plan plan.toml --name x --source inputs | --inputs FILE
calibrate reduce nowhere | nowhere
calibrate fit nowhere | nowhere
calibrate verify nowhere | nowhere
serve --certificate photo.png --key photo.png | for --listen
serve --listen localhost --certificate photo.png --key photo.png | PEM
""".strip().splitlines()


SQUARE = '[drive]\nscheme = "direct"\nfrequency_hz = "125 Hz"\nwaveform = "square"\n'


@pytest.fixture(scope="module")
def lying_around(tmp_path_factory, surface_file):
    """A folder with files of all kinds."""
    folder = tmp_path_factory.mktemp("lying")
    heading = "t_s,x_mm,y_mm,normal_force_n"
    rows = [f"{0.008 * i:.3f},{5 + 0.4 * i:.2f},20,0.5" for i in range(50)]
    in_metres = [f"{0.008 * i:.3f},{0.005 + 0.0001 * i:.4f},0.02,0.5" for i in range(50)]
    in_ms = [f"{8 * i},{5 + 0.4 * i:.2f},20,0.5" for i in range(50)]
    whole = "\n".join([heading, *rows])
    scene = (ROOT / "examples/scenes/carrier.toml").read_text()

    def with_row(six):
        return "\n".join([heading, *rows[:5], six, *rows[6:]])

    grating = 'kind = "grating"\nperiod_mm = 2.0\n'
    texts = {
        "semicolon.csv": whole.replace(",", ";").replace(".", ","),
        "tabs.csv": whole.replace(",", "\t"),
        "no-heading.csv": "\n".join(rows),
        "heading.csv": heading + "\n",
        "nan.csv": with_row("0.040,nan,20,0.5"),
        "blank.csv": with_row("0.040,,20,0.5"),
        "short.csv": with_row("0.040,7"),
        "long.csv": whole.replace(",0.5", ",0,5"),
        "twice.csv": whole.replace("y_mm", "x_mm"),
        "units.csv": whole.replace(heading, "t_ms,x_px,y_px,force_g"),
        "words.csv": "\n".join([heading, *["eins,zwei,drei,vier"] * 3]),
        "milliseconds.csv": "\n".join([heading, *in_ms]),
        "metres.csv": "\n".join([heading, *in_metres]),
        "gap.csv": "\n".join([heading, *rows, "9999,9,20,0.5"]),
        "negative.csv": whole.replace(",0.5", ",-0.5"),
        "same.csv": "\n".join([heading, *["0,5,20,0.5"] * 9]),
        "table.csv": "a,b\n1,2\n",
        "m.csv": "t_s,speed_mm_per_s,mu\n0,1,0.3\n",
        "cut.toml": '[drive]\nscheme = "dir',
        "empty.toml": "",
        "json.toml": '{"a": 1}',
        "soft.toml": 'name = "x"\nyoungs_modulus_pa = "soft"',
        "list.toml": "youngs_modulus_pa = [1, 2]",
        "number.toml": "kind = 3",
        "unknown.toml": 'name = "x"\ncolour = "red"',
        "minus.toml": "max_voltage_v = -3",
        "later.toml": "schema_version = 2",
        "fragile.toml": 'name = "fragile"\nmax_voltage_v = 120',
        "square.toml": scene[: scene.index("[drive]")] + SQUARE,
        "path.csv": whole,
        "magic.toml": scene.replace('"carrier"', '"magic"'),
        "m.toml": grating,
        "kind.toml": grating.replace("grating", "gratin"),
        "negative.toml": grating.replace("= 2", "= -2"),
        "kindless.toml": 'name = "x"',
        "module.toml": 'kind = "os:system"',
        "cut.json": '{"kind": "grating", ',
        "list.json": "[1, 2]",
        "deep.json": "[" * 5000 + "]" * 5000,
        "drawing.png": '<svg xmlns="http://www.w3.org/2000/svg"/>',
        "paper.pdf": "%PDF-1.4\n%%EOF",
        "folder/full/file": "x",
    }
    (folder / "folder" / "full").mkdir(parents=True)
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    (folder / "utf16.csv").write_text(whole, encoding="utf-16")
    (folder / "latin.toml").write_text("# Grüße", encoding="latin-1")
    (folder / "zeros.surface").write_bytes(bytes(1000))
    (folder / "huge.surface").write_bytes((2**62).to_bytes(8, "little") + b"{}")
    (folder / "loop").symlink_to("loop")
    (folder / "dangling").symlink_to("nowhere")
    paper_protocol().save(folder / "plan.toml")
    good = bytearray(surface_file.read_bytes())
    (folder / "good.surface").write_bytes(good)
    (folder / "short.surface").write_bytes(good[:-20])
    good[-3] ^= 0xFF  # within the numbers
    (folder / "damaged.surface").write_bytes(good)
    save_file({"mu": torch.ones(3)}, folder / "foreign.surface")
    columns = np.mgrid[0:32, 0:32][1]
    grey = (120 + 100 * np.sin(columns / 3)).astype(np.uint8)
    imsave(folder / "photo.png", grey, check_contrast=False)
    imsave(folder / "grey.png", np.full((32, 32), 128, np.uint8), check_contrast=False)
    (folder / "half.png").write_bytes((folder / "photo.png").read_bytes()[:60])
    return folder


def all_of(folder):
    return {path: path.lstat().st_size for path in folder.rglob("*")}


@pytest.mark.parametrize("case", CASES)
@pytest.mark.filterwarnings("ignore::haptix.model.contact.boundary_elements.ResolutionWarning")
def test_it_is_one_sentence_and_nothing_is_written(haptix_cli, lying_around, monkeypatch, case):
    monkeypatch.chdir(lying_around)
    before = all_of(lying_around)
    words, _, facts = case.partition(" | ")
    shown = haptix_cli(*shlex.split(words.replace("SEVENTY", ",".join(map(str, range(70))))))
    assert (shown.code, shown.out) == (2, ""), shown
    lines = [line for line in shown.err.splitlines() if line.strip()]
    (sentence,) = (line for line in lines if line.startswith(("haptix: ", "Error: ")))
    assert lines == [sentence] or (sentence.startswith("Error: ") and "--help" in shown.err)
    assert all(fact in sentence for fact in facts.split(" & ")), sentence
    assert all_of(lying_around) == before


@pytest.mark.parametrize(
    "words",
    [
        "build kept/a.surface",
        "demo --out kept/new",
        "calibrate plan kept/p.toml",
        "enroll kept/f.json",
    ],
)
def test_a_folder_that_takes_no_files_is_told_before_the_work(
    haptix_cli, own_folder, monkeypatch, words
):
    (own_folder / "kept").mkdir()
    monkeypatch.setattr(os, "access", lambda path, mode: not str(path).endswith("kept"))
    shown = haptix_cli(*words.split())
    assert (shown.code, shown.out) == (2, "")
    assert "permission denied" in shown.err
    assert len(shown.err.splitlines()) == 1


def test_a_file_that_the_system_refuses_is_one_sentence(haptix_cli, own_folder, monkeypatch):
    def refused(*_):
        raise PermissionError(13, "Permission denied", "/kept/panel.lock")

    monkeypatch.setattr("haptix.base.terminal.run", refused)
    shown = haptix_cli("query")
    assert (shown.code, shown.err) == (2, "haptix: /kept/panel.lock: Permission denied\n")


def test_streams_that_are_closed_are_no_traceback():
    code = "import sys; sys.stdin = sys.stdout = None; sys.argv = ['haptix', 'cache']; "
    code += "from haptix.tasks.cli import main; main()"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
