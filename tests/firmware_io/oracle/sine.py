"""The sine table of the carrier, as numbers and in C; `make sine` writes haptix_sine.h."""

from __future__ import annotations

import math
import sys

#: Entries in a turn. Linear interpolation between them is within 5e-6 of the sine, a sixth of a
#: step of the output ((2 pi / 1024)**2 / 8).
TURN = 1024


def sine_table() -> list[int]:
    """Return the sine over one turn in 1/32767, both ends included."""
    return [round(32767 * math.sin(2 * math.pi * i / TURN)) for i in range(TURN + 1)]


def c_header() -> str:
    """Return haptix_sine.h."""
    table = [str(value) for value in sine_table()]
    rows = [", ".join(table[start : start + 12]) for start in range(0, len(table), 12)]
    return (
        "/* One turn of a sine in 1/32767, both ends included. Made by `make sine`. */\n"
        "#ifndef HAPTIX_SINE_H\n#define HAPTIX_SINE_H\n\n#include <stdint.h>\n\n"
        f"static const int16_t hx_sine[{len(table)}] = {{\n    "
        + ",\n    ".join(rows)
        + "};\n\n#endif\n"
    )


if __name__ == "__main__":
    sys.stdout.write(c_header())
