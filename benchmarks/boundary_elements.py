"""Boundary elements against tamaas on the same surface: time, throughput of a batch, memory.

    python benchmarks/boundary_elements.py [--points 512 1024] [--csv FILE]

Both solve to the same quantity, measured alike on what they return: the largest violation of the
contact conditions at any point over h_rms. It is what haptix' tolerance bounds. tamaas stops at a
mean instead, ``sum p (g - min g) / (sum p h_rms)`` (g its gap before it is levelled), whose largest
part is the deepest overlap, -min g: at a tolerance t it ends with overlaps between t/5 and 1.2 t.
The column "violation" shows both; haptix' is never the larger by much. Times are the best of three
(one for tamaas where it takes over 10 s), one process each on one core, then on two. On one core,
processor time is measured, which a busy machine hardly disturbs.
"""

import argparse
import csv
import json
import os
import resource
import subprocess
import sys
import time
from math import pi

LOADS, TOLERANCES, BATCH = (1e-3, 1e-2, 1e-1), (1e-4, 1e-7), 8
ONE_CORE = os.environ.get("OMP_NUM_THREADS") == "1"
CLOCK = time.process_time if ONE_CORE else time.perf_counter


def surfaces(points, count):
    from haptix.model.contact import RoughnessSpectrum
    from haptix.model.contact.boundary_elements import Surfaces

    wave = 2 * pi
    spectrum = RoughnessSpectrum.self_affine(1.0, 0.8, wave, 4 * wave, points / 8 * wave)
    return Surfaces.random(spectrum, points, 1.0, count, seed=0)


def best_of(function):
    """Shortest of up to three calls [s], and what the last one returned."""
    times = []
    while len(times) < 3 and sum(times) < 20:
        start = CLOCK()
        found = function()
        times.append(CLOCK() - start)
    return min(times), found


def fastest_of_turns(*functions):
    """Shortest of three calls of each [s], taken in turns."""
    times = []
    for _ in range(3):
        turn = []
        for function in functions:
            start = time.perf_counter()
            function()
            turn.append(time.perf_counter() - start)
        times.append(turn)
    return [min(column) for column in zip(*times, strict=True)]


def violation(pressure, gap, h_rms):
    gap = gap - gap[pressure > 0].mean()
    return max(abs(gap[pressure > 0]).max(), -gap.min()) / h_rms


def measure_tamaas(points):
    import tamaas

    tamaas.set_log_level(tamaas.LogLevel.error)
    surface = surfaces(points, 1)
    height = surface.height_m[0].numpy()
    for x in LOADS:
        for tolerance in TOLERANCES:
            model = tamaas.ModelFactory.createModel(
                tamaas.model_type.basic_2d, [1.0, 1.0], [points, points]
            )
            model.E, model.nu = 1.0, 0.0

            def solve(model=model, tolerance=tolerance, x=x):
                model.traction[:] = 0
                model.displacement[:] = 0
                solver = tamaas.PolonskyKeerRey(model, height, tolerance)
                solver.solve(x * float(surface.slope_rms))

            seconds, _ = best_of(solve)
            worst = violation(model.traction, model.displacement - height, height.std())
            yield {"x": x, "tolerance": tolerance, "seconds": seconds, "violation": worst}


def measure_haptix(points):
    from haptix.model.contact import HalfSpace
    from haptix.model.contact.boundary_elements import BoundaryElements

    surface = surfaces(points, 1)
    for x in LOADS:
        for tolerance in TOLERANCES:
            solver = BoundaryElements(surface, HalfSpace(1.0, 0.0), tolerance=tolerance)
            pressure = x * float(surface.slope_rms)
            solver.fields(pressure)  # makes the kernel, as tamaas' model is made above
            seconds, solved = best_of(lambda s=solver, p=pressure: s.fields(p))
            worst = violation(
                solved.pressure_pa[0].numpy(), solved.gap_m[0].numpy(), float(surface.h_rms_m)
            )
            yield {"x": x, "tolerance": tolerance, "seconds": seconds, "violation": worst}


def measure_batch(points):
    from haptix.model.contact import HalfSpace
    from haptix.model.contact.boundary_elements import BoundaryElements, Surfaces

    batch = surfaces(points, BATCH)
    singles = [
        Surfaces(h[None], batch.side_m, batch.q_low, batch.q_high, batch.waves_in_box)
        for h in batch.height_m
    ]
    together = BoundaryElements(batch, HalfSpace(1.0, 0.0))
    alone = [BoundaryElements(one, HalfSpace(1.0, 0.0)) for one in singles]
    for x in LOADS:
        pressure = x * float(batch.slope_rms.mean())
        # In turns, so that other load on the machine affects all of them.
        seconds, one_by_one, cores_within = fastest_of_turns(
            lambda p=pressure: together.solve(p),
            lambda p=pressure: [solver.solve(p) for solver in alone],
            # The other core helps within a transform; area, perimeter, gaps are not measured.
            lambda p=pressure: [solver.fields(p) for solver in alone],
        )
        yield {
            "x": x,
            "seconds": seconds,
            "one_by_one": one_by_one,
            "cores_within": cores_within,
        }


def measure_tamaas_memory(points):
    import tamaas

    surface = surfaces(points, 1)
    shape = [points, points]
    model = tamaas.ModelFactory.createModel(tamaas.model_type.basic_2d, [1.0, 1.0], shape)
    model.E, model.nu = 1.0, 0.0
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    solver = tamaas.PolonskyKeerRey(model, surface.height_m[0].numpy(), 1e-5)
    solver.solve(1e-2 * float(surface.slope_rms))
    used = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * 1024
    yield {"bytes_per_point": used / points**2}


def measure_memory(points):
    from haptix.model.contact import HalfSpace
    from haptix.model.contact.boundary_elements import BoundaryElements, estimated_bytes

    solver = BoundaryElements(surfaces(points, 1), HalfSpace(1.0, 0.0))
    solver.full_contact_pressure()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    solver.fields(1e-2 * float(solver.surfaces.slope_rms))
    used = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * 1024
    yield {
        "bytes_per_point": used / points**2,
        "estimated": estimated_bytes(points, 1) / points**2,
    }


def measure_attracted_memory(points):
    from haptix.model.contact import HalfSpace
    from haptix.model.contact.boundary_elements import BoundaryElements, estimated_bytes

    surface = surfaces(points, 1)
    solver = BoundaryElements(surface, HalfSpace(1.0, 0.0))
    solver.full_contact_pressure()
    pressure, h0 = 1e-2 * float(surface.slope_rms), 0.3 * float(surface.h_rms_m)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    strengths = [share * pressure * h0**2 for share in (0.0, 0.05, 0.2)]
    solver.solve_attracted(pressure, lambda gap: 1 / (gap + h0) ** 2, strengths)
    used = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * 1024
    yield {
        "bytes_per_point": used / points**2,
        "estimated": estimated_bytes(points, 1, coupled=True) / points**2,
    }


MEASURES = {
    "tamaas": measure_tamaas,
    "haptix": measure_haptix,
    "batch": measure_batch,
    "memory": measure_memory,
    "attracted_memory": measure_attracted_memory,
    "tamaas_memory": measure_tamaas_memory,
}


def in_a_process(measure, points, cores):
    """Rows of a measure, in an interpreter of its own with `cores` threads."""
    done = subprocess.run(
        [sys.executable, __file__, "--only", measure, "--points", str(points)],
        env={**os.environ, "OMP_NUM_THREADS": str(cores)},
        capture_output=True,
        text=True,
        check=True,
    )
    return [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]


def compare(points, cores):
    theirs, ours = (in_a_process(name, points, cores) for name in ("tamaas", "haptix"))
    for a, b in zip(theirs, ours, strict=True):
        yield {
            "points": points,
            "cores": cores,
            "x": a["x"],
            "tolerance": a["tolerance"],
            "tamaas_s": a["seconds"],
            "haptix_s": b["seconds"],
            "ratio": b["seconds"] / a["seconds"],
            "tamaas_violation": a["violation"],
            "haptix_violation": b["violation"],
        }


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--points", type=int, nargs="+", default=[512, 1024])
    arguments.add_argument("--cores", type=int, nargs="+", default=[1, 2])
    arguments.add_argument("--csv", help="write the comparison here")
    arguments.add_argument("--only", choices=MEASURES, help=argparse.SUPPRESS)
    chosen = arguments.parse_args()
    if chosen.only:
        for row in MEASURES[chosen.only](chosen.points[0]):
            print(json.dumps({key: float(value) for key, value in row.items()}))
        return
    rows = []
    print("points cores  x       tolerance  tamaas [s]  haptix [s]  ratio  violation of both")
    for cores in chosen.cores:
        for points in chosen.points:
            for row in compare(points, cores):
                rows.append(row)
                print(
                    f"{row['points']:6d} {row['cores']:5d}  {row['x']:<6g}  "
                    f"{row['tolerance']:<9g}  {row['tamaas_s']:10.3f}  {row['haptix_s']:10.3f}  "
                    f"{row['ratio']:5.2f}  {row['tamaas_violation']:.1e} "
                    f"{row['haptix_violation']:.1e}",
                    flush=True,
                )
    for points in chosen.points:
        for row in in_a_process("batch", points, 2):
            print(
                f"{points} points, x = {row['x']:g}, two cores: {BATCH} surfaces in a batch "
                f"{row['seconds']:.2f} s; one by one {row['one_by_one']:.2f} s, "
                f"{row['one_by_one'] / row['seconds']:.2f} times the throughput; one by one with "
                f"both cores in each, fields only, {row['cores_within']:.2f} s, "
                f"{row['cores_within'] / row['seconds']:.2f} times",
                flush=True,
            )
        (theirs,) = in_a_process("tamaas_memory", points, 1)
        (row,) = in_a_process("memory", points, 1)
        print(
            f"{points} points: {row['bytes_per_point']:.0f} bytes per point at the peak, "
            f"{row['estimated']:.0f} estimated; "
            f"tamaas {theirs['bytes_per_point']:.0f} beside its model"
        )
    if chosen.csv:
        with open(chosen.csv, "w", newline="") as file:  # noqa: PTH123
            writer = csv.DictWriter(file, rows[0])
            writer.writeheader()
            writer.writerows(rows)


if __name__ == "__main__":
    main()
