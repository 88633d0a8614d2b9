"""The surface reader in C, compiled and asked the same as Python."""

import json
import math
import shutil
import struct
import subprocess
from collections.abc import Callable
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import pytest
import torch
from safetensors.torch import save_file
from torch import Tensor

from haptix import ContactModel, Finger, FrictionSurface, InputError, Screen, Status
from haptix.model.surface import Interpolant
from haptix.model.surface.axes import AXIS_NAMES, Axes

SOURCE = Path(__file__).parents[2] / "examples" / "read_surface.c"
POINTS = 1000

# Of mu, relative, and of (V / the highest V)^2. C computes in double, Python as the file has it:
# logarithms of voltages near 4 round by 2.4e-7 in each of three blends, which is twice that in the
# drive and 4.3 times more, s / (1 - s), in mu close to the end of a surface: 1e-5 was seen.
CLOSE = {torch.float64: 1e-12, torch.float32: 2e-5}

Run = Callable[..., "subprocess.CompletedProcess[str]"]


@pytest.fixture(scope="session")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("no C compiler: cc is not on the PATH (apt-get install gcc libc6-dev)")
    program = tmp_path_factory.mktemp("c") / "read_surface"
    flags = ["-std=c99", "-O2", "-Wall", "-Wextra", "-Werror"]
    subprocess.run([compiler, *flags, SOURCE, "-o", program, "-lm"], check=True, timeout=600)

    def call(*arguments: Any, text: str = "") -> "subprocess.CompletedProcess[str]":
        return subprocess.run(
            [program, *arguments], input=text, capture_output=True, text=True, timeout=600
        )

    return call


def dense() -> FrictionSurface:
    """The closed form mu_0 / (1 - s) with some waves, on more nodes than a small build has."""
    force = torch.logspace(-1, 0, 6, dtype=torch.float64)
    frequency = torch.logspace(1.5, 3, 5, dtype=torch.float64)
    h0 = torch.logspace(-7.5, -6.5, 4, dtype=torch.float64)
    drive = 0.81 * torch.linspace(0, 1, 9, dtype=torch.float64) ** 1.3
    a, b, c = torch.meshgrid(force.log(), frequency.log(), h0.log(), indexing="ij")
    at_rest = 0.25 + 0.05 * torch.sin(2 * a + b) + 0.02 * torch.cos(c)
    pull_in = torch.log(200 + 90 * torch.sin(a - c) + 40 * torch.cos(b))
    columns = torch.cat(
        [(drive - 1) / at_rest[..., None], torch.stack([pull_in, pull_in - 0.2], -1)], -1
    )
    axes = Axes.of({"normal_force_n": force, "frequency_hz": frequency, "h0_m": h0})
    return FrictionSurface(Interpolant(axes, drive, columns, 1.0, 210.0), {"notes": 'a "\\" {[é'})


@pytest.fixture(scope="session")
def surfaces() -> dict[str, FrictionSurface]:
    finger = Finger.preset("semi-wet")
    four = FrictionSurface.build(
        ContactModel(finger, Screen(max_voltage_v=400.0)),
        {"normal_force_n": (0.25, 0.5), "frequency_hz": (60.0, 120.0), "h0_m": (1e-7, 2e-7)},
        tolerance=5e-2,
    )
    broken = FrictionSurface.build(
        ContactModel(finger, Screen.preset("3m-sct3250"), terms={"breakdown": True}),
        {"normal_force_n": (0.1, 0.5), "h0_m": (5e-8, 3e-7)},
        tolerance=1e-2,
    )
    closed = dense()
    return {
        "4-D": four,
        "4-D float32": four.to(torch.float32),
        "2-D": four.at(83.0, 1.1e-7),
        "3-D float32": closed.at(frequency_hz=100.0).to(torch.float32),
        "breakdown": broken,
        "breakdown float32": broken.to(torch.float32),
        "dense": closed,
        "friction": FrictionSurface(replace(closed.table, limited_by=Status.FRICTION), closed.info),
        "pressure": FrictionSurface(replace(closed.table, limited_by=Status.PRESSURE), closed.info),
    }


NAMES = ["4-D", "4-D float32", "2-D", "3-D float32", "breakdown", "breakdown float32", "dense"]
NAMES += ["friction", "pressure"]


def places(surface: FrictionSurface, seed: int, leave_out: bool) -> list[Tensor | None]:
    """Points in and around the axes, some on their nodes; None where an axis is left out."""
    generator = torch.Generator().manual_seed(seed)
    found: list[Tensor | None] = []
    for axis in surface.table.axes:
        if axis.is_absent or (leave_out and not axis.varies):
            found.append(None)
            continue
        share = 1.3 * torch.rand(POINTS, generator=generator, dtype=torch.float64) - 0.15
        low, high = math.log(axis.low), math.log(axis.high if axis.varies else 2 * axis.low)
        values = torch.exp(low + share * (high - low)).to(axis.nodes.dtype)
        on_node = torch.randint(len(axis.nodes), (POINTS,), generator=generator)
        every = 5 if axis.varies else 2
        values[::every] = axis.nodes[on_node[::every]]
        found.append(values)
    return found


def ask(run: Run, path: Path, kind: str, columns: list[Tensor | None]) -> tuple[Tensor, Tensor]:
    texts = [
        ["nan"] * POINTS if column is None else [repr(v) for v in column.tolist()]
        for column in columns
    ]
    text = "".join(f"{kind} {' '.join(row)}\n" for row in zip(*texts, strict=True))
    done = run(path, text=text)
    assert done.returncode == 0, done.stderr
    rows = [line.split() for line in done.stdout.splitlines()]
    values = torch.tensor([float(row[0]) for row in rows], dtype=torch.float64)
    return values, torch.tensor([int(row[1]) for row in rows])


def check_status(
    found: Tensor, status: Callable[..., Tensor], query: list[Tensor | None], close: float
) -> None:
    """Python's status, or one that it has within rounding of the point."""
    agrees = found == status(*query)
    assert float(agrees.double().mean()) > 0.98
    for column, sign in product(range(len(query)), (-1, 1)):
        at = query[column]
        if at is not None:
            moved = [*query[:column], at * (1 + sign * close), *query[column + 1 :]]
            agrees |= found == status(*moved)
    assert bool(agrees.all()), [q[~agrees][:3] for q in query if q is not None]


@pytest.mark.parametrize("leave_out", [True, False])
@pytest.mark.parametrize("name", NAMES)
def test_friction_and_voltage_are_those_of_python(
    name: str, leave_out: bool, surfaces: dict[str, FrictionSurface], run: Run, tmp_path: Path
) -> None:
    surface, path = surfaces[name], tmp_path / "a.surface"
    surface.save(path)
    dtype = surface.table.drive.dtype
    force, frequency, h0 = places(surface, len(name), leave_out)
    share = torch.rand(POINTS, generator=torch.Generator().manual_seed(1), dtype=torch.float64)

    volts = (1.2 * surface.voltage_limit_v * share).to(dtype)
    volts[:50], volts[50:100] = 0.0, surface.voltage_limit_v
    at = dict(zip(AXIS_NAMES, (force, frequency, h0), strict=True))
    end = surface.table.end(at)  # outside, that of the nearest place
    volts[100:300] = end[100:300]
    sample = surface.evaluate(force, volts, frequency, h0)
    mu, status = ask(run, path, "mu", [force, volts, frequency, h0])
    torch.testing.assert_close(mu, sample.mu.double(), rtol=CLOSE[dtype], atol=0)
    assert Status.OK in status and Status.OUT_OF_RANGE in status
    query = [force, volts, frequency, h0]
    check_status(status, lambda *q: surface.evaluate(*q).status, query, CLOSE[dtype])

    low, high = (surface.table.evaluate(torch.full_like(volts, v), at)[0] for v in (0.0, math.inf))
    wanted = low + (1.6 * share - 0.3).to(dtype) * (high - low)
    wanted[:50], wanted[50:100], wanted[100:110] = low[:50], high[50:100], 0.0
    found = surface.voltage(wanted, force, frequency, h0)
    voltage, status = ask(run, path, "voltage", [wanted, force, frequency, h0])
    end = end.double()
    off = (voltage / end) ** 2 - (found.voltage_v.double() / end) ** 2
    assert float(off.abs().max()) <= CLOSE[dtype]
    assert float(voltage.max()) <= surface.voltage_limit_v
    assert Status.OK in status and Status.BELOW in status
    query = [wanted, force, frequency, h0]
    check_status(status, lambda *q: surface.voltage(*q).status, query, CLOSE[dtype])


def test_every_status_occurs(
    surfaces: dict[str, FrictionSurface], run: Run, tmp_path: Path
) -> None:
    path = tmp_path / "a.surface"
    surfaces["dense"].save(path)
    text = "mu 0.5 0 100 1e-7\nmu 0.5 209 100 1e-7\nmu 0.5 500 100 1e-7\n"
    text += "voltage 0.01 0.5 100 1e-7\nvoltage 9 0.5 100 1e-7\nvoltage 9 0.5 100 2e-7\n"
    seen = [int(line.split()[1]) for line in run(path, text=text).stdout.splitlines()]
    surfaces["breakdown"].save(path)
    text = "mu 0.3 150 nan 1e-7\nvoltage 9 0.3 nan 1e-7\n"
    seen += [int(line.split()[1]) for line in run(path, text=text).stdout.splitlines()]
    for name in ("friction", "pressure"):
        surfaces[name].save(path)
        text = "".join(f"mu 0.5 {voltage} 100 1e-7\n" for voltage in range(100, 211, 5))
        seen += [int(line.split()[1]) for line in run(path, text=text).stdout.splitlines()]
    assert set(seen) == set(Status)


@pytest.mark.parametrize(
    "query",
    [
        "mu 0.3 nan 100 1e-7",
        "mu 0.3 -1 100 1e-7",
        "mu 0.3 inf 100 1e-7",
        "mu nan 10 100 1e-7",
        "mu 0 10 100 1e-7",
        "mu -0.3 10 100 1e-7",
        "mu 0.3 10 nan 1e-7",
        "mu 0.3 10 100 inf",
        "voltage nan 0.3 100 1e-7",
        "voltage inf 0.3 100 1e-7",
        "voltage 0.3 0.3 100 0",
    ],
)
def test_what_python_refuses_is_invalid(
    query: str, surfaces: dict[str, FrictionSurface], run: Run, tmp_path: Path
) -> None:
    surface, path = surfaces["4-D"], tmp_path / "a.surface"
    surface.save(path)
    kind, *texts = query.split()
    numbers = [float(text) for text in texts]
    with pytest.raises(InputError):
        surface.evaluate(*numbers) if kind == "mu" else surface.voltage(*numbers)
    done = run(path, text=f"{query}\nmu 0.3 10 100 1e-7\n")
    first, second = done.stdout.splitlines()
    assert first.lstrip("-") == "nan -1"
    assert second.endswith(" 0")


def test_a_frequency_that_the_surface_was_built_without(
    surfaces: dict[str, FrictionSurface], run: Run, tmp_path: Path
) -> None:
    surfaces["breakdown"].save(tmp_path / "a.surface")
    done = run(tmp_path / "a.surface", text="mu 0.3 10 100 1e-7\n")
    assert done.stdout.lstrip("-") == "nan -1\n"


@pytest.fixture(scope="session")
def data(surfaces: dict[str, FrictionSurface], tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("whole") / "a.surface"
    surfaces["4-D"].save(path)
    return path.read_bytes()


def refused(run: Run, *arguments: Any, text: str = "") -> str:
    done = run(*arguments, text=text)
    assert done.returncode == 1
    assert done.stdout == ""
    assert done.stderr.startswith("read_surface: ") and done.stderr.count("\n") == 1
    return done.stderr


def changed(data: bytes, **changes: Any) -> bytes:
    """A surface's file with some of its description replaced."""
    (length,) = struct.unpack("<Q", data[:8])
    header = json.loads(data[8 : 8 + length])
    own = json.loads(header["__metadata__"]["haptix"]) | changes
    header["__metadata__"]["haptix"] = json.dumps(own)
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 8)
    return struct.pack("<Q", len(text)) + text + data[8 + length :]


def test_damaged_files(data: bytes, run: Run, tmp_path: Path) -> None:
    path = tmp_path / "a.surface"
    body = len(data) - 8 - struct.unpack("<Q", data[:8])[0]
    damaged = [data[: int(share * len(data))] for share in (0, 1e-3, 0.01, 0.3, 0.9, 0.9999)]
    damaged += [data[:-1], data[1:], data[:7], data[:8]]
    for position in (len(data) - 1, len(data) - body, len(data) - body // 2):
        flipped = bytearray(data)
        flipped[position] ^= 1
        damaged.append(bytes(flipped))
    for byte in range(8):
        flipped = bytearray(data)
        flipped[byte] ^= 0xFF
        damaged.append(bytes(flipped))
    damaged += [
        changed(data, unit_v=-1.0),
        changed(data, voltage_limit_v=None),
        changed(data, crc32={}),
        changed(data, crc32=None),
    ]
    for wrong in damaged:
        path.write_bytes(wrong)
        refused(run, path)


def test_a_flipped_bit_in_the_header_never_crashes(data: bytes, run: Run, tmp_path: Path) -> None:
    path = tmp_path / "a.surface"
    (length,) = struct.unpack("<Q", data[:8])
    for position in range(8, 8 + length, 127):
        flipped = bytearray(data)
        flipped[position] ^= 2
        path.write_bytes(flipped)
        assert run(path, text="mu 0.3 10 100 1e-7\n").returncode in (0, 1)  # below 0: a signal


def test_foreign_files(data: bytes, run: Run, tmp_path: Path) -> None:
    path = tmp_path / "a.surface"
    for content in (b"", b"normal_force_n = 1\n" * 20, b'{"mu": 1}', bytes(1000)):
        path.write_bytes(content)
        refused(run, path)
    for metadata in (None, {"haptix": "null"}, {"haptix": "{"}, {"haptix": "\\"}, {"a": "pt"}):
        save_file({"mu": torch.ones(3)}, path, metadata=metadata)
        assert "no friction surface" in refused(run, path)
    path.write_bytes(changed(data, format="other"))
    assert "no friction surface" in refused(run, path)


@pytest.mark.parametrize("version", ["1.0", "3.0", "20.0", None])
def test_other_versions(version: Any, data: bytes, run: Run, tmp_path: Path) -> None:
    path = tmp_path / "a.surface"
    path.write_bytes(changed(data, version=version))
    assert "expected version 2" in refused(run, path)


def test_a_later_minor_version_is_read(data: bytes, run: Run, tmp_path: Path) -> None:
    path = tmp_path / "a.surface"
    more = {"a": [1, {"unit_v": 3, "b": '\\"}],{'}], "é": "\n\t€"}
    path.write_bytes(changed(data, version="2.9", **{"0": more}))
    query = "mu 0.3 10 100 1e-7\n"
    found = run(path, text=query).stdout
    path.write_bytes(data)
    assert found.endswith(" 0\n") and found == run(path, text=query).stdout


def test_what_is_asked_wrongly(data: bytes, run: Run, tmp_path: Path) -> None:
    path = tmp_path / "a.surface"
    path.write_bytes(data)
    for text in ("mu 1 2 3\n", "friction 1 2 3 4\n", "\n", "mu a b c d\n"):
        assert "expected mu F_N V0 f h0" in refused(run, path, text=text)
    for arguments in ((), (path, path), (tmp_path / "none.surface",), (tmp_path,)):
        refused(run, *arguments)


def test_it_stays_short() -> None:
    assert len(SOURCE.read_text().splitlines()) < 150
