#!/usr/bin/env bash
# questplus 2023.1 (numpy 2.3.5, xarray 2025.12.0), stimuli by "min_n_entropy". Seen: the attribute next_stim draws anew
# each time it is read, without a trial in between. A program that reads it once to play and once more to write its log
# or to update has another stimulus there; by "min_entropy" it has the same. To be read once for each trial.
set -euo pipefail
T=$(mktemp -d); trap 'rm -rf "$T"' EXIT
cd "$T"
python3 -m venv venv && venv/bin/pip -q install questplus==2023.1 numpy==2.3.5 xarray==2025.12.0
cat > program.py <<'P'
from questplus import QuestPlus

def read_six_times(selection, options):
    method = QuestPlus(
        stim_domain={"intensity": [float(level) for level in range(-20, 1)]},
        param_domain={"threshold": [float(level) for level in range(-20, 1)], "slope": [3.5], "lower_asymptote": [0.5],
                      "lapse_rate": [0.02]},
        outcome_domain={"response": ["right", "wrong"]}, func="weibull", stim_scale="dB",
        stim_selection_method=selection, stim_selection_options=options,
    )
    read = [method.next_stim["intensity"] for _ in range(6)]
    print(selection, read)
    return len(set(read))

assert read_six_times("min_entropy", None) == 1
assert read_six_times("min_n_entropy", {"n": 4, "max_consecutive_reps": 2, "random_seed": 1}) > 1
P
venv/bin/python program.py
