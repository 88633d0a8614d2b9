"""A GPU that is pretended on the CPU: what a real one refuses is an error here too.

Tensors made with ``device="cuda"`` are of a subclass that says it is on the GPU, cannot be turned
into numpy without ``.cpu()``, and does not mix with tensors of the CPU that are more than a number.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from typing import Any

import torch
from torch import Tensor
from torch.overrides import TorchFunctionMode

CUDA = torch.device("cuda", 0)

_MAY_MIX = {"__getitem__", "__setitem__", "copy_", "index_put_", "to"}  # CPU indices are allowed
_BACK = {"cpu", "tolist", "item", "__float__", "__int__", "__bool__", "__complex__", "__index__"}
_SYNCHRONISES = _BACK - {"cpu", "tolist"}


class OnGpu(Tensor):
    """A tensor on the pretended GPU."""

    def numpy(self, **_: Any) -> Any:
        raise TypeError("can't convert cuda:0 device type tensor to numpy; use Tensor.cpu() first")

    def __array__(self, *_: Any, **__: Any) -> Any:
        return self.numpy()


class PretendGpu(TorchFunctionMode):
    """Within it, tensors can be on the device "cuda"; `synchronised` counts what waits for it."""

    def __init__(self) -> None:
        super().__init__()
        self.synchronised: Counter[str] = Counter()

    def __torch_function__(
        self,
        func: Callable[..., Any],
        types: Iterable[type],
        args: tuple[Any, ...] = (),
        kwargs: dict[str, Any] | None = None,
    ) -> Any:
        if func is torch.device:
            return func(*args, **(kwargs or {}))
        kwargs = dict(kwargs or {})
        name = _name(func)
        given = [t for t in _flat((args, kwargs)) if isinstance(t, Tensor)]
        on_gpu = any(isinstance(t, OnGpu) for t in given)
        if name in ("device", "is_cuda", "get_device", "is_cpu") and on_gpu:
            return {"device": CUDA, "is_cuda": True, "is_cpu": False, "get_device": 0}[name]
        if name in ("numpy", "__array__") and on_gpu:
            raise TypeError("can't convert cuda:0 device type tensor to numpy; use .cpu() first")
        asked = [d for d in (*args, *kwargs.values()) if _is_device(d)]
        to_gpu = any(torch.device(d).type == "cuda" for d in asked)
        to_cpu = name in _BACK or (bool(asked) and not to_gpu)
        mixed = [t for t in given if not isinstance(t, OnGpu) and t.ndim > 0]
        if on_gpu and mixed and name not in _MAY_MIX and not asked:
            raise RuntimeError(f"{name}: expected all tensors to be on the same device")
        if name in _SYNCHRONISES and on_gpu:
            self.synchronised[name] += 1
        args = tuple("cpu" if _is_device(a) else a for a in args)
        kwargs = {k: "cpu" if _is_device(v) else v for k, v in kwargs.items()}
        with torch._C.DisableTorchFunctionSubclass():
            found = func(*args, **kwargs)
        if to_cpu:
            return _as(found, Tensor)
        return _as(found, OnGpu) if to_gpu or on_gpu else found


def _name(func: Callable[..., Any]) -> str:
    name = getattr(func, "__name__", "")
    if name in ("__get__", "__set__"):  # an attribute such as Tensor.device
        return str(getattr(getattr(func, "__self__", None), "__name__", name))
    return name


def _is_device(value: Any) -> bool:
    return isinstance(value, torch.device) or (isinstance(value, str) and value in ("cpu", "cuda"))


def _flat(values: Any) -> Iterable[Any]:
    if isinstance(values, tuple | list):
        for value in values:
            yield from _flat(value)
    elif isinstance(values, dict):
        yield from _flat(tuple(values.values()))
    else:
        yield values


def _as(found: Any, kind: type[Tensor]) -> Any:
    if isinstance(found, Tensor):
        return found if type(found) is kind else found.as_subclass(kind)
    if isinstance(found, tuple):
        each = [_as(one, kind) for one in found]
        return (
            type(found)(each)
            if type(found) is not tuple and hasattr(type(found), "n_fields")
            else tuple(each)
        )
    return [_as(one, kind) for one in found] if isinstance(found, list) else found
