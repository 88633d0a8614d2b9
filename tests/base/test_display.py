"""Objects show themselves in a line, compare as a bool, and draw into given axes."""

import copy
import warnings

import numpy as np
import pytest
import torch

import haptix
from calibration import StrokeRecording
from calibration.plan.protocol import Stroke
from haptix.feel.materials import Grating, Texture
from haptix.model.contact import RoughnessSpectrum
from haptix.play.simulation import Setting, simulate

FORCES_N, VOLTAGES_V = [0.2, 0.5], [0.0, 60.0, 120.0]


@pytest.fixture(scope="module")
def model():
    return haptix.ContactModel(haptix.Finger.preset("semi-wet"), haptix.Screen.preset("3m-sct3250"))


@pytest.fixture(scope="module")
def surface(model):
    ranges = {"normal_force_n": (0.1, 1.0), "frequency_hz": 4000}
    return haptix.FrictionSurface.build(model, ranges, tolerance=0.01)


@pytest.fixture(scope="module")
def state(model):
    return model.solve(np.array(FORCES_N)[:, None], VOLTAGES_V, 4000.0)


@pytest.fixture(scope="module")
def path():
    t_s = np.linspace(0, 0.3, 31)
    return haptix.Trajectory(t_s, 5 + 50 * t_s, 0 * t_s + 20, 0 * t_s + 0.5)


@pytest.fixture(scope="module")
def simulation(model, surface, path):
    return simulate(Setting(model, Grating(period_mm=2.0), path), surface)


@pytest.fixture(scope="module")
def texture():
    return Texture(np.linspace(0, 1, 64 * 48).reshape(48, 64), width_mm=32.0)


@pytest.fixture(scope="module")
def recording():
    t_s = np.linspace(0, 1, 100)
    stroke = Stroke(number=1, normal_force_n=0.5, voltage_v=60.0, frequency_hz=125.0)
    return StrokeRecording(stroke, t_s, t_s + 1, t_s * 0.3, t_s * 50, 60 * np.sin(t_s))


@pytest.fixture(
    params=["model", "surface", "state", "path", "simulation", "texture", "recording", "period",
            "sample", "inversion", "column", "felt", "spectrum", "device", "finger"]
)  # fmt: skip
def shown(request, model, surface, simulation):
    make = {
        "period": lambda: model.over_period(0.5, 60.0, 125.0),
        "sample": lambda: surface.evaluate(FORCES_N, 60.0),
        "inversion": lambda: surface.voltage(0.3, FORCES_N),
        "column": lambda: surface.column(0.5, 4000.0),
        "felt": lambda: simulation.felt,
        "spectrum": lambda: RoughnessSpectrum.self_affine(1, 0.8, 1, 1, 1e3),
        "device": lambda: haptix.open_device("mock:"),
        "finger": lambda: haptix.Finger.preset("wet"),
    }.get(request.param)
    return make() if make else request.getfixturevalue(request.param)


def test_a_line_dumps_no_array_and_names_the_class(shown):
    line = repr(shown)
    assert line.startswith(type(shown).__name__ + "(")
    assert len(line) < 1000
    assert "\n" not in line
    assert "tensor(" not in line
    assert "array(" not in line
    assert " object at 0x" not in line


def test_equality_is_a_bool_and_equal_objects_have_one_hash(shown):
    assert (shown == shown) is True
    assert (shown == 3) is False
    assert hash(shown) == hash(shown)


@pytest.mark.parametrize("name", ["surface", "state", "path", "texture", "recording"])
def test_what_holds_arrays_is_compared_by_value(name, request):
    one = request.getfixturevalue(name)
    other = copy.deepcopy(one)
    assert (one == other) is True
    assert hash(one) == hash(other)
    arrays = [v for v in vars(other).values() if isinstance(v, torch.Tensor | np.ndarray)]
    changed = arrays[0] if arrays else other.table.columns
    changed.reshape(-1)[-1] += 1e-6  # of the copy
    assert (one == other) is False


def test_a_surface_from_its_file_equals_the_one_that_was_saved(surface, tmp_path):
    surface.save(tmp_path / "my.surface")
    assert haptix.FrictionSurface.load(tmp_path / "my.surface") == surface


def test_notebooks_get_a_table_without_markup_of_others(surface):
    assert surface._repr_html_().startswith("<table>")
    assert "mu" in surface._repr_html_()
    finger = haptix.Finger(name="<script>")
    assert "<script>" not in finger._repr_html_()


def test_plots_draw_into_the_axes_that_are_given(
    model, surface, state, path, simulation, texture, recording
):
    pytest.importorskip("matplotlib", reason="the extra figures")
    from matplotlib.figure import Figure

    period = model.over_period(0.5, 60.0, 125.0)
    along = {"voltage_v": VOLTAGES_V}
    drawn = [
        (surface.plot, {}), (state.plot, along), (period.plot, {}), (path.plot, {}),
        (simulation.plot, {}), (texture.plot, {}), (recording.plot, {}),
        (haptix.feel.gallery.load("gallery:honey").plot, {}), (Grating(period_mm=2.0).plot, {}),
        (haptix.Layout().plot, {}),
    ]  # fmt: skip
    for plot, options in drawn:
        axes = Figure().subplots()
        assert plot(ax=axes, **options) is axes
        assert axes.has_data()
        assert axes.get_xlabel()


def test_a_plot_of_the_surface_shows_its_friction(surface):
    pytest.importorskip("matplotlib", reason="the extra figures")
    from matplotlib.figure import Figure

    lines = surface.plot(ax=Figure().subplots()).get_lines()
    assert len(lines) == 5
    for line, force_n in zip(lines, np.geomspace(0.1, 1.0, 5), strict=True):
        x, y = line.get_data()
        assert y[60] == pytest.approx(surface.mu(force_n, x[60]).item(), rel=1e-6)  # float32 forces


def test_without_axes_there_is_a_new_figure(texture):
    pyplot = pytest.importorskip("matplotlib.pyplot", reason="the extra figures")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        axes = texture.plot()
    assert axes.figure.get_axes()
    pyplot.close(axes.figure)


def test_a_plot_of_states_says_what_it_needs(state):
    with pytest.raises(haptix.InputError, match=r"3 numbers.*voltage_v"):
        state.plot()
    with pytest.raises(haptix.InputError, match="quantity: expected a tensor"):
        state.plot(quantity="friction", voltage_v=VOLTAGES_V)


def test_a_point_beyond_the_surface_is_told_of_by_what_there_is(surface):
    with pytest.raises(haptix.HaptixError, match="take `evaluate` without `strict`"):
        surface.mu(0.5, 250.0)
    assert surface.evaluate(0.5, 250.0).status.item() == haptix.Status.OUT_OF_RANGE


def test_states_become_named_arrays_and_a_table(model):
    pytest.importorskip("xarray")
    forces, volts = [0.5, 1.0], [0.0, 50.0, 100.0]
    states = model.solve(torch.tensor(forces)[:, None], volts, 4000.0)
    arrays = states.to_xarray(normal_force_n=forces, voltage_v=volts)
    assert arrays["mu"].dims == ("normal_force_n", "voltage_v")
    table = arrays.to_dataframe().reset_index()
    row = table[(table.normal_force_n == 1.0) & (table.voltage_v == 50.0)]
    assert row.mu.item() == states.mu[1, 1].item()
    assert row.status.item() == states.status[1, 1].item()
    with pytest.raises(haptix.InputError, match=r"voltage_v of \(3,\)"):
        states.to_xarray(voltage_v=volts)


def test_what_has_a_row_for_each_instant_is_a_table(model, path, simulation, recording):
    pytest.importorskip("pandas")
    for one in (path, simulation.felt, recording, model.over_period(0.5, 60.0, 125.0)):
        table = one.to_pandas()
        assert len(table) == len(one.t_s)
        for name in ("t_s", *table.columns):
            np.testing.assert_array_equal(table[name], np.asarray(getattr(one, name)))
    assert list(path.to_pandas().columns) == ["t_s", "x_mm", "y_mm", "normal_force_n"]
    assert haptix.Trajectory(*path.to_pandas().to_numpy().T) == path
