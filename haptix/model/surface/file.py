"""Files of a surface: safetensors with one JSON string, NetCDF, and the key in the cache."""

from __future__ import annotations

import json
import os
import zlib
from collections.abc import Collection, Mapping
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save as to_bytes
from torch import Tensor

from haptix.base.errors import FileFormatError, from_extra
from haptix.base.files import digest, parse_json, reading, write_whole
from haptix.base.version import __version__, code_digest
from haptix.model.friction import ContactModel
from haptix.model.perception.thresholds import WEBER_FRACTION
from haptix.model.states import plain_array
from haptix.model.status import Status
from haptix.model.surface.axes import AXES, AXIS_NAMES, Axes, read_ranges
from haptix.model.surface.interpolant import Interpolant
from haptix.model.surface.tolerance import Tolerance

if TYPE_CHECKING:
    import xarray
    from torch import Tensor


FORMAT = "haptix-friction-surface"
VERSION = "2.0"
"""Major and minor: readers refuse another major, and read any minor."""

_SCHEMA = {
    "format": FORMAT,
    "version": VERSION,
    "axes": [*AXIS_NAMES, "drive"],
    "units": {
        **{axis.name: axis.unit for axis in AXES},
        "drive": "1",
        "unit_v": "V",
        "voltage_limit_v": "V",
    },
    "monotone_axis": "drive",
    "columns": "-1/mu at each drive, not falling; ln(pull-in voltage / unit_v); "
    "ln(breakdown voltage / unit_v)",
    "drive": "(voltage_v / pull-in voltage)^2",
    "interpolation": f"linear in the logarithms of {', '.join(AXIS_NAMES[:-1])} and "
    f"{AXIS_NAMES[-1]}, for whole columns; then linear in drive",
}


LARGEST_BYTES = 64_000_000
"""Default limit of the size of a surface."""

_LARGEST_FILE_BYTES = 4_000_000_000
_NUMBERS = ("response_hz_per_mm_per_s", "screen_h0_m", "pull_past_breakdown")
_INFO = {*_NUMBERS, "model", "model_hash", "profiles", "notes", "accuracy", "intervals"}

Info = Mapping[str, Any]
"""Inputs and accuracy of a surface; plain values."""


def save_table(table: Interpolant, info: Info, path: Path) -> None:
    """Write a surface, whole or not at all."""
    tensors = {axis.name: axis.nodes for axis in table.axes}
    tensors |= {"drive": table.drive, "columns": table.columns}
    tensors = {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}
    header = {
        **_SCHEMA,
        "unit_v": table.unit_v,
        "voltage_limit_v": table.voltage_limit_v,
        "limited_by": table.limited_by.name,
        "info": dict(info),
        "crc32": {name: _checksum(tensor) for name, tensor in tensors.items()},
    }
    header["sha256"] = digest(header)
    data = to_bytes(tensors, metadata={"haptix": json.dumps(header, sort_keys=True)})
    write_whole(path, data)


def load_table(path: Path, model: ContactModel | None = None) -> tuple[Interpolant, Info]:
    """Read a file into memory.

    Raises `FileFormatError` if the file is missing, foreign, damaged, of a later version or of
    another model.
    """
    header, tensors = _read(path)
    if not isinstance(header, dict) or header.get("format") != FORMAT:
        raise FileFormatError(
            f"{path} is a safetensors file, but not a friction surface; build one with "
            "`haptix build`"
        )
    major = VERSION.split(".")[0]
    if str(header.get("version")).split(".")[0] != major:
        raise FileFormatError(
            f"{path}: expected surface version {major}, got {header.get('version')!r}; "
            "update haptix, or build the surface again"
        )
    stored = header.pop("sha256", "")
    if stored != digest(header):
        raise FileFormatError(f"{path} is damaged: its description does not match its checksum")
    with reading(path, "a friction surface"):
        if {name: _checksum(tensor) for name, tensor in tensors.items()} != header.get("crc32"):
            raise FileFormatError(f"{path} is damaged: its numbers do not match their checksum")
        table, info = _assemble(path, header, tensors)
        _check_model(path, info, model)
        return table, info


def _read(path: Path) -> tuple[Any, dict[str, Tensor]]:
    while True:
        if not path.is_file():
            raise FileFormatError(f"no surface file at {path}: build one with `haptix build`")
        before = path.stat()
        if before.st_size > _LARGEST_FILE_BYTES:
            raise FileFormatError(
                f"{path}: expected a surface of at most {_LARGEST_FILE_BYTES / 1e9:g} GB, got "
                f"{before.st_size / 1e9:.3g} GB; build it for less, or for a larger error"
            )
        try:
            with safe_open(path, framework="pt") as file:
                header = parse_json((file.metadata() or {}).get("haptix", "null"))
                # Copies: what the library maps would follow a program that writes into the file,
                # unchecked, and end this process where that makes the file shorter.
                tensors = {name: file.get_tensor(name).clone() for name in file.keys()}  # noqa: SIM118
        except (SafetensorError, OSError, RuntimeError, ValueError) as error:
            # The library opens the file twice. If another process replaced it in between, try
            # again.
            if _is_same(path, before):
                raise FileFormatError(
                    f"{path} is not a friction surface, or is damaged: {error}"
                ) from None
        else:
            if _is_same(path, before):
                return header, tensors


def _is_same(path: Path, before: os.stat_result) -> bool:
    try:
        now = path.stat()
    except OSError:
        return True  # the file is gone, so that trying again is of no use
    return (now.st_ino, now.st_mtime_ns) == (before.st_ino, before.st_mtime_ns)


def _assemble(path: Path, header: Info, tensors: dict[str, Tensor]) -> tuple[Interpolant, Info]:
    if any(header.get(key) != _SCHEMA[key] for key in ("axes", "units", "monotone_axis")):
        raise FileFormatError(
            f"{path}: expected the axes {', '.join(_SCHEMA['axes'])}, got "
            f"{header.get('axes')!r:.99}, or other units; build the surface again"
        )
    table = Interpolant(
        Axes.of(tensors),
        tensors["drive"],
        tensors["columns"],
        float(header["unit_v"]),
        float(header["voltage_limit_v"]),
        Status[header["limited_by"]],
    )
    info = dict(header["info"])
    if missing := _INFO - info.keys():
        raise FileFormatError(
            f"{path}: expected {', '.join(sorted(missing))} as well; build the surface again"
        )
    for name in _NUMBERS:
        float(info[name])
    _check_table(path, table, tensors.values())
    return table, info


def _check_table(source: object, table: Interpolant, tensors: Collection[Tensor]) -> None:
    """Raise `FileFormatError` if a table is none that a build makes."""
    shape = (*table.axes.shape, len(table.drive) + 2)
    sound = {
        "columns have the shape of the axes": tuple(table.columns.shape) == shape,
        "all numbers are of one precision": len({t.dtype for t in tensors}) == 1
        and table.columns.dtype in (torch.float32, torch.float64),
        "nodes increase": all(map(_increases, (*(axis.nodes for axis in table.axes), table.drive))),
        "axes are above 0": not any(bool((axis.nodes <= 0).any()) for axis in table.axes),
        "friction is finite and above 0": _is_friction(table.columns[..., :-2]),
        "limits are voltages": not bool((table.columns[..., -2:] == -inf).any())
        and not bool(table.columns.isnan().any()),
        "voltages are above 0": 0 < table.unit_v < inf and 0 < table.voltage_limit_v < inf,
    }
    wrong = [rule for rule, holds in sound.items() if not holds]
    if wrong:
        raise FileFormatError(f"{source}: expected that {'; '.join(wrong)}; build it again")


def _is_friction(columns: Tensor) -> bool:
    """Whether all of -1/mu are finite and below 0."""
    return bool((columns.isfinite() & (columns < 0)).all())


def _increases(nodes: Tensor) -> bool:
    """Whether nodes increase; neighbours may be equal, as single precision can make them."""
    if nodes.ndim != 1 or len(nodes) < 2:
        return nodes.ndim == 1 and len(nodes) == 1
    is_row = nodes.isfinite().all() & (nodes.diff() >= 0).all() & (nodes[-1] > nodes[0])
    return bool(is_row)


def _check_model(path: Path, info: Info, model: ContactModel | None) -> None:
    stored = info["model_hash"]
    if stored != digest(info["model"]):
        raise FileFormatError(f"{path} is damaged: its model does not match its hash")
    if model is None:
        return
    if stored != digest(model.describe()):
        raise FileFormatError(
            f"{path} was built from another model than the one given; build it again, or load it "
            "without naming a model"
        )


def _checksum(tensor: Tensor) -> int:
    """CRC-32 of the bytes: it reveals damage, and is fast enough for every opening of a file."""
    return zlib.crc32(tensor.reshape(-1).contiguous().view(torch.uint8).numpy().data)


_ATTRIBUTES = {
    **{axis.name: {"units": axis.unit, "long_name": axis.text} for axis in AXES},
    "drive": {"units": "1", "long_name": "square of the voltage over the pull-in voltage"},
    "mu": {
        "units": "1",
        "long_name": "friction coefficient",
        "comment": "not for interp: mu is not linear between its nodes; see the file's attribute "
        "interpolation, or ask haptix.FrictionSurface.from_xarray",
    },
    "pull_in_voltage_v": {"units": "V", "long_name": "amplitude at which the contact snaps in"},
    "breakdown_voltage_v": {
        "units": "V",
        "long_name": "amplitude of breakdown, or of what limited_by says",
    },
}


def export_netcdf(table: Interpolant, info: Mapping[str, Any], path: Path) -> None:
    """Write a surface as NetCDF-4, whole or not at all; a file of that name is replaced.

    Raises `MissingExtraError` if xarray or h5netcdf are not installed; `FileFormatError` if the
    file cannot be written.

    Parameters
    ----------
    table : Interpolant
        Becomes ``mu(normal_force_n, frequency_hz, h0_m, drive)``, with ``pull_in_voltage_v`` and
        ``breakdown_voltage_v`` over all axes but the drive. An axis that the surface was built
        without has the single value NaN.
    info : mapping
        Plain values; becomes the attribute ``haptix_info``, as JSON.
    path : Path
        File to write, such as ``my.nc``.
    """
    dataset = as_dataset(table, info)
    # As characters, NC_CHAR: Octave's reader ends at an attribute of the newer kind NC_STRING.
    for attributes in (dataset.attrs, *(part.attrs for part in dataset.variables.values())):
        attributes.update(
            {
                name: np.bytes_(value.encode())
                for name, value in attributes.items()
                if isinstance(value, str)
            }
        )
    # By default xarray marks NaN as missing, but this table has no holes.
    encoding = {str(name): {"_FillValue": None} for name in dataset.variables}
    # Made in memory, since HDF5 does not raise when a disk is full.
    data = dataset.to_netcdf(engine="h5netcdf", encoding=encoding)
    write_whole(path, data)


def as_dataset(table: Interpolant, info: Mapping[str, Any]) -> xarray.Dataset:
    """Return a surface as arrays with names and units, listed by `export_netcdf`."""
    with from_extra("netcdf"):
        import h5netcdf  # noqa: F401  # xarray writes with it
        import xarray

    def variable(name: str, dims: tuple[str, ...], values: Tensor) -> xarray.Variable:
        return xarray.Variable(dims, values.detach().cpu().numpy(), _ATTRIBUTES[name])

    axes = {axis.name: axis.nodes for axis in table.axes}
    axes["drive"] = table.drive
    return xarray.Dataset(
        {
            "mu": variable("mu", (*AXIS_NAMES, "drive"), table.mu),
            **{
                name: variable(name, AXIS_NAMES, getattr(table, name))
                for name in ("pull_in_voltage_v", "breakdown_voltage_v")
            },
        },
        {name: variable(name, (name,), nodes) for name, nodes in axes.items()},
        {
            "title": "haptix friction surface",
            "interpolation": "1/mu is linear in drive, and columns of it, as ln of the voltages, "
            f"linear in the logarithms of {', '.join(AXIS_NAMES[:-1])} and {AXIS_NAMES[-1]}",
            "unit_v": table.unit_v,
            "voltage_limit_v": table.voltage_limit_v,
            "limited_by": table.limited_by.name,
            "haptix_info": json.dumps(dict(info), sort_keys=True),
        },
    )


def of_dataset(dataset: xarray.Dataset) -> tuple[Interpolant, Info]:
    """Return what `as_dataset` made a dataset of, or raise `FileFormatError`."""
    with reading("dataset", "a friction surface of haptix"):
        about = {  # characters, or texts
            name: value.decode() if isinstance(value, bytes) else value
            for name, value in dataset.attrs.items()
        }
        values = {
            str(name): torch.tensor(plain_array(dataset[name].values)) for name in dataset.variables
        }
        unit_v, limit_v = float(about["unit_v"]), float(about["voltage_limit_v"])
        ends_v = [values[name] for name in ("pull_in_voltage_v", "breakdown_voltage_v")]
        columns = torch.cat([-1 / values["mu"], (torch.stack(ends_v, -1) / unit_v).log()], -1)
        limited_by = Status[about["limited_by"]]
        table = Interpolant(Axes.of(values), values["drive"], columns, unit_v, limit_v, limited_by)
        _check_table("dataset", table, [values["mu"], values["drive"]])
        return table, json.loads(about["haptix_info"])


def surface_key(
    model: ContactModel,
    scene: Any,
    tolerance: Tolerance | float | str,
    largest_bytes: int = LARGEST_BYTES,
    past_limits: bool = False,
) -> str:
    """Hash of everything that determines a surface's numbers; the name of its cache entry.

    Parameters
    ----------
    model, scene, tolerance, largest_bytes, past_limits
        As in `FrictionSurface.build`.

    Examples
    --------
    >>> import haptix
    >>> model = haptix.ContactModel(haptix.Finger(), haptix.Screen())
    >>> keys = {surface_key(model, {"normal_force_n": (0.1, 1.0)}, jnd) for jnd in (0.01, 0.02)}
    >>> len(keys)  # another tolerance, another file
    2
    """
    return digest(
        {
            "haptix": __version__,
            "code": code_digest("haptix/base", "haptix/model"),
            "model": model.describe(),
            "response_hz_per_mm_per_s": model.finger.response_hz_per_mm_per_s,
            "ranges": read_ranges(model, scene),
            "tolerance": str(Tolerance.read(tolerance)),
            "jnd": WEBER_FRACTION,
            "largest_bytes": largest_bytes,
            **({"past_limits": True} if past_limits else {}),
        }
    )
