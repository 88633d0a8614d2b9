"""Export to NetCDF: the numbers of a surface with names and units, for other programs."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from haptix.errors import HaptixError
from haptix.files import write_whole
from haptix.surface.axes import AXES, AXIS_NAMES
from haptix.surface.interpolant import Interpolant

if TYPE_CHECKING:
    import xarray
    from torch import Tensor

_ATTRIBUTES = {
    **{axis.name: {"units": axis.unit, "long_name": axis.text} for axis in AXES},
    "drive": {"units": "1", "long_name": "square of the voltage over the pull-in voltage"},
    "mu": {"units": "1", "long_name": "friction coefficient"},
    "pull_in_voltage_v": {"units": "V", "long_name": "amplitude at which the contact snaps in"},
    "breakdown_voltage_v": {
        "units": "V",
        "long_name": "amplitude at which the gap or the insulator breaks down",
    },
}


def export_netcdf(table: Interpolant, info: Mapping[str, Any], path: Path) -> None:
    """Write a surface as NetCDF-4, whole or not at all; a file of that name is replaced.

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

    Raises
    ------
    HaptixError
        If xarray or h5netcdf are not installed.
    FileFormatError
        If the file cannot be written.
    """
    dataset = _dataset(table, info)
    # By default xarray marks NaN as missing, but this table has no holes.
    encoding = {str(name): {"_FillValue": None} for name in dataset.variables}
    # Made in memory, since HDF5 does not raise when a disk is full.
    data = dataset.to_netcdf(engine="h5netcdf", encoding=encoding)
    write_whole(path, data)


def _dataset(table: Interpolant, info: Mapping[str, Any]) -> xarray.Dataset:
    try:
        import h5netcdf  # noqa: F401  # by which xarray writes
        import xarray
    except ImportError as error:
        raise HaptixError(
            f"export to NetCDF: expected xarray and h5netcdf, but {error.name} is not installed; "
            "run: pip install 'haptix-electrovibration[netcdf]'"
        ) from None

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
            "voltage_limit_v": table.voltage_limit_v,
            "ends_at_breakdown": int(table.ends_at_breakdown),  # NetCDF has no truth values
            "haptix_info": json.dumps(dict(info), sort_keys=True),
        },
    )
