#!/usr/bin/env bash
# hid-parser 0.1.0 reads reports by their HID descriptor. Three ordinary descriptors, beside hid-tools 0.12. Seen:
# - a mouse's X with logical minimum -127: the byte 255 is read as 255, not as -1 (HID 1.11, 6.2.2.7: signed);
# - report count 2 with one usage, which stands for both fields (6.2.2.8): the second field is left out and the next
#   usage is read from its byte;
# - a touchscreen's report (tip switch, contact identifier, X, Y): ValueError, since its table of the digitizer page
#   has no types; and X and Y of a second finger would have the keys of the first.
# So a panel's coordinates need another reader; hid-tools gives the fields of each finger.
set -euo pipefail
T=$(mktemp -d); trap 'rm -rf "$T"' EXIT
cd "$T"
python3 -m venv venv && venv/bin/pip -q install hid-parser==0.1.0 hid-tools==0.12
cat > program.py <<'P'
import warnings
from hid_parser import ReportDescriptor
from hidtools.hid import ReportDescriptor as Kernel

warnings.simplefilter("ignore")
mouse = "05 01 09 02 a1 01 09 01 a1 00 09 30 09 31 15 81 25 7f 75 08 95 02 81 06 c0 c0"
pad = "05 01 09 05 a1 01 09 36 15 00 26 ff 00 75 08 95 02 81 02 09 30 95 01 81 02 c0"
finger = "05 0d 09 22 a1 02 09 42 15 00 25 01 75 08 95 01 81 02 09 51 81 02 05 01 26 ff 0f 75 10 09 30 81 02 09 31 81 02 c0"
panel = f"05 0d 09 04 a1 01 {finger} {finger} c0"

def both(descriptor, report):
    data = bytes.fromhex(descriptor)
    try:
        theirs = [int(value) for value in ReportDescriptor(data).parse_input_report(report).values()]
    except ValueError as error:
        theirs = str(error)
    kernel = [v for f in next(iter(Kernel.from_bytes(data).input_reports.values())) for v in f.get_values(report)]
    print("hid-parser", theirs, "hid-tools", kernel)
    return theirs, kernel

assert both(mouse, [255, 1]) == ([255, 1], [-1, 1])
assert both(pad, [1, 2, 3]) == ([1, 2], [1, 2, 3])
assert both(panel, [1, 0, 10, 0, 20, 0, 1, 1, 30, 0, 40, 0]) == (
    "Sub-data not available", [1, 0, 10, 20, 1, 1, 30, 40])
P
venv/bin/python program.py
