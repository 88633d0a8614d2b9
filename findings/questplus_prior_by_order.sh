#!/usr/bin/env bash
# questplus 2023.1 (numpy 2.3.5, xarray 2025.12.0): a prior of every parameter is a dictionary by name. Seen: its values
# are taken in the dictionary's own order, not by name. Where "slope" stands before "threshold" and both have as many
# values, each gets the other's prior, without a word; a prior of some parameters only is taken by name.
set -euo pipefail
T=$(mktemp -d); trap 'rm -rf "$T"' EXIT
cd "$T"
python3 -m venv venv && venv/bin/pip -q install questplus==2023.1 numpy==2.3.5 xarray==2025.12.0
cat > program.py <<'P'
from questplus import QuestPlus

levels = {"threshold": [10.0, 20.0, 30.0], "slope": [1.0, 2.0, 3.0], "lower_asymptote": [0.5], "lapse_rate": [0.02]}
prior = {"threshold": [0.8, 0.1, 0.1], "slope": [0.1, 0.1, 0.8], "lower_asymptote": [1.0], "lapse_rate": [1.0]}

def threshold(names):
    """Prior of the threshold that a procedure begins with."""
    method = QuestPlus(
        stim_domain={"intensity": [10.0, 20.0, 30.0]}, param_domain=levels, outcome_domain={"response": ["right", "wrong"]},
        prior={name: prior[name] for name in names}, func="weibull", stim_scale="dB",
    )
    found = [round(float(p), 6) for p in method.marginal_posterior["threshold"]]
    print(*names, found)
    return found

assert threshold(["threshold", "slope", "lower_asymptote", "lapse_rate"]) == [0.8, 0.1, 0.1]
assert threshold(["slope", "threshold", "lower_asymptote", "lapse_rate"]) == [0.1, 0.1, 0.8]
assert threshold(["slope", "threshold"]) == [0.8, 0.1, 0.1]
P
venv/bin/python program.py
