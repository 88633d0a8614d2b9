"""Names, imports and versions of the packages as a whole."""

import ast
import inspect
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import calibration
import firmware_io
import haptix

ROOT = Path(haptix.__file__).parents[1]


def run_python(code):
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=True
    )
    return done.stdout.strip()


def test_importing_haptix_loads_nothing_heavy():
    heavy = "'torch', 'numpy', 'scipy', 'matplotlib', 'skimage', 'pydantic', 'sounddevice'"
    code = f"import sys, haptix; haptix.__version__; print({{{heavy}}} & set(sys.modules))"
    assert run_python(code) == "set()"


def test_importing_firmware_io_loads_neither_torch_nor_haptix():
    code = "import sys, firmware_io; print({'torch', 'haptix', 'calibration'} & set(sys.modules))"
    assert run_python(code) == "set()"


@pytest.mark.parametrize("package", [haptix, firmware_io, calibration])
def test_every_public_name_resolves(package):
    assert len(set(package.__all__)) == len(package.__all__)
    for name in package.__all__:
        assert getattr(package, name) is not None
        assert name in dir(package)


def test_the_errors_load_no_numpy_and_no_device():
    heavy = "[m for m in sys.modules if m.split('.')[0] in ('firmware_io', 'numpy', 'torch')]"
    code = f"import sys, haptix.errors; print({heavy})"
    assert run_python(code) == "['firmware_io', 'firmware_io.errors']"


def test_every_listed_name_resolves_in_a_fresh_interpreter():
    # In this process a name may be there because another test has imported its module.
    code = "import haptix; print([n for n in dir(haptix) if getattr(haptix, n, None) is None])"
    assert run_python(code) == "[]"


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="Fingers"):
        haptix.Fingers  # noqa: B018


# What other code relies on: the name, and the parameters by which it calls it.
FACE = {
    "Finger.preset": ["name"],
    "Screen.preset": ["name"],
    "Screen.load": ["path"],
    "Scene.load": ["path"],
    "ContactModel": ["finger", "screen", "fidelity", "dtype", "device"],
    "ContactModel.solve": ["normal_force_n", "voltage_v", "frequency_hz", "h0_m"],
    "FrictionSurface.build": ["model", "scene", "tolerance"],
    "FrictionSurface.mu": ["normal_force_n", "voltage_v", "frequency_hz", "h0_m"],
    "FrictionSurface.voltage": ["mu", "normal_force_n", "frequency_hz", "h0_m"],
    "FrictionSurface.save": ["path"],
    "FrictionSurface.load": ["path"],
    "Texture.from_image": ["image", "width_mm", "mu_range"],
    "open_device": ["address"],
    "Renderer": ["surface", "texture", "device"],
    "Renderer.touch": ["t_s", "x_mm", "y_mm", "normal_force_n"],
    "contact.RoughnessSpectrum.self_affine": ["h_rms_m", "hurst", "q0", "q_rolloff", "q1"],
    "contact.RoughnessSpectrum.from_table": ["q", "c"],
    "contact.RoughnessSpectrum.from_topography": [],
    "contact.MeanField": ["spectrum", "modulus", "gamma", "gap_distribution"],
    "contact.MeanField.area_fraction": ["pressure_pa"],
    "contact.MeanField.mean_gap": ["pressure_pa"],
    "contact.MeanField.inverse_square_gap": ["pressure_pa", "h0_m", "contact_spots"],
    "contact.MeanField.gap_density": ["pressure_pa", "gap_m"],
    "contact.HalfSpace": ["youngs_modulus_pa", "poisson_ratio"],
    "contact.Layered": [
        "layer_modulus_pa",
        "layer_poisson_ratio",
        "thickness_m",
        "bulk_modulus_pa",
        "bulk_poisson_ratio",
    ],
}


@pytest.mark.parametrize("name", FACE)
def test_the_public_face(name):
    found = haptix
    for part in name.split("."):
        found = getattr(found, part)
    parameters = [p for p in inspect.signature(found).parameters if p != "self"]
    # In this order, and nothing unknown in front of them.
    wanted = FACE[name]
    assert [p for p in parameters if p in wanted] == wanted
    assert parameters[: len(wanted) and 1] == wanted[:1]


def test_results_have_their_names():
    for name in ("mu", "area_fraction", "pressure_pa", "attraction_pa", "mean_gap_m", "status"):
        fields = haptix.ContactState.__dataclass_fields__
        assert name in fields or isinstance(getattr(haptix.ContactState, name), property)
    assert haptix.Status(0) is haptix.Status.OK
    assert issubclass(haptix.InputError, haptix.HaptixError)
    assert issubclass(haptix.InputError, ValueError)
    assert issubclass(haptix.LimitError, haptix.HaptixError)


def test_the_version_is_the_same_everywhere():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert project["version"] == haptix.__version__


def test_the_command_and_the_data_files_ship():
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())
    module, _, function = settings["project"]["scripts"]["haptix"].partition(":")
    assert run_python(f"import {module} as m; print(callable(m.{function}))") == "True"
    for package in settings["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]:
        assert (ROOT / package / "py.typed").is_file()
    assert (ROOT / "haptix" / "demo" / "finger_path.csv").is_file()


# From the lowest room to the highest. A room may import from itself and from those above it in
# this list; two rooms in one line do not know each other.
ROOMS = [
    {"firmware_io"},
    {
        "haptix.devices",
        "haptix.version",
        "haptix.allocator",
        "haptix.threads",
        "haptix.status",
        "haptix.errors",
    },
    {"haptix.perception", "haptix.units"},
    {"haptix.interpolation", "haptix.documents", "haptix.inputs", "haptix.states"},
    {"haptix.contact"},
    {"haptix.electro"},
    {"haptix.equilibrium", "haptix.finger", "haptix.screen"},
    {"haptix.fidelity", "haptix.terms"},
    {"haptix.friction"},
    {"haptix.scene", "haptix.virtual_finger"},
    {"haptix.surface"},
    {"haptix.planning"},
    {"haptix.tradeoff"},
    {"haptix.texture", "haptix.touch"},
    {"haptix.render"},
    {"haptix.rehearsal"},
    {"haptix.demo", "haptix.figures", "haptix.stimuli", "calibration"},
    {"haptix.cli"},
]
RANK = {room: rank for rank, rooms in enumerate(ROOMS) for room in rooms}
# The physics knows no device: only these rooms speak to firmware_io.
SPEAK_TO_DEVICES = {
    "haptix.devices",
    "haptix.errors",
    "haptix.render",
    "haptix.rehearsal",
    "haptix.demo",
    "haptix.stimuli",
    "haptix.cli",
    "calibration",
}
SOURCES = sorted(
    path
    for package in ("firmware_io", "haptix", "calibration")
    for path in (ROOT / package).rglob("*.py")
)


def room_of(module):
    parts = module.split(".")
    return ".".join(parts[:2]) if parts[0] == "haptix" else parts[0]


def module_of(path):
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imports_of(path):
    """Modules of ours that a file imports, anywhere in it."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            names = [node.module]
            if node.module == "haptix":
                names = [f"haptix.{alias.name}" for alias in node.names]
        else:
            continue
        yield from (n for n in names if n.split(".")[0] in ("firmware_io", "haptix", "calibration"))


@pytest.mark.parametrize("path", SOURCES, ids=module_of)
def test_imports_flow_one_way(path):
    module = module_of(path)
    if module == "haptix":  # the front door opens every room
        return
    room = room_of(module)
    assert room in RANK, f"{room} is a new room: say in ROOMS where it stands"
    for imported in imports_of(path):
        target = room_of(imported)
        assert target == room or RANK[target] < RANK[room], f"{module} imports {imported}"
        if target == "firmware_io" and room != "firmware_io":
            assert room in SPEAK_TO_DEVICES, f"{module} imports {imported}"


def test_the_check_of_imports_sees_imports():
    found = {
        (room_of(module_of(path)), room_of(name)) for path in SOURCES for name in imports_of(path)
    }
    assert ("haptix.render", "firmware_io") in found
    assert ("haptix.surface", "haptix.friction") in found
    assert ("haptix.cli", "haptix.demo") in found  # inside a function
