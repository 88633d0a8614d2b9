#!/usr/bin/env bash
# npTDMS 1.13.0 (numpy 2.3.5, pandas 2.3.3), a group with two channels whose wf_start_time is 3 s apart, as two tasks
# of a DAQ card write it; both have wf_start_offset 0. Seen:
# - time_track() begins at 0 for both, and as_dataframe(time_index=True) puts samples of 3 s apart into one row;
# - time_track(absolute_time=True) and as_dataframe(time_index=True, absolute_time=True) keep them apart.
# So the default times of a force and of a position that was started later shift one against the other.
set -euo pipefail
T=$(mktemp -d); trap 'rm -rf "$T"' EXIT
cd "$T"
python3 -m venv venv && venv/bin/pip -q install npTDMS==1.13.0 numpy==2.3.5 pandas==2.3.3
cat > program.py <<'P'
from importlib.metadata import version
import numpy as np
from nptdms import ChannelObject, TdmsFile, TdmsWriter

began = np.datetime64("2026-11-20T10:00:00", "us")

def channel(name, start):
    about = {"wf_start_time": start, "wf_start_offset": 0.0, "wf_increment": 0.001, "wf_samples": 10}
    return ChannelObject("stroke", name, np.arange(10.0), about)

with TdmsWriter("a.tdms") as file:
    file.write_segment([channel("force", began), channel("position", began + np.timedelta64(3, "s"))])
group = TdmsFile.read("a.tdms")["stroke"]
relative = [float(one.time_track()[0]) for one in group.channels()]
absolute = [one.time_track(absolute_time=True)[0] for one in group.channels()]
rows = group.as_dataframe(time_index=True)
apart = group.as_dataframe(time_index=True, absolute_time=True)
print(version("npTDMS"), relative, (absolute[1] - absolute[0]) / np.timedelta64(1, "s"), len(rows), len(apart))
assert relative == [0.0, 0.0]
assert (absolute[1] - absolute[0]) / np.timedelta64(1, "s") == 3.0
assert rows.notna().all().all() and len(rows) == 10
assert len(apart) == 20 and not apart.notna().all(axis=1).any()
P
venv/bin/python program.py
