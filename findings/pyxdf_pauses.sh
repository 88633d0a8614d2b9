#!/usr/bin/env bash
# pyxdf 1.17.5 (numpy 2.3.5), load_xdf by its defaults. A stream of a nominal rate has two bursts of 0.1 s, 0.9 s
# apart, and a right time stamp on every sample. Seen:
# - by default one line is laid through both bursts (a pause counts from 1 s and 500 samples on): the second burst
#   begins some 450 ms before its stamps;
# - with a nominal rate of 0 in the header, and with desc/synchronization/can_drop_samples = true, the stamps stay.
# So stimuli that are streamed with pauses need a nominal rate of 0, whatever the device's rate.
set -euo pipefail
T=$(mktemp -d); trap 'rm -rf "$T"' EXIT
cd "$T"
python3 -m venv venv && venv/bin/pip -q install pyxdf==1.17.5 numpy==2.3.5
cat > program.py <<'P'
import struct, pyxdf

def chunk(tag, content):
    body = struct.pack("<H", tag) + content
    return b"\x08" + struct.pack("<Q", len(body)) + body

def late_by_ms(rate, desc=""):
    times = [5 + k / 1000 for k in range(100)] + [6 + k / 1000 for k in range(100)]
    info = ("<?xml version='1.0'?><info><name>s</name><type>Stimulus</type><channel_count>1</channel_count>"
            f"<nominal_srate>{rate}</nominal_srate><channel_format>double64</channel_format>"
            f"<created_at>0</created_at><uid>u</uid><desc>{desc}</desc></info>")
    samples = b"\x08" + struct.pack("<Q", len(times))
    samples += b"".join(b"\x08" + struct.pack("<dd", t, 1.0) for t in times)
    data = b"XDF:" + chunk(1, b"<?xml version='1.0'?><info><version>1.0</version></info>")
    data += chunk(2, struct.pack("<I", 1) + info.encode()) + chunk(3, struct.pack("<I", 1) + samples)
    open("s.xdf", "wb").write(data)
    (stream,), _ = pyxdf.load_xdf("s.xdf", synchronize_clocks=False)
    return 1e3 * (stream["time_stamps"][100] - 6.0)

drops = "<synchronization><can_drop_samples>true</can_drop_samples></synchronization>"
found = [round(late_by_ms(*a), 1) for a in ((1000,), (0,), (1000, drops))]
print(pyxdf.__version__, found)
assert -460 < found[0] < -430 and found[1:] == [0.0, 0.0]
P
venv/bin/python program.py 2>/dev/null
