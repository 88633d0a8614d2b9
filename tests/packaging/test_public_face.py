"""Names, imports and versions of the packages as a whole."""

import inspect
import subprocess
import sys
import tomllib
from functools import cached_property
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


def test_a_first_solve_does_not_load_the_compiler_of_torch():
    # Half a second and 60 MB of every process that solves a contact.
    code = """
import sys, haptix
model = haptix.ContactModel(haptix.Finger(), haptix.Screen())
haptix.FrictionSurface.build(model, {"normal_force_n": (0.4, 0.6), "frequency_hz": 1000.0})
print({"sympy", "torch._dynamo"} & set(sys.modules))
"""
    assert run_python(code) == "set()"


@pytest.mark.parametrize("package", [haptix, firmware_io, calibration])
def test_every_public_name_resolves(package):
    assert len(set(package.__all__)) == len(package.__all__)
    for name in package.__all__:
        assert getattr(package, name) is not None
        assert name in dir(package)


def test_the_errors_load_no_numpy_and_no_device():
    heavy = "[m for m in sys.modules if m.split('.')[0] in ('firmware_io', 'numpy', 'torch')]"
    code = f"import sys, haptix.base.errors; print({heavy})"
    assert run_python(code) == "['firmware_io', 'firmware_io.device_errors']"


def test_every_name_resolves_in_a_fresh_interpreter_and_a_misspelt_one_is_answered():
    misspelt = {
        "haptix.FrictionSurfce": "FrictionSurface",
        "haptix.Finger.preset('wet').youngs_modulus": "youngs_modulus_pa",
        "haptix.feel.materials.Grating(period_mm=2.0).period_m": "period_mm",
    }
    # In this process a name may be there because another test has imported its module.
    code = f"""
import sys, haptix, haptix.feel.materials
print([n for n in dir(haptix) if getattr(haptix, n, None) is None])
for expression in {[*misspelt]}:
    try:
        eval(expression)
    except AttributeError:
        sys.__excepthook__(*sys.exc_info())  # as the interpreter prints it
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"
    told = [line for line in done.stderr.splitlines() if line.startswith("AttributeError")]
    for line, meant in zip(told, misspelt.values(), strict=True):
        assert f"Did you mean: '{meant}'?" in line


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="Fingers"):
        haptix.Fingers  # type: ignore[attr-defined]  # noqa: B018


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
    "Texture.from_image": ["image", "width_mm", "target", "low", "high"],
    "open_device": ["address"],
    "Renderer": ["surface", "texture", "device"],
    "Renderer.touch": ["t_s", "x_mm", "y_mm", "normal_force_n"],
    "model.RoughnessSpectrum.self_affine": ["h_rms_m", "hurst", "q0", "q_rolloff", "q1"],
    "model.RoughnessSpectrum.from_table": ["q", "c"],
    "model.RoughnessSpectrum.from_topography": [],
    "model.MeanField": ["spectrum", "modulus", "gamma", "gap_distribution"],
    "model.MeanField.area_fraction": ["pressure_pa"],
    "model.MeanField.mean_gap": ["pressure_pa"],
    "model.MeanField.inverse_square_gap": ["pressure_pa", "h0_m", "contact_spots"],
    "model.MeanField.gap_density": ["pressure_pa", "gap_m"],
    "model.HalfSpace": ["youngs_modulus_pa", "poisson_ratio"],
    "model.Layered": [
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
        assert name in fields or isinstance(
            getattr(haptix.ContactState, name), property | cached_property
        )
    assert haptix.Status(0) is haptix.Status.OK
    assert issubclass(haptix.InputError, haptix.HaptixError)
    assert issubclass(haptix.InputError, ValueError)
    assert issubclass(haptix.LimitError, haptix.HaptixError)
    for name in haptix.base.errors.__all__:
        if name != "from_extra":  # each error is where people look
            assert getattr(haptix, name) is getattr(haptix.base.errors, name)


def test_the_command_and_the_data_files_ship():
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())
    module, _, function = settings["project"]["scripts"]["haptix"].partition(":")
    assert run_python(f"import {module} as m; print(callable(m.{function}))") == "True"
    for package in settings["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]:
        assert (ROOT / package / "py.typed").is_file()
    assert (ROOT / "haptix" / "play" / "simulation" / "finger_path.csv").is_file()
