"""The surface file: safetensors with one JSON string; nothing in it can run."""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save as to_bytes
from torch import Tensor

from haptix.errors import FileFormatError
from haptix.surface.grid import Axis
from haptix.surface.surface import FrictionSurface

FORMAT = "haptix-friction-surface"
VERSION = 1
_TENSORS = ("normal_force_n", "frequency_hz", "h0_m", "drive", "mu", "voltage_end_v")


def save_surface(surface: FrictionSurface, path: Path) -> None:
    """Write to a temporary file beside `path`, then move it there."""
    tensors = {axis.name: axis.nodes for axis in surface.axes}
    tensors |= {
        "drive": surface.drive,
        "mu": surface.mu_table,
        "voltage_end_v": surface.voltage_end_v,
    }
    tensors = {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}
    header = {
        "format": FORMAT,
        "version": VERSION,
        "axes": ["normal_force_n", "frequency_hz", "h0_m", "drive"],
        "units": {"normal_force_n": "N", "frequency_hz": "Hz", "h0_m": "m", "voltage_end_v": "V"},
        "drive": "(voltage_v / voltage_end_v)^2; mu does not fall along it",
        "voltage_limit_v": surface.voltage_limit_v,
        "info": dict(surface.info),
    }
    header["sha256"] = _digest(header, tensors)
    data = to_bytes(tensors, metadata={"haptix": json.dumps(header, sort_keys=True)})
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=path.name, suffix=".part")
    except OSError as error:
        raise FileFormatError(f"cannot write {path}: {error.strerror}") from None
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
        Path(temporary).replace(path)
    except OSError as error:
        raise FileFormatError(f"cannot write {path}: {error.strerror}") from None
    finally:
        Path(temporary).unlink(missing_ok=True)


def load_surface(path: Path) -> FrictionSurface:
    """Read a file, or say what is wrong with it; never returns half a surface."""
    if not path.is_file():
        raise FileFormatError(f"no surface file at {path}: build one with `haptix build`")
    try:
        with safe_open(path, framework="pt") as file:
            header = json.loads((file.metadata() or {}).get("haptix", "null"))
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except (SafetensorError, OSError, ValueError) as error:
        raise FileFormatError(f"{path} is not a friction surface, or is damaged: {error}") from None
    if not isinstance(header, dict) or header.get("format") != FORMAT:
        raise FileFormatError(
            f"{path} is a safetensors file, but not a friction surface; build one with "
            "`haptix build`"
        )
    if header.get("version") != VERSION:
        raise FileFormatError(
            f"{path}: expected surface version {VERSION}, got {header.get('version')!r}; "
            "update haptix, or build the surface again"
        )
    if set(tensors) != set(_TENSORS) or header.pop("sha256", "") != _digest(header, tensors):
        raise FileFormatError(f"{path} is damaged: its numbers do not match their checksum")
    return _assemble(path, header, tensors)


def _assemble(path: Path, header: dict[str, Any], tensors: dict[str, Tensor]) -> FrictionSurface:
    axes = (
        Axis("normal_force_n", tensors["normal_force_n"]),
        Axis("frequency_hz", tensors["frequency_hz"]),
        Axis("h0_m", tensors["h0_m"]),
    )
    try:
        return FrictionSurface(
            axes,
            tensors["drive"],
            tensors["mu"],
            tensors["voltage_end_v"],
            float(header["voltage_limit_v"]),
            dict(header["info"]),
        )
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise FileFormatError(f"{path} is damaged: {error}") from None


def _digest(header: dict[str, Any], tensors: dict[str, Tensor]) -> str:
    digest = hashlib.sha256(json.dumps(header, sort_keys=True).encode())
    for name in sorted(tensors):
        tensor = tensors[name].contiguous()
        digest.update(f"{name} {tensor.dtype} {tuple(tensor.shape)}".encode())
        digest.update(tensor.view(torch.uint8).numpy().tobytes() if tensor.numel() else b"")
    return digest.hexdigest()
