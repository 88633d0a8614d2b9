"""The pages' modules on their own, in the browser that runs them."""

import numpy as np
import pytest

from haptix.perception import WEBER_FRACTION
from tests.service.service_under_test import Service


@pytest.fixture(scope="module")
def module(tmp_path_factory, browser):
    """Return what the body of a function in JavaScript returns, given a module `m`."""
    service = Service(tmp_path_factory.mktemp("service"))
    page = browser.new_page()
    page.goto(f"http://127.0.0.1:{service.port}/stop")

    def run(path, body, argument=None):
        script = f"async (argument) => {{ const m = await import('/studio/{path}'); {body} }}"
        return page.evaluate(script, argument)

    yield run
    page.close()
    service.close()


def test_undo_and_redo_lead_back_whatever_was_changed(module):
    """Each undo of random changes gives the document before, each redo the one after."""
    found = module(
        "history.js",
        """
        let seed = argument;
        const random = (n) => (seed = (seed * 48271) % 2147483647) % n;
        const first = {name: "a", x_mm: 0, material: {kind: "k", list: [1, 2]}};
        const history = new m.History({regions: [first]});
        const seen = [JSON.stringify(history.current)];
        for (let step = 0; step < 300; step += 1) {
            const before = JSON.stringify(history.current);
            history.change("step", (draft) => {
                const region = draft.regions[random(draft.regions.length || 1)];
                const what = random(7);
                const all = draft.regions;
                if (!region || what === 0) all.push({name: String(step), material: {}});
                else if (what === 1) all.splice(all.indexOf(region), 1);
                else if (what === 2) region.x_mm = random(100);
                else if (what === 3) delete region.x_mm;
                else if (what === 4) region.material.list = [1, random(5), 2].slice(random(3));
                else if (what === 5) draft.regions.reverse();
                else region.material = {kind: "other", deep: {value: random(9)}};
            });
            const after = JSON.stringify(history.current);
            if (after !== before) seen.push(after);
        }
        const steps = Math.min(200, seen.length - 1);
        const same = (a, b) => JSON.stringify(m.difference(JSON.parse(a), b)) === "[]";
        let back = 0, forth = 0;
        while (history.undo()) back += same(seen[seen.length - 2 - back], history.current);
        const most = back;
        while (history.redo()) forth += same(seen[seen.length - most + forth], history.current);
        return [steps, back, forth];
        """,
        20261122,
    )
    assert found[0] > 150
    assert found[1] == found[2] == found[0]


def test_a_drag_is_one_step(module):
    assert module(
        "history.js",
        """
        const history = new m.History({x: 0});
        const move = (x, drag) => history.change("Move", (draft) => { draft.x = x; }, drag);
        for (let x = 1; x < 50; x += 1) move(x, "drag 1");
        move(70, "drag 2");
        const found = [history.current.x];
        history.undo(); found.push(history.current.x);
        history.undo(); found.push(history.current.x);
        history.redo(); found.push(history.current.x);
        return found;
        """,
    ) == [70, 49, 0, 49]


@pytest.mark.parametrize(
    ("after", "ops"),
    [
        (
            [{"name": "a", "x_mm": 5, "material": 1}, {"name": "b", "x_mm": 0, "material": 2}],
            ["move a"],
        ),
        (
            [{"name": "a", "x_mm": 0, "material": 3}, {"name": "b", "x_mm": 0, "material": 2}],
            ["change a"],
        ),
        ([{"name": "b", "x_mm": 0, "material": 2}], ["remove a"]),
        (
            [
                {"name": "a", "x_mm": 0, "material": 1},
                {"name": "b", "x_mm": 0, "material": 2},
                {"name": "c", "x_mm": 0, "material": 1},
            ],
            ["add c"],
        ),
        ([{"name": "b", "x_mm": 0, "material": 2}, {"name": "a", "x_mm": 0, "material": 1}], None),
        ([{"name": "a", "material": 1}, {"name": "b", "x_mm": 0, "material": 2}], None),
        ([{"name": "a", "x_mm": 0, "material": 1}, {"name": "b", "x_mm": 0, "material": 2}], []),
    ],
)
def test_changes_are_few_operations(module, after, ops):
    """None: the layout is set anew, where the order or what is no longer said cannot be changed."""
    before = [{"name": "a", "x_mm": 0, "material": 1}, {"name": "b", "x_mm": 0, "material": 2}]
    found = module(
        "sync.js", "return m.changes(...argument)", [{"regions": before}, {"regions": after}]
    )
    assert (found and [f"{op['op']} {op['name']}" for op in found]) == ops if ops else found == ops


def test_the_spectrum_is_that_of_numpy(module):
    random = np.random.default_rng(1)
    t = np.arange(512) / 1000
    signal = 0.3 + 0.02 * np.sin(2 * np.pi * 62.5 * t) + 0.01 * random.standard_normal(512)
    found = np.array(module("spectrum.js", "return [...m.amplitudes(argument)]", signal.tolist()))
    window = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(512) / 512)
    expected = np.abs(np.fft.rfft((signal - signal.mean()) * window))[:256] / 128
    np.testing.assert_allclose(found, expected, atol=1e-12)  # both in 64 bits
    assert found.argmax() == 32  # 62.5 Hz in steps of 1000 / 512 Hz


def test_the_jnd_is_the_one_of_the_package(module):
    assert module("telemetry.js", "return m.WEBER_FRACTION") == WEBER_FRACTION


def test_felt_rows_find_their_friction(module):
    """Rows come late, in parts, with a gap; each lies beside the friction of its own time."""
    names = ["x_mm", "y_mm", "normal_force_n", "wanted", "reached", "low", "high", "voltage_share"]
    found = module(
        "telemetry.js",
        """
        const telemetry = new m.Telemetry();
        const add = (stream, t0_s, names, rows) => telemetry.add({stream, touch_id: 0, t0_s,
            step_s: 0.001, columns: names.length, names, rows: Float32Array.from(rows.flat())});
        const friction = (t0_s, places) => add("friction", t0_s, argument,
            places.map((n) => [n, 0, 0.5, 0.3 + n / 1000, 0.3, 0.2, 0.4, 0.5]));
        const felt = (t0_s, values) =>
            add("felt", t0_s, ["mu", "force_n"], values.map((n) => [n, n / 2]));
        friction(10, [0, 1, 2, 3]);
        friction(10.004, [4, 5, NaN, 7]);
        felt(10, [100, 101, 102]);
        felt(10.003, [103, 104, 105, 106, 107]);
        felt(10.008, [108]);
        const track = telemetry.newest;
        const pair = (_, row) => [track.at("x_mm", row), track.at("felt", row)];
        return Array.from({length: track.count}, pair);
        """,
        names,
    )
    assert found == [[n, 100 + n] for n in (0, 1, 2, 3, 4, 5, 7)]
