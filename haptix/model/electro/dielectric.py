"""Dielectric of the stratum corneum: tables, and the sums of relaxations of whole skin."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from types import MappingProxyType
from typing import Annotated, Any, Self

import torch
from pydantic import (
    BeforeValidator,
    Discriminator,
    Field,
    NonNegativeFloat,
    PositiveFloat,
    Tag,
    model_validator,
)
from torch import Tensor

from haptix.base.documents import Part

VACUUM_PERMITTIVITY = 8.8541878128e-12
"""eps0 [F/m], CODATA 2018."""

_NOISE = 1.05  # a measured column may rise by this factor from row to row

# A scale of 1 is not written: files and hashes from before this field existed stay valid.
_Scale = Annotated[PositiveFloat, Field(exclude_if=lambda scale: scale == 1)]


@dataclass(frozen=True)
class MonotoneCubic:
    """A C1 cubic that rises and falls only where its values do, and is constant beyond its ends.

    Source of the slopes: Fritsch & Butland, SIAM J. Sci. Stat. Comput. 5, 300 (1984). They are 0 at
    the ends, so that there is no corner there.
    """

    nodes: Tensor
    values: Tensor
    slopes: Tensor

    @classmethod
    def through(cls, nodes: Tensor, values: Tensor) -> MonotoneCubic:
        """Connect `values`, shape (nodes, columns), at increasing `nodes`."""
        width = nodes.diff()[:, None]
        rise = values.diff(dim=0) / width
        before, after = width[:-1] + 2 * width[1:], 2 * width[:-1] + width[1:]
        turns = rise[:-1] * rise[1:] <= 0
        left, right = (r.masked_fill(turns, 1.0) for r in (rise[:-1], rise[1:]))
        inner = ((before + after) / (after / left + before / right)).masked_fill(turns, 0.0)
        end = torch.zeros_like(values[:1])
        return cls(nodes, values, torch.cat([end, inner, end])[: len(nodes)])

    def __call__(self, x: Tensor) -> Tensor:
        """Values at `x` of any shape, with the columns as the last axis."""
        if len(self.nodes) == 1:
            return self.values[0].expand(*x.shape, -1)
        x = x.clamp(self.nodes[0], self.nodes[-1])
        cell = torch.searchsorted(self.nodes[1:-1], x.detach().contiguous(), right=True)
        width = self.nodes.diff()[cell][..., None]
        t = (x[..., None] - self.nodes[cell][..., None]) / width
        low, high = self.values[cell], self.values[cell + 1]
        rise = high - low
        a, b = self.slopes[cell] * width - rise, rise - self.slopes[cell + 1] * width
        return low + t * (rise + (1 - t) * (a * (1 - t) + b * t))


class SkinDielectric(Part):
    """Permittivity and resistivity of the stratum corneum against frequency.

    ``eps2(w) = eps_SC + i / (w eps0 rho_SC)`` (paper, Eq. 4), by a monotone cubic over logarithms;
    beyond its ends the table keeps its last values. The built-in table is an order of magnitude
    only, and its `source` says so.

    Skin at these frequencies shows relaxations only. By the relations of Kramers and Kronig neither
    permittivity nor resistivity then rises with frequency, and a table in which one does is
    rejected (a rise of up to 5 % from row to row counts as noise).

    Parameters
    ----------
    frequency_hz, permittivity, resistivity_ohm_m : tuple of float
        Columns of the table, frequency increasing. A single row means constants.
    scale : float
        Factor on the skin's effective thickness ``d2/eps2``, which a calibration may fit: 2 for a
        skin that insulates twice as much as the table says.
    is_placeholder : bool
        True while the numbers are not measured ones.
    source : str
        Where the numbers come from.

    Examples
    --------
    >>> skin = SkinDielectric()
    >>> frequency_hz = torch.tensor([100.0, 1e5], dtype=torch.float64)
    >>> low, high = skin.relative_permittivity(frequency_hz).abs()
    >>> bool(low > high)
    True
    """

    frequency_hz: tuple[PositiveFloat, ...] = (1e1, 1e2, 1e3, 1e4, 1e5, 1e6)
    permittivity: tuple[PositiveFloat, ...] = (1e4, 3e3, 1.5e3, 1e3, 6e2, 3e2)
    resistivity_ohm_m: tuple[PositiveFloat, ...] = (1e5, 1e5, 3e4, 8e3, 2e3, 3e2)
    scale: _Scale = 1.0
    is_placeholder: bool = True
    source: str = "order of magnitude after Yamamoto & Yamamoto (1976); not measured values"

    @model_validator(mode="after")
    def _columns_match(self) -> Self:
        rows = len(self.frequency_hz)
        if not rows or rows != len(self.permittivity) or rows != len(self.resistivity_ohm_m):
            raise ValueError("expected three columns of one length, 1 or more")
        if list(self.frequency_hz) != sorted(set(self.frequency_hz)):
            raise ValueError("expected frequencies in increasing order")
        for name in ("permittivity", "resistivity_ohm_m"):
            for row, (value, following) in enumerate(pairwise(getattr(self, name)), start=1):
                if following > _NOISE * value:
                    raise ValueError(
                        f"{name}: expected a causal table, whose {name.split('_')[0]} does not "
                        f"rise with frequency, but it rises from {value:g} in row {row} to "
                        f"{following:g}; check the rows, or drop them"
                    )
        return self

    def relative_permittivity(self, frequency_hz: Tensor) -> Tensor:
        """Complex eps2 at frequencies [Hz] of any shape, the scale included."""
        log_f = torch.log(frequency_hz)
        nodes, *columns = log_f.new_tensor(
            [self.frequency_hz, self.permittivity, self.resistivity_ohm_m]
        ).log()
        permittivity, resistivity = MonotoneCubic.through(nodes, torch.stack(columns, -1))(
            log_f
        ).unbind(-1)
        loss = 1 / (2 * torch.pi * frequency_hz * VACUUM_PERMITTIVITY * torch.exp(resistivity))
        return torch.complex(torch.exp(permittivity), loss) / self.scale


class ColeCole(Part):
    """Permittivity as a sum of relaxations after Cole and Cole.

    ``eps2(w) = eps_inf + sum D / (1 + (i w tau)^(1-a)) + sigma / (i w eps0)``. Here a loss is
    positive, and the value is the complex conjugate of this.

    Parameters
    ----------
    infinite_permittivity : float
        eps_inf, 1 or more.
    relaxations : tuple of (float, float, float)
        D, tau [s] and a of each, a in [0, 1).
    conductivity_s_per_m : float
        sigma [S/m].
    scale, is_placeholder, source
        As for `SkinDielectric`.
    """

    infinite_permittivity: Annotated[float, Field(ge=1)]
    relaxations: tuple[
        tuple[PositiveFloat, PositiveFloat, Annotated[float, Field(ge=0, lt=1)]], ...
    ]
    conductivity_s_per_m: NonNegativeFloat
    scale: _Scale = 1.0
    is_placeholder: bool = True
    source: str = ""

    def relative_permittivity(self, frequency_hz: Tensor) -> Tensor:
        """Complex eps2 at frequencies [Hz] of any shape, the scale included."""
        omega = 2 * torch.pi * frequency_hz
        loss = self.conductivity_s_per_m / (omega * VACUUM_PERMITTIVITY)
        total = torch.complex(torch.full_like(loss, self.infinite_permittivity), loss)
        for drop, time_s, broadening in self.relaxations:
            power = 1 - broadening
            turn = omega.new_tensor(-torch.pi / 2 * power)  # of (-i)^power
            spread = (omega * time_s) ** power
            total = total + drop / (1 + torch.polar(spread, turn.expand_as(spread)))
        return total / self.scale


_WHOLE_SKIN = (
    "Gabriel, Lau, Gabriel, Phys. Med. Biol. 41, 2271 (1996), {} skin; of whole skin, which "
    "conducts better: it bounds the impedance of the stratum corneum from below"
)

SKIN_DIELECTRICS: Mapping[str, SkinDielectric | ColeCole] = MappingProxyType(
    {
        "order-of-magnitude": SkinDielectric(),
        "gabriel-dry": ColeCole(
            infinite_permittivity=4.0,
            relaxations=((32.0, 7.234e-12, 0.0), (1100.0, 32.481e-9, 0.2)),
            conductivity_s_per_m=2e-4,
            source=_WHOLE_SKIN.format("dry"),
        ),
        "gabriel-wet": ColeCole(
            infinite_permittivity=4.0,
            relaxations=(
                (39.0, 7.958e-12, 0.1),
                (280.0, 79.577e-9, 0.0),
                (3e4, 1.592e-6, 0.16),
                (3e4, 1.592e-3, 0.2),
            ),
            conductivity_s_per_m=4e-4,
            source=_WHOLE_SKIN.format("wet"),
        ),
    }
)
"""Skin dielectrics by name; none was measured on stratum corneum in contact."""


def _named(value: Any) -> Any:
    if not isinstance(value, str):
        return value
    if value not in SKIN_DIELECTRICS:
        raise ValueError(f"expected a table, or one of {', '.join(SKIN_DIELECTRICS)}")
    return SKIN_DIELECTRICS[value]


def _kind(value: Any) -> str:
    table = value if isinstance(value, dict) else getattr(type(value), "model_fields", ())
    return "of-relaxations" if "relaxations" in table else "by-rows"


AnySkinDielectric = Annotated[
    Annotated[SkinDielectric, Tag("by-rows")] | Annotated[ColeCole, Tag("of-relaxations")],
    Discriminator(_kind),
    BeforeValidator(_named),
]
"""A skin's dielectric in a document: a name of `SKIN_DIELECTRICS`, or a table."""
