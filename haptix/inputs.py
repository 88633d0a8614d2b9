"""Checks of tensors: the arguments of solvers."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor

from haptix.errors import InputError


def checked(
    name: str, value: Any, expected: str, device: torch.device, zero: bool = False
) -> Tensor:
    """Return a float64 tensor of finite values above 0, or with `zero` of 0 and more.

    Raises
    ------
    InputError
        Naming the quantity, what was `expected` and the first wrong value.
    """
    try:
        tensor = torch.as_tensor(value, dtype=torch.float64, device=device)
    except (TypeError, ValueError, RuntimeError):
        raise InputError(f"{name}: expected numbers {expected}, got {value!r}") from None
    good = tensor.isfinite() & ((tensor >= 0) if zero else (tensor > 0))
    if tensor.numel() == 0 or not bool(good.all()):
        bad = tensor[~good].reshape(-1)
        got = f"{float(bad[0]):g}" if len(bad) else "an empty tensor"
        raise InputError(f"{name}: expected finite values {expected}, got {got}")
    return tensor


def broadcast_shape(*tensors: Tensor) -> torch.Size:
    """Return the shape to which the tensors broadcast, or raise `InputError`."""
    try:
        # torch's own function would import its compiler first, which takes half a second.
        return torch.Size(np.broadcast_shapes(*(tensor.shape for tensor in tensors)))
    except ValueError:
        raise InputError(
            "expected inputs that broadcast together, got shapes "
            f"{', '.join(str(tuple(tensor.shape)) for tensor in tensors)}"
        ) from None
