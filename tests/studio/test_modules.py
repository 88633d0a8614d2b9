"""The pages' modules on their own, in the browser that runs them."""

import base64
import io
import zipfile
from functools import partial

import numpy as np
import pytest

from haptix.model.perception.thresholds import WEBER_FRACTION
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


def zipped(files, **settings):
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", **settings) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return packed.getvalue()


LAYOUT_IN = """
    const bytes = Uint8Array.from(atob(argument), (letter) => letter.charCodeAt(0));
    const sent = [];
    const send = async (file, suffix) => {
        sent.push([suffix, [...new Uint8Array(await file.arrayBuffer())]]);
    };
    try { return [await m.layoutIn(new Blob([bytes]), send), sent]; }
    catch (error) { return [error.message, sent]; }
"""


@pytest.mark.parametrize("method", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED])
def test_a_zip_whose_bytes_changed_is_refused(module, method):
    """By a flipped bit in each tenth place of its files."""
    content = bytes(range(256)) * 4
    files = {"layout.json": '{"regions": []}', "assets/a.png": content}
    whole = zipped(files, compression=method)
    read = partial(module, "archive.js", LAYOUT_IN)
    assert read(base64.b64encode(whole).decode()) == [{"regions": []}, [[".png", [*content]]]]
    begin = whole.index(b"assets/a.png") + len("assets/a.png")
    for at in range(begin, whole.index(b"PK\x01\x02"), 10):
        damaged = bytearray(whole)
        damaged[at] ^= 4
        told, sent = read(base64.b64encode(damaged).decode())
        assert "assets/a.png in the zip is damaged" in told and not sent, at


def test_a_zip_that_states_too_much_is_refused_before_it_is_unpacked(module):
    small = zipped({"layout.json": "{}"}, compression=zipfile.ZIP_DEFLATED)
    entry = bytearray(small)
    at = small.index(b"PK\x01\x02") + 24
    entry[at : at + 4] = (2**30).to_bytes(4, "little")
    told, sent = module("archive.js", LAYOUT_IN, base64.b64encode(entry).decode())
    assert "256 MB" in told and not sent


PICTURES = {
    "$defs": {
        "material": {
            "discriminator": {
                "mapping": {"photograph": "#/$defs/Photograph", "relief": "#/$defs/Relief"}
            }
        },
        **{
            name: {
                "title": name,
                "properties": {
                    field: {"title": field, "type": "string"},
                    "width_mm": {"title": "width", "type": "number"},
                    "duty": {"title": "duty", "type": "number", "default": 5},
                },
            }
            for name, field in (("Photograph", "file"), ("Relief", "heights"))
        },
    }
}


def test_a_region_s_parameters_have_nothing_of_the_region_before(module):
    """Its picture became the other one's relief, and its numbers stood where this one has none."""
    changed, shown, duty = module(
        "panel.js",
        """
        const changes = [];
        const panel = new m.Panel(argument, (path, to) => changes.push([path, to]));
        document.body.append(panel.element);
        const of = (file) => ({ kind: "photograph", file: `sha256:${file}`, width_mm: 60 });
        panel.show({ ...of("AAAAAAAA"), duty: 9 }, "first");
        panel.show(of("BBBBBBBB"), "second");
        const all = [...panel.element.querySelectorAll("select")];
        const select = all.find((one) => one.value === "photograph");
        select.value = "relief";
        select.dispatchEvent(new Event("change"));
        const valueOf = (name) => panel.element.querySelector(`#p-${name}`).value;
        return [changes, valueOf("file"), valueOf("duty")];
        """,
        PICTURES,
    )
    assert changed == [[[], {"kind": "relief", "heights": "sha256:BBBBBBBB", "width_mm": 60}]]
    assert shown.startswith("sha256:BBBBBB")
    assert float(duty) == 5


def test_a_picture_that_is_replaced_is_the_one_that_is_read(module):
    """By undo, or by another program: the region and its controls are the same."""
    changed = module(
        "panel.js",
        """
        const changes = [];
        const panel = new m.Panel(argument, (path, to) => changes.push(to.heights));
        for (const file of ["AAAAAAAA", "BBBBBBBB"]) {
            panel.show({ kind: "photograph", file: `sha256:${file}`, width_mm: 60 }, "same");
        }
        changes.push(panel.element.querySelector("#p-file").value);
        const all = [...panel.element.querySelectorAll("select")];
        const select = all.find((one) => one.value === "photograph");
        select.value = "relief";
        select.dispatchEvent(new Event("change"));
        return changes;
        """,
        PICTURES,
    )
    assert changed == ["sha256:BBBBBB…", "sha256:BBBBBBBB"]


def test_undo_and_redo_lead_back_whatever_was_changed(module):
    """Each undo of random changes gives the document before, each redo the one after."""
    found = module(
        "document.js",
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
        "document.js",
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
        (
            [
                {"name": "a", "x_mm": 0, "material": 1, "group": "g"},
                {"name": "b", "x_mm": 0, "material": 2},
            ],
            [],
        ),
    ],
)
def test_changes_are_few_operations(module, after, ops):
    """None: the layout is set anew, where the order or what is no longer said cannot be changed."""
    before = [{"name": "a", "x_mm": 0, "material": 1}, {"name": "b", "x_mm": 0, "material": 2}]
    found = module(
        "document.js", "return m.changes(...argument)", [{"regions": before}, {"regions": after}]
    )
    assert (found and [f"{op['op']} {op['name']}" for op in found]) == ops if ops else found == ops


def test_groups_are_aligned_and_spaced_as_one_and_their_own_regions_one_by_one(module):
    regions = [
        {"name": name, "x_mm": x, "y_mm": 0, "width_mm": 10, "height_mm": 10, "material": {}}
        | ({"group": "g"} if name in "ab" else {})
        for name, x in [("a", 0), ("b", 12), ("c", 30), ("d", 60)]
    ]

    def moves(call, regions):
        return module("arrange.js", f"return m.{call}", regions)

    assert moves("aligned(argument, 'x', 1)", regions) == [48, 48, 30, 0]
    assert moves("aligned(argument, 'x', 0)", regions[:2]) == [0, -12]
    # 22, 10 and 10 mm on 70 mm leave two gaps of 14 mm.
    assert moves("distributed(argument, 'x')", regions) == [0, 0, 6, 0]
    assert moves("distributed(argument, 'x')", regions[:3]) == [0, 0, 0]


def test_the_spectrum_is_that_of_numpy(module):
    random = np.random.default_rng(1)
    t = np.arange(512) / 1000
    signal = 0.3 + 0.02 * np.sin(2 * np.pi * 62.5 * t) + 0.01 * random.standard_normal(512)
    found = np.array(module("plots.js", "return [...m.amplitudes(argument)]", signal.tolist()))
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


def test_what_moves_is_drawn_as_it_is_now(module):
    """Each time has the picture of its moment; what looks the same for long is not asked again."""
    found = module(
        "pictures.js",
        """
        const asked = [];
        // A picture of one place, whose level is its time in steps of the film; or that stands.
        const rest = async (_, path, { material, t_s, frames, frame_s }) => {
            asked.push([path, material.kind, t_s, frame_s]);
            const moves = material.kind === "moves";
            const steps = Array.from({ length: frames }, (_, at) => (t_s + at * frame_s) * 24);
            const levels = steps.map((step) => (moves ? Math.round(step) % 256 : 7));
            const answer = { columns: 1, rows: 1, levels: btoa(String.fromCharCode(...levels)) };
            return { json: async () => answer };
        };
        let [state, paused, scene_s] = ["armed", false, 3.01];
        const [session, output] = [{ clientTime: (s) => s }, { get: () => ({ state, paused }) }];
        const service = { rest, session, output };
        performance.now = () => 1e3 * (scene_s + 70);  // told of at 2 s, when 72 s was now
        const telemetry = { stats_s: 72, stats: { scene_s: 2 } };
        const films = new m.Films(service, telemetry);
        const region = (kind) => ({ material: { kind }, width_mm: 1, height_mm: 1 });
        const settle = () => new Promise((resolve) => setTimeout(resolve, 1));
        const drawn = (kind) =>
            films.at(region(kind))?.getContext("2d").getImageData(0, 0, 1, 1).data.join();
        const found = [drawn("moves"), drawn("stands")];
        await settle();
        found.push(drawn("stands"), drawn("moves") === undefined);
        const seen = [];
        for (const at_s of [3.01, 3.03, 3.51, 4.02]) {
            scene_s = at_s;
            seen.push(drawn("moves"));
            await settle();
        }
        paused = true;  // it stands as it was told
        found.push(films.scene_s);
        state = "off";
        found.push(drawn("moves"));
        delete performance.now;
        return [found, seen, asked];
        """,
    )
    drawn, seen, asked = found
    assert drawn == [None, None, None, False, 2, None]  # not known yet, or nothing is rendered
    colours = module(
        "pictures.js",
        "return argument.map((at) => [...m.shade(at / 127.5 - 0.5).map(Math.round), 255].join())",
        [72, 72, 84, 96],
    )
    assert seen == colours
    moving = [(t_s, step_s) for _, kind, t_s, step_s in asked if kind == "moves"]
    # Looked at from afar, then second by second, the next one before it is needed.
    assert moving[1:] == [(3, 1 / 24), (4, 1 / 24)] and moving[0][1] > 0.4
    assert sum(kind == "stands" for _, kind, *_ in asked) == 1


@pytest.mark.parametrize(("code", "asked", "drawn"), [("device", 3, 1), ("document", 1, 0)])
def test_a_picture_is_asked_for_again_unless_it_is_refused_for_good(module, code, asked, drawn):
    found = module(
        "pictures.js",
        """
        const { Refused } = await import("/client/haptix.js");
        let [asked, drawn] = [0, 0];
        const rest = async () => {
            asked += 1;
            if (asked < 3) throw new Refused({ code: argument, sentence: "not now" });
            return { json: async () => ({ columns: 1, rows: 1, levels: btoa("H") }) };
        };
        m.picturesFrom({ rest });
        const region = { name: argument, material: { kind: argument }, width_mm: 1, height_mm: 1 };
        m.pictureOf(region, () => (drawn += 1));
        await new Promise((resolve) => setTimeout(resolve, 2500));
        return [asked, drawn];
        """,
        code,
    )
    assert found == [asked, drawn]


HEAR = """
    // The worklet's own code, in the page: its scope gives it three names.
    let Made;
    globalThis.AudioWorkletProcessor = class { port = {}; };
    globalThis.registerProcessor = (_, found) => (Made = found);
    globalThis.sampleRate = 48000;
    await import(`/studio/sound-worklet.js?${Math.random()}`);
    const { Telemetry } = await import("/studio/telemetry.js");
    const { mean_n, swing_n, hz, speed_mm_s, seconds, late } = argument;
    const processor = new Made();
    const telemetry = new Telemetry();
    telemetry.onFelt.add((track, _, from, to) =>
        processor.port.onmessage({ data: m.heardOf(track, from, to) }));
    const frame = (stream, at, names, row) => telemetry.add({ stream, touch_id: 0, t0_s: at / 1e3,
        step_s: 1e-3, columns: names.length, names,
        rows: Float32Array.from(Array.from({ length: 50 }, (_, k) => row(at + k)).flat()) });
    const heard = [];
    const force = (at) => mean_n + swing_n * Math.sin(2 * Math.PI * hz * at / 1e3);
    const waiting = [];
    for (let at = 0; at < 1e3 * seconds; at += 50) {  // as it comes: fifty rows, then their sound
        waiting.push(at);
        if (late.includes(at / 50)) waiting.due = at + 200;  // four frames come together
        for (const one of at >= (waiting.due ?? 0) ? waiting.splice(0) : []) {
            frame("friction", one, ["x_mm", "y_mm"], (row) => [speed_mm_s * row / 1e3, 0]);
            frame("felt", one, ["mu", "force_n"], (row) => [0.3, force(row)]);
        }
        for (let made = 0; made < 2400; made += 120) {
            const out = new Float32Array(120);
            processor.process([], [[out]]);
            heard.push(...out);
        }
    }
    return heard;
"""


def heard(module, **asked):
    return np.array(module("sound.js", HEAR, {"seconds": 1.0, "late": [], **asked}))


@pytest.mark.parametrize("hz", [80.0, 160.0])
def test_the_sound_is_the_felt_force_above_forty_hertz_late_by_what_is_said(module, hz):
    sound = heard(module, mean_n=0.3, swing_n=0.004, hz=hz, speed_mm_s=0.0)[24_000:]
    t_s = np.arange(24_000, 48_000) / 48_000
    turn = np.exp(-2j * np.pi * hz * t_s)
    found = 2 * np.mean(sound * turn) * 1j  # of a sine at t
    # Full scale is 0.25 N. A pass of first order above 40 Hz, and straight lines between rows.
    high_pass = 1j * hz / (1j * hz + 40)
    expected = 0.004 / 0.25 * high_pass * np.sinc(hz / 1000) ** 2
    expected *= np.exp(-2j * np.pi * hz * 0.06)
    # The digital filter is off its analog one by half a sample's turn, 1 % at 160 Hz.
    assert abs(found / expected - 1) < 0.02
    rest = sound - np.imag(found * np.conj(turn))
    assert np.std(rest) < 0.05 * np.std(sound)  # it is that and nothing else


def test_the_sound_of_a_busy_machine_breaks_off_once_and_not_again(module):
    """Frames that come 150 ms late, again and again: the first time tells how late they may be."""
    late = [20, 40, 60, 80, 100]
    sound = heard(module, mean_n=0.3, swing_n=0.05, hz=80.0, speed_mm_s=0.0, seconds=6.0, late=late)
    loud = np.abs(sound).reshape(-1, 960).max(axis=1) > 0.01  # each 20 ms; full scale is 0.25 N
    silent_s = np.flatnonzero(~loud) * 0.02
    assert np.all((silent_s < 0.1) | ((silent_s > 1.0) & (silent_s < 1.4)))
    assert len(silent_s) * 0.02 < 0.4


def test_the_sound_is_limited_and_its_noise_grows_with_the_finger(module):
    loud = heard(module, mean_n=1.0, swing_n=1.0, hz=100.0, speed_mm_s=200.0)
    assert 0.2 < np.abs(loud).max() <= 10 ** (-12 / 20)
    still, fast = (
        heard(module, mean_n=0.3, swing_n=0.004, hz=100.0, speed_mm_s=speed)[24_000:]
        for speed in (0.0, 100.0)
    )
    power = [np.abs(np.fft.rfft(one)) ** 2 for one in (still, fast)]
    hz = np.fft.rfftfreq(24_000, 1 / 48_000)
    band = (hz > 1500) & (hz < 6000)
    assert power[1][band].sum() > 100 * power[0][band].sum()
    even = heard(module, mean_n=0.5, swing_n=0.0, hz=100.0, speed_mm_s=100.0)[24_000:]
    assert np.abs(even).max() < 1e-4  # an even force makes no sound, however fast the finger


def test_a_picture_that_comes_is_drawn_on_the_page_that_is_shown_then(module):
    """It was asked for by the page before, whose board alone was drawn again."""
    drawn = module(
        "pictures.js",
        """
        const map = { columns: 1, rows: 1, levels: btoa("a") };
        m.picturesFrom({ rest: async () => ({ json: async () => map }) });
        const drawn = [];
        const region = { name: "one", material: { kind: "grating", period_mm: 7 } };
        const [before, now] = [() => drawn.push("before"), () => drawn.push("now")];
        const draft = m.pictureOf(region, before);
        m.pictureOf({ ...region, name: "its copy" }, now);
        m.pictureOf({ name: "one", material: { kind: "noise" } }, before);
        while (drawn.length < 3) await new Promise((resolve) => setTimeout(resolve, 20));
        return [...drawn, m.pictureOf(region, now) !== draft];
        """,
    )
    assert sorted(drawn[:3]) == ["before", "before", "now"] and drawn[3]
