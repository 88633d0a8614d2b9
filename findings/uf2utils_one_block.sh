#!/usr/bin/env bash
# uf2utils 0.9.8 writes UF2 files, as boards with a USB boot loader take them. Seen, for its default family, RP2040:
# - with fill_gaps=True an image of one block (256 bytes or fewer) is written as a file of 0 bytes, without an error; two
#   blocks are written whole, and without fill_gaps so is one;
# - the last block states its own size, here 44 bytes, where the RP2040's boot ROM takes blocks of 256 bytes only (RP2040
#   datasheet, "UF2 format details"), so that an image is to be padded before.
set -euo pipefail
T=$(mktemp -d); trap 'rm -rf "$T"' EXIT
cd "$T"
python3 -m venv venv && venv/bin/pip -q install uf2utils==0.9.8
cat > program.py <<'P'
import struct
from uf2utils.file import UF2File

def sizes(image, fill_gaps):
    """Payload that each written block states."""
    file = UF2File(fill_gaps=fill_gaps)
    file.append_payload(image, 0x10000000)
    file.to_file("image.uf2")
    data = open("image.uf2", "rb").read()
    found = [struct.unpack_from("<I", data, at + 16)[0] for at in range(0, len(data), 512)]
    print(f"{len(image)} bytes, fill_gaps={fill_gaps}: blocks of {found}")
    return found

assert sizes(bytes(256), False) == [256]
assert sizes(bytes(256), True) == []
assert sizes(bytes(512), True) == [256, 256]
assert sizes(bytes(300), False) == [256, 44]
P
venv/bin/python program.py
