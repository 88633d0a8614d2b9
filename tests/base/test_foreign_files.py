"""Files that came from anywhere: each is refused in a sentence, within bounded time and memory."""

import io
import json
import shutil
import struct
import tracemalloc
import zipfile
import zlib
from pathlib import Path

import h5py
import numpy as np
import pytest
import soundfile
import torch
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image
from safetensors import safe_open
from safetensors.torch import save
from typer.testing import CliRunner

from calibration.fit.result import Fit
from calibration.measure.recording import StrokeRecording
from calibration.measure.reduction import Reduced
from calibration.measure.session import SessionInfo
from calibration.plan.protocol import Protocol
from haptix import HaptixError
from haptix.base.errors import FileFormatError
from haptix.base.files import digest, read_csv, read_json, read_toml
from haptix.feel.materials import PennModel, Texture
from haptix.feel.signals.audio_files import read_drive
from haptix.feel.signals.shapes import Recorded
from haptix.lab.experiment.recipe import ExperimentRecipe
from haptix.lab.experiment.trial_log import TrialLog
from haptix.lab.stimuli.drawing import draw_stimulus, read_for_drawing
from haptix.lab.stimuli.interchange import FrictionMap, read_ahap, read_hjif
from haptix.lab.stimuli.recipe import Recipe
from haptix.lab.stimuli.stimulus_set import check_manifest
from haptix.model.contact.boundary_elements.ensemble import run_ensemble
from haptix.model.finger import Finger
from haptix.model.perception.thresholds import Perception
from haptix.model.screen import Screen
from haptix.model.surface import FrictionSurface
from haptix.plan.scene import Scene
from haptix.tasks.cli.application import app
from tests.command_line import run_haptix

KEPT = Path(__file__).parents[1] / "data" / "kept-files"

DOCUMENTS = {
    "carrier.toml": Scene.load,
    "direct.toml": Scene.load,
    "gratings.toml": lambda path: Recipe.load(path).stimulus_set(),
    "threshold.toml": lambda path: ExperimentRecipe.load(path).make_method(),
    "session/finger.toml": Finger.load,
    "session/screen.toml": Screen.load,
    "session/protocol.toml": Protocol.load,
    "session/session.json": SessionInfo.load,
    "session/fit.json": lambda path: Fit.load(path).finger_prior(),
    "texture.json": lambda path: Texture.load(path.with_suffix(".png")),
    "stimuli/noise.json": lambda path: read_for_drawing(path.with_suffix(".flac")),
    "stimuli/manifest.json": lambda path: check_manifest(path.parent),
}


@pytest.fixture
def kept(tmp_path):
    folder = tmp_path / "kept"
    shutil.copytree(KEPT, folder)
    return folder


def toml_or_json(path, toml, document):
    path.write_text(toml if path.suffix == ".toml" else document)
    return path


# --- documents -----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", DOCUMENTS)
@pytest.mark.parametrize("depth", [100, 3000, 100_000])
def test_nesting_is_refused(kept, name, depth):
    nested = "[" * depth + "]" * depth
    path = toml_or_json(kept / name, f"a = {nested}\n", f'{{"a": {nested}}}')
    with pytest.raises(HaptixError, match=f"{path.name}.*64 deep"):
        DOCUMENTS[name](path)


@pytest.mark.parametrize(
    "text",
    [
        "a." * 1_000_000 + "a = 1",  # takes tomllib hours
        "[" + "a . " * 900_000 + "a]",
        '"a b".' * 500_000 + "a = 1",
        "a = {a = " * 3000 + "1" + "}" * 3000,
        "a = " + "9" * 5000,
        "a = 0x" + "f" * 3000,
        'a = "\\u0000"',
        "a = [" + "0," * 150_000 + "]",
    ],
    ids=["dotted", "header", "quoted", "inline", "digits", "hex", "nul", "values"],
)
def test_toml_that_is_too_much(tmp_path, text):
    path = tmp_path / "a.toml"
    path.write_text(text)
    with pytest.raises(FileFormatError, match=r"a\.toml: .*TOML"):
        read_toml(path)


@pytest.mark.parametrize(
    "text",
    ['{"a": 1' + "0" * 400 + "}", '{"a": "\\ud800"}', '{"a": "\\u0000"}', '{"a": NaN}', "[" * 10**6,
     '{"a": [' + "0," * 150_000 + "0]}"],
    ids=["integer", "half a character", "nul", "nan", "open", "values"],
)  # fmt: skip
def test_json_that_is_too_much(tmp_path, text):
    path = tmp_path / "a.json"
    path.write_text(text)
    with pytest.raises(FileFormatError, match=r"a\.json: .*JSON"):
        read_json(path)


def test_honest_documents_are_far_from_the_bounds(tmp_path):
    path = tmp_path / "a.json"
    path.write_text(json.dumps({"a": [[i, 2**63, "µ\U0001f600"] for i in range(20_000)]}))
    assert len(read_json(path)["a"]) == 20_000
    (tmp_path / "a.toml").write_text("a.b.c.d.e = [0.1, 0.2]\ns = 'see a.b.c'\n" * 1)
    assert read_toml(tmp_path / "a.toml")["a"]["b"]["c"]["d"]["e"] == [0.1, 0.2]


@pytest.mark.parametrize(
    "read",
    [
        read_json,
        read_toml,
        PennModel.load,
        lambda path: list(read_csv(path)),
        lambda path: TrialLog(path, {}),
    ],
)
def test_a_file_of_gigabytes_is_not_read(tmp_path, read):
    path = tmp_path / "huge"
    with path.open("wb") as file:
        file.truncate(20_000_000_000)  # a hole: it takes no room on the disk
    tracemalloc.start()
    try:
        with pytest.raises(FileFormatError, match=r"\d+ MB, got 2e\+04 MB") as caught:
            read(path)
        assert tracemalloc.get_traced_memory()[1] < 1_000_000
    finally:
        tracemalloc.stop()
    assert str(path) in str(caught.value)


def test_a_device_without_an_end_is_not_read_to_it():
    with pytest.raises(FileFormatError, match="4 MB"):
        read_json("/dev/zero")


@pytest.mark.parametrize("name", ["Finger", "Scene", "ExperimentRecipe"])
@pytest.mark.parametrize("key", ["self", "folder", "cls"])
def test_names_of_python_are_no_keys(kept, name, key):
    source = {"Finger": "session/finger.toml", "Scene": "direct.toml"}.get(name, "threshold.toml")
    path = kept / source
    path.write_text(f"{key} = 1\n{path.read_text()}")
    with pytest.raises(HaptixError, match=key):
        DOCUMENTS[source](path)


@pytest.mark.parametrize("value", ["[1]", "{}", "1e400", '"1e99999999999 N"', '"x"', "true"])
def test_a_force_that_is_none(kept, value):
    path = kept / "threshold.toml"
    text = path.read_text().replace("[stimulus]", f"[stimulus]\nnormal_force_n = {value}")
    path.write_text(text)
    with pytest.raises(HaptixError, match=r"normal_force_n|TOML"):
        ExperimentRecipe.load(path).presentation(48_000.0)


def test_grids_that_fill_the_memory(kept):
    path = kept / "threshold.toml"
    grid = list(range(1, 5000))
    text = path.read_text().replace("slope = [2, 3.5, 5]", f"slope = {grid}\nguess = {[0.5]}")
    path.write_text(text.replace("levels = [6,", f"levels = {grid} # [6,"))
    with pytest.raises(HaptixError, match="combinations"):
        ExperimentRecipe.load(path).make_method()


def test_a_factorial_that_fills_the_memory(kept):
    path = kept / "gratings.toml"
    many = ", ".join(f'"signal.x{i}" = [{"0, " * 50}]' for i in range(10))
    path.write_text(path.read_text().replace("factors = {", f"factors = {{ {many}, "))
    with pytest.raises(HaptixError, match="10000 combinations"):
        Recipe.load(path).stimulus_set()


# --- pictures ------------------------------------------------------------------------------------


def png(width, height, bits=16, kind=0, extra=()):
    """A PNG that states its size, with hardly any pixels."""

    def chunk(name, data):
        return (
            struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
        )

    head = struct.pack(">IIBBBBB", width, height, bits, kind, 0, 0, 0)
    chunks = [(b"IHDR", head), *extra, (b"IDAT", zlib.compress(b"\0" * 100)), (b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunk(*one) for one in chunks)


def load_map(folder, data):
    sidecar = {"black_is": 0, "white_is": 1, "width_mm": 50, "quantity": "mu"}
    (folder / "map.json").write_text(json.dumps(sidecar))
    (folder / "map.png").write_bytes(data)
    return FrictionMap.load(folder / "map.png")


@pytest.mark.parametrize("side", [7000, 13_000, 50_000])
def test_a_map_of_too_many_pixels(tmp_path, side):
    tracemalloc.start()
    try:
        with pytest.raises(HaptixError, match=r"map\.png.*scale it down"):
            load_map(tmp_path, png(side, side))
        assert tracemalloc.get_traced_memory()[1] < 10_000_000
    finally:
        tracemalloc.stop()


@pytest.fixture(scope="module")
def bomb():
    return zlib.compress(b"\0" * 200_000_000)


@pytest.mark.parametrize(
    ("name", "before"),
    [(b"zTXt", b"k\0\0"), (b"iTXt", b"k\0\1\0\0\0"), (b"iCCP", b"k\0\0")],
    ids=["zTXt", "iTXt", "iCCP"],
)
@pytest.mark.parametrize("read", ["map", "texture"])
def test_text_that_unpacks_to_gigabytes(tmp_path, kept, bomb, name, before, read):
    data = png(8, 8, extra=[(name, before + bomb)])
    tracemalloc.start()
    try:
        if read == "map":
            try:
                load_map(tmp_path, data)
            except HaptixError as error:
                assert "map.png" in str(error)
        else:
            (kept / "texture.png").write_bytes(data)
            with pytest.raises(HaptixError):  # of one grey, or no image
                Texture.load(kept / "texture.png")
        assert tracemalloc.get_traced_memory()[1] < 20_000_000
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("kind", ["png", "gif", "webp", "tiff"])
def test_of_an_animation_the_first_frame_is_taken_and_pages_are_refused(tmp_path, kind):
    frames = [
        Image.fromarray(np.random.default_rng(i).integers(0, 256, (50, 50), np.uint8))
        for i in range(200)
    ]
    path = tmp_path / f"many.{kind}"
    frames[0].save(path, save_all=True, append_images=frames[1:])
    if kind == "tiff":
        with pytest.raises(HaptixError, match="100 pages"):
            Texture.from_image(path, 50)
        frames[0].save(path, save_all=True, append_images=frames[1:2])
        with pytest.raises(HaptixError, match="several pages"):
            Texture.from_image(path, 50)
        return
    Texture.from_image(np.arange(12.0).reshape(3, 4), 50)  # what this imports does not count
    Image.fromarray(np.eye(8, dtype=np.uint8)).save(tmp_path / "one.png")
    Texture.from_image(tmp_path / "one.png", 50)
    tracemalloc.start()
    try:
        level = Texture.from_image(path, 50).level
        assert tracemalloc.get_traced_memory()[1] < 2_000_000  # of 200 frames it would be more
    finally:
        tracemalloc.stop()
    # WebP is lossy.
    first = Texture.from_image(np.asarray(frames[0]), 50).level
    np.testing.assert_allclose(level, first, rtol=0, atol=0.3 if kind == "webp" else 1e-12)


# --- XML -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "utf-16-le", "utf-16-be"])
def test_entities_are_refused_in_every_encoding(tmp_path, encoding):
    lol = "".join(f'<!ENTITY l{i} "{f"&l{i - 1};" * 10}">' for i in range(1, 10))
    name = encoding[:6] if encoding.startswith("utf-16") else encoding
    text = (
        f'<?xml version="1.0" encoding="{name}"?><!DOCTYPE m [<!ENTITY l0 "ha">{lol}]>'
        "<modelSet><material>&l9;</material></modelSet>"
    )
    mark = {"utf-16-le": b"\xff\xfe", "utf-16-be": b"\xfe\xff"}.get(encoding, b"")
    (tmp_path / "m.xml").write_bytes(mark + text.encode(encoding))
    with pytest.raises(FileFormatError, match="document type"):
        PennModel.load(tmp_path / "m.xml")


# --- sound ---------------------------------------------------------------------------------------


def read_recorded(path):
    return Recorded(str(path)).values(0, 10, 48_000.0)


def read_volts(path):
    return read_drive(path, 200.0)


@pytest.mark.parametrize("read", [read_recorded, read_volts])
def test_flac_that_claims_hours(tmp_path, read):
    path = tmp_path / "a.flac"
    soundfile.write(path, np.zeros(4800), 48_000, "PCM_24")
    data = bytearray(path.read_bytes())
    data[21] |= 0x0F  # the high bits of the number of samples: 2^36
    data[22:26] = b"\xff" * 4
    path.write_bytes(data)
    with pytest.raises(FileFormatError, match=r"50000000 .*got 687\d+"):
        read(path)


@pytest.mark.parametrize("rate_hz", [1, 2_147_483_629])
def test_a_rate_that_no_interface_has(tmp_path, rate_hz):
    path = tmp_path / "a.wav"
    soundfile.write(path, np.zeros(4800), 48_000, "PCM_16")
    data = bytearray(path.read_bytes())
    data[24:28] = struct.pack("<I", rate_hz)
    path.write_bytes(data)
    with pytest.raises(HaptixError, match=r"per second|resampled"):
        read_recorded(path)


@pytest.mark.parametrize("kind", ["OGG", "AIFF", "MP3"])
def test_other_formats_are_not_decoded(tmp_path, kind):
    path = tmp_path / "a.wav"
    soundfile.write(path, np.zeros(4800), 48_000, format=kind)
    for read in (read_recorded, read_volts):
        with pytest.raises(FileFormatError, match="WAV or FLAC"):
            read(path)


# --- HDF5, NumPy, surfaces -----------------------------------------------------------------------


def signal_of(file, **stated):
    del file["signals/t_s"]
    file["signals"].create_dataset("t_s", **stated)


DAMAGES = {
    "2^40 samples": lambda file: signal_of(
        file, shape=(2**40,), dtype="f8", chunks=(1024,), compression="gzip"
    ),
    "chunk of 2 GB": lambda file: signal_of(
        file, shape=(100,), maxshape=(None,), dtype="f8", chunks=(2**28,), compression="gzip"
    ),
    "text": lambda file: signal_of(file, data=["a"], dtype=h5py.string_dtype()),
    "empty": lambda file: signal_of(file, data=h5py.Empty("f8")),
    "nested": lambda file: file.attrs.update(findings="[" * 5000),
    "no text": lambda file: file.attrs.update(stroke=5.0),
    "rows": lambda file: file.attrs.update(format=np.zeros(3)),
    "void": lambda file: file.attrs.update(schema_version=h5py.Empty("i8")),
    "no list": lambda file: file.attrs.update(findings="null"),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_recording(kept, damage):
    path = kept / "session/strokes/stroke-016.h5"
    with h5py.File(path, "r+") as file:
        DAMAGES[damage](file)
    with pytest.raises(FileFormatError, match=r"stroke-016\.h5"):
        StrokeRecording.load(path)


def test_a_link_to_another_file_is_no_signal(kept):
    path = kept / "session/strokes/stroke-016.h5"
    with h5py.File(path, "r+") as file:
        del file["signals/t_s"]
        file["signals/t_s"] = h5py.SoftLink("/signals/t_s")
    with pytest.raises(FileFormatError, match=r"stroke-016\.h5"):
        StrokeRecording.load(path)


def linked(path, how):
    """Let a signal stand elsewhere: in another recording, in any file, or put together."""
    other = path.with_name("other.h5")
    shutil.copy(path, other)
    with h5py.File(path, "r+") as file:
        samples = file["signals/t_s"].shape
        del file["signals/t_s"]
        if how == "external link":
            file["signals/t_s"] = h5py.ExternalLink(other, "/signals/t_s")
        elif how == "external group":
            del file["signals"]
            file["signals"] = h5py.ExternalLink(other, "/signals")
        elif how == "external bytes":
            file["signals"].create_dataset(
                "t_s", shape=(100,), dtype="f8", external=[(__file__, 0, 800)]
            )
        else:
            layout = h5py.VirtualLayout(samples, "f8")
            layout[:] = h5py.VirtualSource(other, "/signals/t_s", samples)
            file["signals"].create_virtual_dataset("t_s", layout)


@pytest.mark.parametrize("how", ["external link", "external group", "external bytes", "virtual"])
def test_a_recording_reads_no_other_file(kept, how):
    path = kept / "session/strokes/stroke-016.h5"
    linked(path, how)
    with pytest.raises(FileFormatError, match=r"stroke-016\.h5"):
        StrokeRecording.load(path)


LIES = {
    "an endless chunk": lambda data: data[:40] + b"\xff" * 4 + data[44:],
    "no samples": lambda data: data[:44],
    "half a header": lambda data: data[:30],
    "no channels": lambda data: data[:22] + b"\0\0" + data[24:],
    "65535 channels": lambda data: data[:22] + b"\xff\xff" + data[24:],
    "no bits": lambda data: data[:34] + b"\0\0" + data[36:],
    "a format of nobody": lambda data: data[:20] + b"\x34\x12" + data[22:],
}


@pytest.mark.parametrize("lie", LIES)
@pytest.mark.parametrize("read", [read_recorded, read_volts])
def test_a_wav_that_lies_is_refused_or_as_short_as_it_is(tmp_path, lie, read):
    path = tmp_path / "a.wav"
    soundfile.write(path, np.zeros(4800), 48_000, "PCM_16")
    path.write_bytes(LIES[lie](path.read_bytes()))
    tracemalloc.start()
    try:
        read(path)
    except HaptixError as error:
        assert "a.wav" in str(error) or "file" in str(error)
    finally:
        _, peak_bytes = tracemalloc.get_traced_memory()
        tracemalloc.stop()
    assert peak_bytes < 50e6  # 4,800 samples take 0.04 MB; libraries that load take the rest


def npy(header):
    text = header.encode() + b"\n"
    return b"\x93NUMPY\x01\0" + struct.pack("<H", len(text)) + text


@pytest.mark.parametrize(
    "entry",
    [
        npy("{'descr': '<f8', 'fortran_order': False, 'shape': (10000000000000,)}"),
        npy("{'descr': '|O', 'fortran_order': False, 'shape': (1,)}"),
        npy("-" * 9000),
        npy("(" * 9000),
        b"no array",
    ],
    ids=["shape", "objects", "signs", "brackets", "foreign"],
)
def test_a_checkpoint_with_a_hostile_header(tmp_path, entry):
    path = tmp_path / "c.npz"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("fingerprint.npy", entry)
    with pytest.raises(FileFormatError, match=r"c\.npz.*checkpoint"):
        run_ensemble(1, lambda job: {"a": torch.zeros(1)}, "f", checkpoint=path)


def test_a_checkpoint_that_unpacks_to_gigabytes(tmp_path):
    path = tmp_path / "c.npz"
    zeros = io.BytesIO()
    with (
        zipfile.ZipFile(zeros, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
        archive.open("fingerprint.npy", "w", force_zip64=True) as file,
    ):
        for _ in range(110):
            file.write(bytes(10_000_000))
    path.write_bytes(zeros.getvalue())
    with pytest.raises(FileFormatError, match="bytes of numbers"):
        run_ensemble(1, lambda job: {"a": torch.zeros(1)}, "f", checkpoint=path)


def forged(path, change):
    """Change a surface and make all its checksums right again."""
    with safe_open(path, framework="pt") as file:
        header = json.loads(file.metadata()["haptix"])
        tensors = {name: file.get_tensor(name).clone() for name in file.keys()}  # noqa: SIM118
    header.pop("sha256")
    change(header, tensors)
    header["crc32"] = {
        name: zlib.crc32(one.reshape(-1).view(torch.uint8).numpy().data)
        for name, one in tensors.items()
    }
    header["sha256"] = digest(header)
    path.write_bytes(save(tensors, metadata={"haptix": json.dumps(header, sort_keys=True)}))


FORGERIES = {
    "nan": lambda header, tensors: tensors["columns"].fill_(torch.nan),
    "infinite friction": lambda header, tensors: tensors["columns"][..., 0].fill_(0.0),
    "friction below 0": lambda header, tensors: tensors["columns"][..., 0].neg_(),
    "no friction": lambda header, tensors: tensors["columns"][..., 0].fill_(-torch.inf),
    "no pull-in": lambda header, tensors: tensors["columns"][..., -2].fill_(-torch.inf),
    "one nan": lambda header, tensors: tensors["columns"][..., -1].fill_(torch.nan),
    "one place": lambda header, tensors: tensors["normal_force_n"].fill_(0.5),
    "zero": lambda header, tensors: tensors["normal_force_n"].mul_(0.0),
    "backwards": lambda header, tensors: tensors.update(drive=tensors["drive"].flip(0)),
    "no row": lambda header, tensors: tensors.update(drive=torch.tensor(1.0).double()),
    "none": lambda header, tensors: tensors.update(drive=torch.zeros(0).double()),
    "info": lambda header, tensors: header.update(info=5),
    "response": lambda header, tensors: header["info"].update(response_hz_per_mm_per_s=[]),
    "limit": lambda header, tensors: header.update(voltage_limit_v={}),
}


@pytest.mark.parametrize("forgery", FORGERIES)
def test_a_forged_surface(kept, forgery):
    forged(kept / "corrected.surface", FORGERIES[forgery])
    with pytest.raises(FileFormatError, match=r"corrected\.surface"):
        FrictionSurface.load(kept / "corrected.surface")


def test_a_surface_that_states_a_huge_size(tmp_path):
    path = tmp_path / "huge.surface"
    header = {"drive": {"dtype": "F64", "shape": [10**10], "data_offsets": [0, 8 * 10**10]}}
    text = json.dumps(header).encode()
    with path.open("wb") as file:
        file.write(struct.pack("<Q", len(text)) + text)
        file.truncate(8 + len(text) + 8 * 10**10)  # a hole
    with pytest.raises(FileFormatError, match="4 GB, got 80 GB"):
        FrictionSurface.load(path)


# --- interchange and tables ----------------------------------------------------------------------


@pytest.mark.parametrize(
    "text",
    ['{"Pattern": 5}', '{"Pattern": [{"Event": []}]}', '{"perceptions": [[]]}',
     '{"perceptions": [{"perception_modality": "Friction", "channels": []}]}',
     '{"perceptions": [{"perception_modality": "Friction", "unit_exponent": 400, "channels": '
     '[{"bands": [{"band_type": "Curve", "effects": []}]}]}]}'],
)  # fmt: skip
def test_patterns_of_another_form(tmp_path, text):
    path = tmp_path / "a.ahap"
    path.write_text(text)
    for read in (lambda: read_ahap(path, 0, 1), lambda: read_hjif(path, 50.0)):
        with pytest.raises(FileFormatError, match=r"a\.ahap"):
            read()


def test_a_log_and_a_table_with_nested_cells(kept):
    log = kept / "trials.tsv"
    _, rest = log.read_text().split("\n", 1)
    log.write_text("# " + "[" * 5000 + "\n" + rest)
    with pytest.raises(FileFormatError, match="log of trials"):
        TrialLog(log, {})
    table = kept / "session/reduced.csv"
    lines = table.read_text().splitlines()
    lines[1] = ",".join([*lines[1].split(",")[:12], "[" * 5000])
    table.write_text("\n".join(lines))
    with pytest.raises(FileFormatError, match=r"reduced\.csv"):
        Reduced.load(table)


# --- anything ------------------------------------------------------------------------------------

ODD = st.sampled_from(
    [None, True, -1, 0, 10**25, 1e308, -1e308, 5e-324, "", "x" * 300, "150 V", "1e999 V", "a\tb",
     [], {}, [[]], [{}], {"": ""}, {"kind": []}, {"kind": "sine"}, [None], [1, "a"], "../x.toml"]
)  # fmt: skip


@st.composite
def spoiled(draw, tree):
    """The same tree with one value that is something else."""
    tree = json.loads(json.dumps(tree))
    at = tree
    while True:
        keys = [*at] if isinstance(at, dict) else [*range(len(at))]
        key = draw(st.sampled_from(keys))
        if isinstance(at[key], dict | list) and at[key] and draw(st.booleans()):
            at = at[key]
            continue
        at[key] = draw(ODD)
        return tree


@pytest.mark.filterwarnings("ignore::haptix.model.screen.CalibrationWarning")
@pytest.mark.parametrize("name", DOCUMENTS)
@settings(
    max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data())
def test_one_odd_value_is_refused_or_taken(kept, name, data):
    source = KEPT / name
    tree = json.loads(source.read_text()) if source.suffix == ".json" else read_toml(source)
    # JSON is TOML's equal here: `Document.load` takes both, the suffix decides.
    path = (kept / name).with_suffix(".json")
    path.write_text(json.dumps(data.draw(spoiled(tree))))
    try:
        DOCUMENTS[name](path)
    except HaptixError as error:
        assert len(str(error)) < 20_000


def test_perception_is_a_document_too(tmp_path):
    (tmp_path / "a.toml").write_text("a = " + "[" * 2000)
    with pytest.raises(FileFormatError, match="64 deep"):
        Perception.load(tmp_path / "a.toml")


def test_the_command_line_ends_with_a_sentence(tmp_path):
    (tmp_path / "a.toml").write_text("a = " + "[" * 2000)
    done = run_haptix("plan", tmp_path / "a.toml")
    assert done.code == 2
    assert done.err.startswith("haptix: ") and "64 deep" in done.err


def test_a_set_without_its_keys(kept):
    manifest = kept / "stimuli/manifest.json"
    for text in ("{}", '{"files": []}', '{"files": {"noise.flac": []}}', '{"files": {}}'):
        manifest.write_text(text)
        result = CliRunner().invoke(app, ["stimuli", "show", str(kept / "stimuli")])
        assert isinstance(result.exception, FileFormatError), text


@pytest.mark.parametrize("place", ["predicted", "felt", "audibility", "drive_hz", "peak_v"])
def test_a_sidecar_that_cannot_be_drawn(kept, place):
    path = kept / "stimuli/noise.json"
    table = json.loads(path.read_text())
    table[place] = [table[place]]
    path.write_text(json.dumps(table))
    with pytest.raises(FileFormatError, match="sidecar"):
        draw_stimulus(path.with_suffix(".flac"))


def test_a_recipe_without_a_screen(kept):
    recipe = kept / "gratings.json"
    recipe.write_text(json.dumps({**read_toml(KEPT / "gratings.toml"), "screens": []}))
    with pytest.raises(HaptixError, match="screens"):
        Recipe.load(recipe)
