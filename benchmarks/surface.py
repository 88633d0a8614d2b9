"""The friction surface: time to build, evaluate, invert, slice and load.

    python benchmarks/surface.py [price]

With `price` it only compares the default theory with the quick one.

Ratios compare times measured in turn in one run. Every time is the best of several, since other
work slows the machine. interpn is a peer too where it is installed (pip install interpn): linear
interpolation in Rust, without gradients, statuses or a pull-in voltage for each point.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial
from pathlib import Path

import numpy as np
import torch
from scipy.interpolate import RegularGridInterpolator

from calibration.plan.parameters import Parameters
from calibration.plan.predict import StrokeConditions, StrokePredictor
from haptix import ContactModel, Finger, FrictionSurface, Screen
from haptix.model.contact.theories import _cached_field
from haptix.model.surface import Interpolant
from haptix.model.surface.axes import Axes

RANGES = {
    "normal_force_n": (0.1, 1.0),
    "frequency_hz": (60.0, 1e4),
    "h0_m": (5e-8, 5e-7),
}
POINTS = 1_000_000


def best_s(work: Callable[[], object], repeats: int = 7) -> float:
    """Shortest time [s] of several runs, after a warm-up run."""
    work()
    times = []
    for _ in range(repeats):
        began = time.perf_counter()
        work()
        times.append(time.perf_counter() - began)
    return min(times)


def in_turns(*works: Callable[[], object], rounds: int = 40) -> list[float]:
    """Shortest processor time [s] of each work, in turns after a warm-up of all."""
    for work in works:
        work()
    times = np.empty((rounds, len(works)))
    for row in times:
        for number, work in enumerate(works):
            began = time.process_time()
            work()
            row[number] = time.process_time() - began
    return [float(one) for one in times.min(axis=0)]


def build(theory: str = "local") -> FrictionSurface:
    """Build from nothing: the contact's tables included."""
    finger, screen = Finger.preset("semi-wet"), Screen.preset("3m-sct3250")
    model = ContactModel(finger, screen, theory=theory)
    return FrictionSurface.build(model, RANGES, "0.2 %")


def price() -> Iterator[str]:
    """Processor time of `local` beside `corrected`, in turns: tables, states and strokes."""

    def from_nothing(theory: str) -> None:
        _cached_field.cache_clear()
        build(theory)

    torch.set_num_threads(1)
    names = ("corrected", "local")
    finger, screen = Finger.preset("semi-wet"), Screen.preset("3m-sct3250")
    models = [ContactModel(finger, screen, theory=theory) for theory in names]
    force, share = torch.rand(2, 100_000, dtype=torch.float64)
    generator = np.random.default_rng(1)
    strokes = StrokeConditions(
        generator.uniform(0.1, 1.0, 40),
        generator.uniform(0.0, 100.0, 40),
        generator.choice([125.0, 250.0, 500.0, 1000.0], 40),
        generator.uniform(20.0, 100.0, 40),
    )
    given = [Parameters.of(model.finger, model.screen).fixed() for model in models]
    predict = [
        partial(StrokePredictor(model), strokes, one.names, one.log_values)
        for model, one in zip(models, given, strict=True)
    ]
    works: dict[str, tuple[list[Callable[[], object]], int]] = {
        "a surface, from nothing": ([partial(from_nothing, name) for name in names], 5),
        "building": ([partial(build, name) for name in names], 5),
        "100,000 states": ([partial(m.solve, 0.1 + force, 200 * share) for m in models], 10),
        "one state": ([partial(m.solve, 0.5, 100.0, 200.0) for m in models], 200),
        "40 strokes": ([partial(one, jacobian=False) for one in predict], 20),
        "40 strokes with their Jacobian": (list(predict), 20),
    }
    for name, (work, rounds) in works.items():
        corrected_s, local_s = in_turns(*work, rounds=rounds)
        yield (
            f"{name} by `local` takes {local_s / corrected_s:.1f} times that by `corrected`: "
            f"{1e3 * local_s:.3g} ms and {1e3 * corrected_s:.3g}"
        )


def draw(low: float, high: float, generator: torch.Generator) -> torch.Tensor:
    """Draw points log-uniformly."""
    share = torch.rand(POINTS, generator=generator, dtype=torch.float64)
    return (low * (high / low) ** share).clamp(low, high)


def queries(surface: FrictionSurface) -> None:
    """Evaluation and inversion against other interpolators on the same table."""
    generator = torch.Generator().manual_seed(1)
    force, frequency, h0 = (draw(*RANGES[name], generator) for name in RANGES)
    voltage = 40 * torch.rand(POINTS, generator=generator, dtype=torch.float64)
    table = surface.table
    axes = [axis.nodes.log().numpy() for axis in table.axes]
    theirs = RegularGridInterpolator((*axes, table.drive.numpy()), table.mu.numpy())
    drive = torch.rand(POINTS, dtype=torch.float64) * table.drive[-1]
    points = torch.stack([force.log(), frequency.log(), h0.log(), drive], -1).numpy()
    ends = [axis[0] for axis in theirs.grid], [axis[-1] for axis in theirs.grid]
    points = points.clip(*ends)
    with suppress(ImportError):
        from interpn import MultilinearRectilinear

        peer = MultilinearRectilinear.new(list(theirs.grid), table.mu.numpy().reshape(-1))
        columns, out = [np.ascontiguousarray(column) for column in points.T], np.empty(POINTS)
        torch.set_num_threads(1)
        ours_s, theirs_s = in_turns(
            lambda: surface.evaluate(force, voltage, frequency, h0),
            lambda: peer.eval(columns, out),
        )
        print(
            f"4-D, float64, 1 thread, in turns: {ours_s * 1e3:.0f} ms a million; interpn, linear: "
            f"{theirs_s * 1e3:.0f} ms, {ours_s / theirs_s:.2f} of it"
        )

    for dtype in (torch.float64, torch.float32):
        for threads in (1, 2):
            torch.set_num_threads(threads)
            ours = surface.to(dtype)
            at = (force.to(dtype), voltage.to(dtype), frequency.to(dtype), h0.to(dtype))
            mu = ours.evaluate(*at).mu
            scipy_s = best_s(partial(theirs, points), 3)
            evaluate = best_s(partial(ours.evaluate, *at))
            invert = best_s(partial(ours.voltage, mu, at[0], *at[2:]))
            print(
                f"4-D, {str(dtype).removeprefix('torch.')}, {threads} thread(s): evaluation "
                f"{evaluate * 1e3:4.0f} ms a million, {scipy_s / evaluate:4.1f} times as fast as "
                f"scipy's {scipy_s * 1e3:.0f} ms; inversion {invert * 1e3:4.0f} ms"
            )
    torch.set_num_threads(1)
    flat = surface.at(1000.0, 2e-7).to(torch.float32)
    force32, volts32 = force.float(), voltage.float()
    mu32 = flat.evaluate(force32, volts32).mu
    evaluate = best_s(lambda: flat.evaluate(force32, volts32))
    invert = best_s(lambda: flat.voltage(mu32, force32))
    print(
        f"2-D slice, float32, 1 thread: evaluation {1 / evaluate:.1f} million a second, "
        f"inversion {1 / invert:.1f} million a second"
    )
    frequencies = np.geomspace(61.0, 9.9e3, 1000).tolist()
    each = best_s(lambda: [surface.at(f, 2e-7) for f in frequencies]) / len(frequencies)
    print(f"slices at new frequencies: {each * 1e6:.0f} us each")


def load(surface: FrictionSurface) -> None:
    """Load a file of 20 MB, which repeats the surface's columns along the force."""
    table = surface.table
    forces = table.axes.shape[0]
    many = int(20e6 / table.columns.nbytes * forces) + 1
    nodes = {axis.name: axis.nodes for axis in table.axes}
    nodes["normal_force_n"] = torch.logspace(-1, 0, many, dtype=torch.float64)
    copies = table.columns[torch.arange(many) % forces]
    large = FrictionSurface(
        Interpolant(Axes.of(nodes), table.drive, copies, table.unit_v, table.voltage_limit_v),
        surface.info,
    )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "large.surface"
        large.save(path)
        size = path.stat().st_size / 1e6
        seconds = best_s(lambda: FrictionSurface.load(path))
        print(f"load, checksums included: {seconds * 1e3:.1f} ms for {size:.0f} MB")


def main() -> None:
    """Measure and print everything."""
    for line in price():
        print(line)
    if "price" in sys.argv[1:]:
        return
    torch.set_num_threads(2)
    seconds = best_s(partial(build, "corrected"), 3)
    surface = build("corrected")
    size = " x ".join(str(n) for n in surface.mu_table.shape)
    span = surface.info["mu_high"] - surface.info["mu_low"]
    print(
        f"4-D surface of {size}: built in {seconds:.2f} s with the contact's tables; largest error "
        f"{100 * surface.info['error_max'] / span:.2f} % of the mu range, "
        f"99 % below {100 * surface.info['error_p99'] / span:.2f} %"
    )
    queries(surface)
    load(surface)


if __name__ == "__main__":
    main()
