"""Export to NetCDF: the surface's numbers under their names and units, for other programs."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

from haptix.errors import HaptixError
from haptix.files import write_whole
from haptix.surface.surface import FrictionSurface

if TYPE_CHECKING:
    import xarray
    from torch import Tensor

_PLACES = ("normal_force_n", "frequency_hz", "h0_m")
_ATTRIBUTES = {
    "normal_force_n": {"units": "N", "long_name": "normal force"},
    "frequency_hz": {"units": "Hz", "long_name": "drive frequency"},
    "h0_m": {"units": "m", "long_name": "effective thickness d1/eps1 of the insulator"},
    "drive": {"units": "1", "long_name": "square of the voltage over the pull-in voltage"},
    "mu": {"units": "1", "long_name": "friction coefficient"},
    "pull_in_voltage_v": {"units": "V", "long_name": "amplitude at which the contact snaps in"},
    "breakdown_voltage_v": {
        "units": "V",
        "long_name": "amplitude at which the gap or the insulator breaks down",
    },
}


def export_netcdf(surface: FrictionSurface, path: Path) -> None:
    """Write a surface as NetCDF-4, whole or not at all; a file of that name is replaced.

    Parameters
    ----------
    surface : FrictionSurface
        Becomes ``mu(normal_force_n, frequency_hz, h0_m, drive)``, with ``pull_in_voltage_v`` and
        ``breakdown_voltage_v`` over the first three. A quantity that it was built without is a
        dimension of the one value NaN. Its ``info`` is the attribute ``haptix_info``, as JSON.
    path : Path
        File to write, such as ``my.nc``.

    Raises
    ------
    HaptixError
        If xarray or h5netcdf are not installed.
    FileFormatError
        If the file cannot be written.
    """
    dataset = _dataset(surface)
    # By default xarray would mark NaN as missing, which makes no sense in a table without holes.
    encoding = {str(name): {"_FillValue": None} for name in dataset.variables}
    # Made in memory, since HDF5 does not raise when a disk is full.
    data = dataset.to_netcdf(engine="h5netcdf", encoding=encoding)
    write_whole(path, data)


def _dataset(surface: FrictionSurface) -> xarray.Dataset:
    try:
        import h5netcdf  # noqa: F401  # by which xarray writes
        import xarray
    except ImportError as error:
        raise HaptixError(
            f"export to NetCDF: expected xarray and h5netcdf, but {error.name} is not installed; "
            "run: pip install 'haptix-electrovibration[netcdf]'"
        ) from None
    table = surface.table

    def variable(name: str, dims: tuple[str, ...], values: Tensor) -> xarray.Variable:
        return xarray.Variable(dims, values.detach().cpu().numpy(), _ATTRIBUTES[name])

    axes = {name: axis.nodes for name, axis in zip(_PLACES, table.axes, strict=True)}
    axes["drive"] = table.drive
    return xarray.Dataset(
        {
            "mu": variable("mu", (*_PLACES, "drive"), table.mu),
            "pull_in_voltage_v": variable("pull_in_voltage_v", _PLACES, table.pull_in_voltage_v),
            "breakdown_voltage_v": variable(
                "breakdown_voltage_v", _PLACES, table.breakdown_voltage_v
            ),
        },
        {name: variable(name, (name,), nodes) for name, nodes in axes.items()},
        {
            "title": "haptix friction surface",
            "interpolation": "1/mu is linear in drive, and columns of it, as ln of the voltages, "
            "linear in the logarithms of normal_force_n, frequency_hz and h0_m",
            "voltage_limit_v": table.voltage_limit_v,
            "ends_at_breakdown": int(table.ends_at_breakdown),  # NetCDF has no truth values
            "haptix_info": json.dumps(dict(surface.info), sort_keys=True),
        },
    )
