#!/usr/bin/env bash
# tamaas 2.9.0 (numpy 2.3.5), random surfaces by SurfaceGeneratorFilter2D with an Isopowerlaw2D. Seen: wave numbers are
# counted in waves along each side, whatever the number of points along it. On 512 x 512 points a surface is as steep
# along x as along y; on 512 x 256 points, which one would take for a patch half as wide, it is twice as steep from point
# to point along the shorter side. Isotropic roughness needs as many points along both sides (and is cut afterwards).
set -euo pipefail
T=$(mktemp -d); trap 'rm -rf "$T"' EXIT
cd "$T"
python3 -m venv venv && venv/bin/pip -q install tamaas==2.9.0 numpy==2.3.5
cat > program.py <<'P'
import numpy as np
import tamaas

tamaas.set_log_level(tamaas.LogLevel.error)
spectrum = tamaas.Isopowerlaw2D()
spectrum.q0, spectrum.q1, spectrum.q2, spectrum.hurst = 8, 8, 64, 0.8

def steepness(points):
    """Root mean square step from point to point along x over that along y, of 16 surfaces."""
    steps = []
    for seed in range(16):
        generator = tamaas.SurfaceGeneratorFilter2D(points)
        generator.spectrum, generator.random_seed = spectrum, seed
        surface = np.asarray(generator.buildSurface())
        steps.append([np.diff(surface, axis=axis).var() for axis in (0, 1)])
    along_x, along_y = np.sqrt(np.mean(steps, axis=0))
    print(points, f"{along_x / along_y:.3f}")
    return along_x / along_y

assert abs(steepness([512, 512]) - 1) < 0.03
assert abs(steepness([512, 256]) - 0.5) < 0.03
assert abs(steepness([256, 512]) - 2) < 0.1
P
venv/bin/python program.py
