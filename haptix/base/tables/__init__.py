"""Tables of laboratory instruments: text of any layout, LabVIEW's LVM, National Instruments' TDMS.

Nothing is guessed that a file does not state: columns without a unit have none. Its layout, as it
was understood, stands in `LabTable.understood`.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from haptix.base.errors import FileFormatError
from haptix.base.files import LARGEST_TABLE_BYTES, read_bytes
from haptix.base.tables.labview import of_lvm, of_tdms
from haptix.base.tables.table import FEWEST_SAMPLES, TIMES_S, LabTable, split_unit
from haptix.base.tables.text import of_text

__all__ = ["FEWEST_SAMPLES", "TIMES_S", "LabTable", "read_table", "split_unit"]

_BY_WRITETABLE = 'write its columns by writetable(table(t, Fz), "name.csv")'
_AS_CSV = "save its sheet as CSV"
_OTHERS = {  # first bytes, kind and remedy of files that are no tables here
    b"MATLAB 5.0 MAT-file": ("a MATLAB file", _BY_WRITETABLE),
    b"MATLAB 7.3 MAT-file": ("a MATLAB file", _BY_WRITETABLE),
    b"\x89HDF\r\n": ("an HDF5 file", "write its columns by numpy.savetxt, with a heading for each"),
    b"\x93NUMPY": (
        "an array of numpy",
        "write it by numpy.savetxt, with a heading for each column",
    ),
    b"PK\x03\x04": ("a workbook (.xlsx, .ods) or another zip file", _AS_CSV),
    b"\xd0\xcf\x11\xe0": ("a workbook of an older Excel (.xls)", _AS_CSV),
}


def read_table(
    path: str | Path,
    names: Sequence[str] | None = None,
    skip_rows: int = 0,
    delimiter: str | None = None,
) -> LabTable:
    """Read a table of measured values.

    Raises `FileFormatError` if the file cannot be read, has more than 64 MB or no table of 8
    samples, or a needed column is missing or has a cell that is no number; `MissingExtraError`
    without the extra ``calibration``, for LVM and TDMS.

    Parameters
    ----------
    path : path-like
        ``.tdms``, ``.lvm`` (with its header), or text of any name: headings above numbers, with or
        without a row of units, decimal points or commas, clock times.
    names : sequence of str, optional
        Columns that are needed; of text, all that are numbers or times if not given.
    skip_rows : int
        Lines to leave out above the headings.
    delimiter : str, optional
        Between two columns; found where it is not given.
    """
    data = read_bytes(path, LARGEST_TABLE_BYTES)
    for first, (kind, remedy) in _OTHERS.items():
        if data.startswith(first):
            raise FileFormatError(f"{path}: expected text, LVM or TDMS, got {kind}; {remedy}")
    is_tdms = data.startswith(b"TDSm")
    text = "" if is_tdms else _decoded(data)
    if not is_tdms and not text.startswith("LabVIEW Measurement"):
        return of_text(path, text, names, skip_rows, delimiter)
    table = of_tdms(path, data) if is_tdms else of_lvm(path, text)
    if not any(len(values) >= FEWEST_SAMPLES for values in table.columns.values()):
        raise FileFormatError(f"{path}: expected {FEWEST_SAMPLES} samples or more")
    table.all_named(names or (), path)
    return table


def _decoded(data: bytes) -> str:
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return data.decode("utf-16", errors="replace")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:  # an instrument's program on Windows
        return data.decode("cp1252", errors="replace")
