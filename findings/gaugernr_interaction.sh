#!/usr/bin/env bash
# GaugeRnR 0.6.0 (numpy 2.3.5, scipy 1.16.3), a gauge study by analysis of variance: 3 operators, 10 parts, 2 readings
# each. The expected mean square of operator by part is var(reading) + readings * var(operator by part) (AIAG, Measurement
# systems analysis; any textbook of crossed random effects). Seen: the difference of mean squares is divided by the
# number of parts, not of readings, so that the variance of operator by part comes out 5 times too small here, and with
# it that of the whole gauge; the mean squares themselves are right. With as many readings as parts it is right.
set -euo pipefail
T=$(mktemp -d); trap 'rm -rf "$T"' EXIT
cd "$T"
python3 -m venv venv && venv/bin/pip -q install GaugeRnR==0.6.0 numpy==2.3.5 scipy==1.16.3
cat > program.py <<'P'
import numpy as np
from GaugeRnR import Component, GaugeRnR, Result

def interaction(operators, parts, readings):
    """Variance of operator by part: GaugeRnR's, and from its own mean squares."""
    draw = np.random.default_rng(4)
    data = (10 + draw.normal(0, 1, (1, parts, 1)) + draw.normal(0, 0.2, (operators, 1, 1))
            + draw.normal(0, 0.5, (operators, parts, 1)) + draw.normal(0, 0.1, (operators, parts, readings)))
    study = GaugeRnR(data)
    found = study.calculate()
    square = found[Result.MS]
    means = data.mean(2)
    left = means - means.mean(0) - means.mean(1, keepdims=True) + means.mean()
    own = readings * (left**2).sum() / ((operators - 1) * (parts - 1))
    assert abs(square[Component.OPERATOR_BY_PART] / own - 1) < 1e-9
    right = (own - square[Component.MEASUREMENT]) / readings
    return float(found[Result.Var][Component.OPERATOR_BY_PART]), float(right)

for shape in ((3, 10, 2), (3, 6, 6)):
    theirs, right = interaction(*shape)
    print(shape, f"theirs {theirs:.4f}, from the mean squares {right:.4f}, drawn with 0.25")
    assert abs(right / theirs - shape[1] / shape[2]) < 1e-9
P
venv/bin/python program.py
