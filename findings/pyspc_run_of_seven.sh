#!/usr/bin/env bash
# pyspc 0.4 (numpy 2.3.5, pandas 2.3.3, matplotlib 3.10.7), chart of individual readings (xmr) with its default rules, one
# of which is "seven on one side of the centre". Its drawing of a whole chart needs a matplotlib below 3.6, so the chart
# and that rule are asked here as the drawing asks them. Seen:
# - the seven first readings of a chart on one side are not marked; the same seven after one other reading are;
# - a chart whose centre is exactly 0, as deviations from a reference may have, marks no run, whatever its length;
#   the same readings plus 1 are marked.
set -euo pipefail
T=$(mktemp -d); trap 'rm -rf "$T"' EXIT
cd "$T"
python3 -m venv venv && venv/bin/pip -q install pyspc==0.4 numpy==2.3.5 pandas==2.3.3 matplotlib==3.10.7
cat > program.py <<'P'
import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from pyspc import rules, xmr

def marked(name, readings):
    values, centre, low, high, _ = xmr().plot(np.array(readings, float), 1)
    found = rules().RULE_7_ON_ONE_SIDE(plt.subplots()[1], values, centre, low, high)
    print(f"{name}: centre {centre:g}, marked {found}")
    return found

high = [1.0, 1.2, 0.9, 1.1, 1.0, 1.2, 0.8]  # all above the centre of each chart
low = [-0.2, 1.0, -0.1, 1.2, -0.3, 0.9, -0.2]  # to either side
assert marked("seven first", high + low) == []
assert marked("seven after one", [-0.2, *high, *low]) == [7]
long = [1.0, 0.75, 1.25, 1.0, 1.25, 0.75, 1.0, 1.25, 0.75, 1.0]
zero = long + [-value for value in long]
assert marked("ten and ten about 0", zero) == []
assert marked("ten and ten about 1", [value + 1 for value in zero]) == [7, 8, 9, 16, 17, 18, 19]
P
venv/bin/python program.py
