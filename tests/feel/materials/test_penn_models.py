"""Models of the Penn format, from files made here: the toolkit's own may not be redistributed."""

import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal
from scipy.interpolate import LinearNDInterpolator

from haptix import HaptixError, InputError
from haptix.base.errors import FileFormatError
from haptix.feel.materials import PennModel
from haptix.feel.materials.patterns import NotFeltWarning
from haptix.feel.materials.penn import lsf_of_polynomial, polynomial_of_lsf

RATE_HZ = 10_000.0
# Four models at the corners of a region of speed [mm/s] and force [N], two triangles.
SPEEDS = [0.0, 200.0, 0.0, 200.0]
FORCES = [0.0, 0.0, 2.0, 2.0]
TRIANGLES = [(1, 2, 4), (1, 4, 3)]


def process(speed, force):
    """Polynomial of a resonance that rises with speed, and its variance, growing with both."""
    peak = 2 * np.pi * (150 + speed) / RATE_HZ
    poles = [0.97 * np.exp(1j * peak), 0.6 * np.exp(2.0j)]
    poly = np.poly([*poles, *np.conj(poles), 0.3]).real
    return poly, 1e-4 + 1e-3 * speed / 200 + 5e-4 * force / 2


def values(parent, name, numbers):
    array = ET.SubElement(parent, name, type="array")
    for number in numbers:
        ET.SubElement(array, "value").text = f"{number:.12f}"


def document(ma=(1.0,), with_lsf=True):
    """A file of the same schema as the toolkit's."""
    root = ET.Element("modelSet", texture="0")
    head = {
        "material": "Self-made", "AccelUnits": "m/s^2", "SpeedUnits": "mm/s", "ForceUnits": "N",
        "SampleRate": "10000", "mu": "0.35", "htmlPicture": "a.bmp", "renderPicture": "b.bmp",
        "numMod": "4", "numTri": "2", "maxSpeed": "200", "maxForce": "2",
    }  # fmt: skip
    for name, text in head.items():
        ET.SubElement(root, name).text = text
    values(root, "speedList", SPEEDS)
    values(root, "forceList", FORCES)
    for triangle in TRIANGLES:
        tri = ET.SubElement(root, "tri", type="array")
        for corner in triangle:
            ET.SubElement(tri, "value").text = str(corner)
    ET.SubElement(root, "numARCoeff").text = "5"
    ET.SubElement(root, "numMACoeff").text = str(len(ma) - 1)
    for i, (speed, force) in enumerate(zip(SPEEDS, FORCES, strict=True)):
        model = ET.SubElement(root, "model")
        ET.SubElement(model, "modNum").text = str(i + 1)
        poly, variance = process(speed, force)
        values(model, "ARcoeff", poly)
        values(model, "MAcoeff", ma)
        if with_lsf:
            values(model, "ARlsf", lsf_of_polynomial(poly))
            values(model, "MAlsf", lsf_of_polynomial(ma))
        ET.SubElement(model, "var").text = f"{variance:.9f}"
        ET.SubElement(model, "gain").text = "1.5"
        ET.SubElement(model, "speedMod").text = f"{speed:f}"
        ET.SubElement(model, "forceMod").text = f"{force:f}"
    return root


def save(path, root):
    ET.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)
    return path


@pytest.fixture
def model(tmp_path):
    return PennModel.load(save(tmp_path / "Models_Self-made.xml", document()))


poles_inside = st.lists(st.tuples(st.floats(0.1, 0.9), st.floats(0.1, 3.0)), min_size=1, max_size=5)


@settings(deadline=None)
@given(poles_inside, st.booleans())
def test_line_spectra_there_and_back(pairs, with_real):
    poles = [r * np.exp(1j * angle) for r, angle in pairs]
    poly = np.poly([*poles, *np.conj(poles), *([-0.5] if with_real else [])]).real
    lsf = lsf_of_polynomial(poly)
    assert len(lsf) == len(poly) - 1
    assert (np.diff(lsf) > 0).all()
    # Roots of degree 12 at most, apart by 0.05 and more: some thousand rounding errors.
    np.testing.assert_allclose(polynomial_of_lsf(lsf), poly, rtol=0, atol=1e-7)


def test_line_spectrum_by_hand():
    # A = 1 + a z^-1 + b z^-2: cosines of the two angles are (b - a - 1)/2 ... from the factors
    # z^2 + (a + b - 1) z + 1 and z^2 + (a - b + 1) z + 1.
    a, b = -1.2, 0.6
    expected = np.sort(np.arccos([-(a + b - 1) / 2, -(a - b + 1) / 2]))
    np.testing.assert_allclose(lsf_of_polynomial([1, a, b]), expected, atol=1e-12)


def test_unstable_processes_have_none():
    with pytest.raises(InputError, match="stable"):
        lsf_of_polynomial([1, 0, 1.1])


def test_at_a_model_it_is_the_model(model):
    for speed, force in ((200.0, 2.0), (1e4, 50.0), (200.0, 1e-9)):
        poly, variance = process(200, 2.0 if force > 1 else 0.0)
        found = model.at(speed, force)
        np.testing.assert_allclose(found.ar, poly, rtol=0, atol=1e-6)  # 12 decimals in the file
        assert found.variance == pytest.approx(variance, abs=1e-9)
        assert found.gain == 1  # there is no moving average for it to belong to


def test_between_models_it_is_linear(model):
    points = np.column_stack([SPEEDS, FORCES])
    lsf = np.array([lsf_of_polynomial(process(*point)[0]) for point in points])
    variance = np.array([process(*point)[1] for point in points])
    rng = np.random.default_rng(0)
    for speed, force in zip(rng.uniform(1, 199, 20), rng.uniform(0.01, 1.99, 20), strict=True):
        # Barycentric by hand, in the triangle that holds the place.
        upper = force / 2 > speed / 200
        corners = [i - 1 for i in TRIANGLES[1 if upper else 0]]
        system = np.vstack([points[corners].T, np.ones(3)])
        weights = np.linalg.solve(system, [speed, force, 1])
        found = model.at(speed, force)
        np.testing.assert_allclose(lsf_of_polynomial(found.ar), weights @ lsf[corners], atol=1e-7)
        assert found.variance == pytest.approx(weights @ variance[corners], abs=1e-9)


def test_without_triangles_they_are_found(tmp_path):
    root = document()
    for tri in root.findall("tri"):
        root.remove(tri)
    root.remove(root.find("numTri"))
    model = PennModel.load(save(tmp_path / "a.xml", root))
    variance = [process(*point)[1] for point in zip(SPEEDS, FORCES, strict=True)]
    # The variance is a plane over speed and force, whatever the triangles are.
    plane = LinearNDInterpolator(np.column_stack([SPEEDS, FORCES]), variance)
    assert model.at(120.0, 0.7).variance == pytest.approx(float(plane(120.0, 0.7)), abs=1e-9)


@pytest.mark.parametrize("with_lsf", [True, False])
def test_moving_averages(tmp_path, with_lsf):
    ma = np.poly([0.5, -0.4]).real
    model = PennModel.load(save(tmp_path / "a.xml", document(ma, with_lsf)))
    found = model.at(200, 2)
    np.testing.assert_allclose(found.ma, ma, atol=1e-9)
    assert found.gain == pytest.approx(1.5)
    f = np.array([50.0, 350.0, 2000.0])
    _, response = signal.freqz(1.5 * ma, process(200, 2)[0], worN=f, fs=RATE_HZ)
    expected = 2 * process(200, 2)[1] / RATE_HZ * np.abs(response) ** 2
    np.testing.assert_allclose(found.density(f), expected, rtol=1e-5)


def test_deviation_is_that_of_the_process(model):
    found = model.at(150, 1.0)
    impulse = signal.lfilter(found.gain * found.ma, found.ar, np.eye(1, 4000)[0])
    # Variance of a filtered white noise: the noise's, times the energy of the impulse response.
    assert found.deviation == pytest.approx(np.sqrt(found.variance * (impulse**2).sum()), rel=1e-3)


def test_a_finger_at_that_speed_feels_the_spectrum(model):
    speed, force, mass = 100.0, 0.5, 0.05
    field = model.texture(speed, force, mass, seed=3)
    assert field.target == "mu"
    # What a finger meets at the recording's rate, over the whole tile: 1.6 s.
    t = (np.arange(16384) + 0.5) / RATE_HZ
    mu = field.friction(speed * t, 7.0)
    assert mu.mean() == pytest.approx(0.35, abs=1e-9)
    process_ = model.at(speed, force)
    assert mu.std() == pytest.approx(mass * process_.deviation / force, rel=1e-6)
    f, density = signal.welch(mu, RATE_HZ, nperseg=1024)
    expected = (mass / force) ** 2 * process_.density(f)
    felt = (f > 40) & (f < 3000)
    # 31 overlapping segments scatter by a fifth; the mean of some three hundred by little, and the
    # window widens the resonance.
    ratio = density[felt] / expected[felt]
    assert ratio.mean() == pytest.approx(1, abs=0.1)
    assert ratio.std() < 0.45


def test_at_twice_the_speed_its_frequencies_double(model):
    # What a pattern on a screen does, and the toolkit's models would not.
    field = model.texture(100.0, 0.5, seed=3)
    t = (np.arange(8192) + 0.5) / RATE_HZ
    f, density = signal.welch(field.friction(200.0 * t, 0.0), RATE_HZ, nperseg=512)
    expected = (0.05 / 0.5) ** 2 * model.at(100.0, 0.5).density(f / 2) / 2
    felt = (f > 80) & (f < 4000)
    ratio = density[felt] / expected[felt]
    assert ratio.mean() == pytest.approx(1, abs=0.1)
    assert ratio.std() < 0.45


def change(name, text, inside=None):
    def apply(root):
        (root if inside is None else root.find(inside)).find(name).text = text

    return apply


def drop(name, inside=None):
    def apply(root):
        parent = root if inside is None else root.find(inside)
        parent.remove(parent.find(name))

    return apply


def unstable(root):
    model = root.find("model")
    model.remove(model.find("ARlsf"))
    model.find("ARcoeff").findall("value")[5].text = "1.5"


BAD = {
    "another root": (lambda root: setattr(root, "tag", "models"), "modelSet"),
    "no rate": (drop("SampleRate"), "SampleRate"),
    "rate of 0": (change("SampleRate", "0"), "SampleRate"),
    "words for numbers": (change("mu", "rough"), "mu"),
    "NaN": (change("var", "nan", "model"), "var"),
    "negative variance": (change("var", "-1", "model"), "var"),
    "other speeds": (drop("value", "speedList"), "speedList"),
    "too few models": (drop("model"), "numMod"),
    "no models": (lambda root: [root.remove(m) for m in root.findall("model")], "numMod"),
    "vertex that is not": (lambda root: setattr(root.find("tri")[0], "text", "9"), "tri"),
    "vertex 0": (lambda root: setattr(root.find("tri")[0], "text", "0"), "tri"),
    "two vertices": (drop("value", "tri"), "tri"),
    "triangle missing": (drop("tri"), "numTri"),
    "fewer coefficients": (drop("value", "model/ARlsf"), "ARlsf"),
    "order": (lambda root: setattr(root.find("model/ARlsf")[0], "text", "3.1"), "ARlsf"),
    "inches": (change("SpeedUnits", "in/s"), "SpeedUnits"),
    "unstable": (unstable, "stable"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_models(tmp_path, name):
    edit, complaint = BAD[name]
    root = document()
    edit(root)
    with pytest.raises(FileFormatError, match=complaint) as caught:
        PennModel.load(save(tmp_path / "bad.xml", root))
    assert "bad.xml" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"no xml",
        b"<modelSet>",
        b"\xff\xfe\x00",
        b'<!DOCTYPE a [<!ENTITY b "cc">]><modelSet>&b;</modelSet>',
        b'<?xml version="1.0" encoding="no-such"?><modelSet/>',
    ],
)
def test_files_that_are_none(tmp_path, content):
    (tmp_path / "bad.xml").write_bytes(content)
    with pytest.raises(FileFormatError, match=r"bad\.xml"):
        PennModel.load(tmp_path / "bad.xml")
    with pytest.raises(FileFormatError, match="cannot read"):
        PennModel.load(tmp_path / "none.xml")


@pytest.mark.parametrize("place", [(0, 1), (100, 0), (np.nan, 1), (100, -1), (np.inf, 1)])
def test_bad_places(model, place):
    with pytest.raises(HaptixError):
        model.texture(*place)
    with pytest.raises(InputError):
        model.texture(100, 1, mass_kg=0)


def test_friction_below_0_is_told_with_the_mass_that_asks_for_none(model):
    deviation = model.at(150, 1).deviation  # of 1 kg at 1 N
    too_heavy = model.contents.mu / deviation
    with pytest.warns(NotFeltWarning, match="below 0 in 16%") as told:
        model.texture(150, 1, mass_kg=too_heavy)  # the mean is one deviation above 0
    (most_kg,) = re.findall(r"up to ([\d.e-]+) kg", str(told[0].message))
    texture = model.texture(150, 1, mass_kg=float(most_kg))  # warns no more: a warning is an error
    x = np.linspace(0, 500, 200_000)
    assert (texture.friction(x, np.zeros_like(x)) < 0).mean() < 2e-3
