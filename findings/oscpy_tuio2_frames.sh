#!/usr/bin/env bash
# oscpy 0.6.0 parses OSC, by which tables and infrared frames send touches (TUIO), beside python-osc 1.10.2. Seen:
# - TUIO 1.1's bundle of a cursor is read;
# - every bundle of TUIO 2 begins with a frame message whose second value is a time tag (type t): ValueError, and the
#   fingers of that bundle are lost with it; python-osc reads all three messages;
# - a bundle within a bundle, which OSC 1.0 allows: ValueError; python-osc reads its message.
# So oscpy can be a source of TUIO 1.1 only.
set -euo pipefail
T=$(mktemp -d); trap 'rm -rf "$T"' EXIT
cd "$T"
python3 -m venv venv && venv/bin/pip -q install oscpy==0.6.0 python-osc==1.10.2
cat > program.py <<'P'
import struct
from oscpy.parser import read_packet
from pythonosc.osc_packet import OscPacket

def text(value):
    return value + bytes(4 - len(value) % 4)

def message(address, types, *values):
    packed = {"i": lambda v: struct.pack(">i", v), "f": lambda v: struct.pack(">f", v),
              "t": lambda v: struct.pack(">Q", v), "s": text}
    return text(address) + text(b"," + types.encode()) + b"".join(packed[t](v) for t, v in zip(types, values))

def bundle(*parts):
    return text(b"#bundle") + struct.pack(">Q", 1) + b"".join(struct.pack(">i", len(p)) + p for p in parts)

def both(name, packet):
    by_python_osc = [m.message.address for m in OscPacket(packet).messages]
    try:
        by_oscpy = [read[0].decode() for read in read_packet(packet)]
    except ValueError as error:
        by_oscpy = type(error).__name__
    print(name, "oscpy:", by_oscpy, "python-osc:", by_python_osc)
    return by_oscpy, len(by_python_osc)

old = bundle(message(b"/tuio/2Dcur", "si", b"alive", 1),
             message(b"/tuio/2Dcur", "sifffff", b"set", 1, 0.5, 0.25, 0.0, 0.0, 0.0),
             message(b"/tuio/2Dcur", "si", b"fseq", 7))
new = bundle(message(b"/tuio2/frm", "itis", 7, 3900000000 << 32, (640 << 16) + 480, b"table"),
             message(b"/tuio2/ptr", "iiifffff", 1, 0, 2, 0.5, 0.25, 0.0, 0.1, 1.0),
             message(b"/tuio2/alv", "i", 1))
assert both("TUIO 1.1", old) == (["/tuio/2Dcur"] * 3, 3)
assert both("TUIO 2", new) == ("ValueError", 3)
assert both("nested", bundle(bundle(message(b"/tuio2/alv", "i", 1)))) == ("ValueError", 1)
P
venv/bin/python program.py
