"""Dielectric of the stratum corneum: tables, and the sums of relaxations of whole skin."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from math import log, pi
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Literal, Self

import numpy as np
import torch
from pydantic import (
    BeforeValidator,
    Discriminator,
    Field,
    NonNegativeFloat,
    PositiveFloat,
    Tag,
    ValidationError,
    model_validator,
)
from torch import Tensor

from haptix.base.checks import Array, first_error
from haptix.base.documents import Part
from haptix.base.errors import InputError
from haptix.model.contact.measured_files import MeasuredTable

VACUUM_PERMITTIVITY = 8.8541878128e-12
"""eps0 [F/m], CODATA 2018."""

_NOISE = 0.08  # rms of ln by which rows may leave the nearest column that does not rise
_DECADE = log(10) * (1 + 1e-9)  # of ln f
_STEADY_HZ = 1e-6  # from here on down a period lasts for days
_AT_AN_END = 1 + 1e-6  # a drive at the first or last frequency of a table may be rounded

Beyond = Literal["refuse", "hold", "power-law"]
"""Value of a table beyond its ends."""

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
        if self.nodes.shape[0] == 1:
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

    ``eps2(w) = eps_SC + i / (w eps0 rho_SC)`` (paper, Eq. 4), by a monotone cubic over logarithms.
    The built-in table is an order of magnitude only, as its `source` notes.

    Skin at these frequencies shows relaxations only. By the relations of Kramers and Kronig neither
    permittivity nor resistivity then rises with frequency, and a table in which one does is
    rejected. Up to 8 % rms from the nearest column that does not rise count as noise.

    Parameters
    ----------
    frequency_hz, permittivity, resistivity_ohm_m : tuple of float
        Columns of the table, frequency increasing. A single row means constants. In place of the
        resistivity it may have ``conductivity_s_per_m`` or ``loss_tangent``.
    beyond : {"refuse", "hold", "power-law"}, optional
        What holds beyond the table's ends: an error, its last values, or the power law of its last
        decade. By default an error; the built-in table, and a single row, hold.
    scale : float
        Factor on the skin's effective thickness ``d2/eps2``, which a calibration may fit: 2 for a
        skin that insulates twice as much as in the table.
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
    beyond: Annotated[Beyond | None, Field(exclude_if=lambda value: value is None)] = None
    scale: _Scale = 1.0
    is_placeholder: bool = True
    source: str = "order of magnitude after Yamamoto & Yamamoto (1976); not measured values"

    @model_validator(mode="before")
    @classmethod
    def _in_resistivity(cls, table: Any) -> Any:
        other = {"conductivity_s_per_m", "loss_tangent"}
        if not isinstance(table, dict) or not (given := other & table.keys()):
            return table
        if len(given) > 1 or "resistivity_ohm_m" in table:
            raise ValueError(f"expected one of resistivity_ohm_m, {', '.join(sorted(other))}")
        (name,) = given
        losses = tuple(float(loss) for loss in table[name])
        if not all(loss > 0 for loss in losses):
            raise ValueError(f"{name}: expected numbers above 0")
        if name == "loss_tangent":
            rows = zip(table["frequency_hz"], table["permittivity"], losses, strict=True)
            losses = tuple(2 * pi * f * VACUUM_PERMITTIVITY * eps * tan for f, eps, tan in rows)
        rest = {key: value for key, value in table.items() if key != name}
        return {**rest, "resistivity_ohm_m": tuple(1 / loss for loss in losses)}

    @model_validator(mode="after")
    def _columns_match(self) -> Self:
        rows = len(self.frequency_hz)
        if not rows or rows != len(self.permittivity) or rows != len(self.resistivity_ohm_m):
            raise ValueError("expected three columns of one length, 1 or more")
        if list(self.frequency_hz) != sorted(set(self.frequency_hz)):
            raise ValueError("expected frequencies in increasing order")
        for name in ("permittivity", "resistivity_ohm_m"):
            self._check_causal(name)
        return self

    def _check_causal(self, name: str) -> None:
        values = getattr(self, name)
        if all(after <= before for before, after in pairwise(values)):
            return
        from scipy.optimize import isotonic_regression  # takes a third of a second to import

        logs = np.log(values)
        nearest = isotonic_regression(logs, increasing=False)
        for first, last in pairwise(nearest.blocks):
            rise = logs[first:last] - nearest.x[first:last]
            if np.sqrt(np.mean(rise**2)) > _NOISE:
                raise ValueError(
                    f"{name}: expected a causal table, whose {name.split('_')[0]} does not rise "
                    f"with frequency, but it rises from {min(values[first:last]):g} to "
                    f"{max(values[first:last]):g} in rows {first + 1} to {last}; check the rows, "
                    "or drop them"
                )

    @classmethod
    def of_impedance(
        cls,
        frequency_hz: Any,
        impedance_ohm: Any,
        area_m2: float,
        thickness_m: float,
        **fields: Any,
    ) -> Self:
        """Make a table of the impedance that an LCR meter reads of a layer between two plates.

        Parameters
        ----------
        frequency_hz : array_like, shape (n,)
            Frequencies [Hz], increasing.
        impedance_ohm : array_like of complex, shape (n,)
            Series impedance ``R + i X`` [Ohm]; that of a capacitor has X below 0.
        area_m2, thickness_m : float
            Area of the electrode, and thickness of the layer [m].
        fields
            Other fields, such as `source`.

        Raises
        ------
        InputError
            If the layer does not lose energy and store charge at all frequencies.

        Examples
        --------
        >>> area_m2, thickness_m, omega = 1e-4, 2e-5, 2 * torch.pi * 1e3
        >>> admittance = 1e-6 + 1j * omega * 1e-8  # 1 MOhm beside 10 nF
        >>> skin = SkinDielectric.of_impedance([1e3], [1 / admittance], area_m2, thickness_m)
        >>> round(skin.permittivity[0]), round(skin.resistivity_ohm_m[0])
        (226, 5000000)
        """
        frequency, impedance = np.asarray(frequency_hz, float), np.asarray(impedance_ohm, complex)
        admittance = thickness_m / area_m2 / impedance
        omega = 2 * pi * frequency
        if not (np.isfinite(admittance).all() and (admittance.real > 0).all()):
            raise InputError("impedance_ohm: expected a resistance above 0 Ohm at all frequencies")
        if not (admittance.imag > 0).all():
            raise InputError(
                "impedance_ohm: expected that of a capacitor, whose reactance (and phase) is below "
                "0; the meter may state it with the other sign"
            )
        return cls(
            frequency_hz=tuple(frequency.tolist()),
            permittivity=tuple((admittance.imag / omega / VACUUM_PERMITTIVITY).tolist()),
            resistivity_ohm_m=tuple((1 / admittance.real).tolist()),
            **{"is_placeholder": False, **fields},
        )

    @classmethod
    def read(
        cls,
        path: Path,
        area_m2: float | None = None,
        thickness_m: float | None = None,
        **fields: Any,
    ) -> Self:
        """Read a table of permittivity and a loss, or the readings of an LCR meter.

        Beside the frequency, the header names one pair of columns, with their units:
        ``permittivity`` with ``resistivity (Ohm m)``, ``conductivity (S/m)`` or ``loss tangent``;
        or ``Z`` with ``theta``, ``R`` with ``X``, ``Cp`` with ``Rp``, ``G`` or ``D``, ``Cs`` with
        ``Rs`` or ``D``.

        Parameters
        ----------
        path : Path
            Text with a header.
        area_m2, thickness_m : float, optional
            Electrode and layer of an LCR meter's readings, as for `of_impedance`.
        fields
            Other fields, such as `beyond`.

        Raises
        ------
        InputError, FileFormatError
            If the columns or units are others, or the table is not that of a skin.
        """
        table = MeasuredTable.read(path)
        found = {_named_column(name): index for index, name in enumerate(table.names)}

        def column(name: str) -> Array:
            own = _COLUMNS[name][1]
            unit = table.units[found[name]]
            if own == "":
                return table.values[:, found[name]]
            if name == "theta" and unit.startswith("rad"):
                return np.degrees(table.values[:, found[name]])
            return table.column(found[name], own, _DEFAULT_UNITS.get(name, ""))

        pair = next((pair for pair in _PAIRS if {"f", *pair} <= found.keys()), None)
        if pair is None:
            known = ", ".join(f"{a} with {b}" for a, b in _PAIRS)
            raise InputError(
                f"{path}: expected a header that names f and {known}, got "
                f"{', '.join(table.names) or 'none'}"
            )
        order = np.argsort(column("f"), kind="stable")
        f, first, second = (column(name)[order] for name in ("f", *pair))
        fields = {"is_placeholder": False, "source": path.name, **fields}
        try:
            if pair[0] == "permittivity":
                # A relative permittivity of 0 or below is checked by the field.
                columns = {"frequency_hz": f, "permittivity": first, _LOSSES[pair[1]]: second}
                lists = {name: tuple(values.tolist()) for name, values in columns.items()}
                return cls.model_validate({**lists, **fields})
            if area_m2 is None or thickness_m is None:
                raise InputError(
                    f"{path}: readings of an LCR meter need the electrode's area and the layer's "
                    "thickness (--area-m2, --thickness-m)"
                )
            ohm = _impedance(pair, 2 * pi * f, first, second)
            return cls.of_impedance(f, ohm, area_m2, thickness_m, **fields)
        except ValidationError as error:
            raise InputError(first_error(str(path), error)) from None

    @property
    def law(self) -> Beyond:
        """Its value beyond its ends, see `beyond`."""
        built_in = type(self).model_fields["frequency_hz"].default
        held = len(self.frequency_hz) == 1 or self.frequency_hz == built_in
        return self.beyond or ("hold" if held else "refuse")

    def _check_band(self, frequency_hz: Tensor) -> None:
        first, last = self.frequency_hz[0], self.frequency_hz[-1]
        low, high = (float(end) for end in frequency_hz.detach().aminmax())
        if low * _AT_AN_END < first or high > last * _AT_AN_END:
            outside = low if low * _AT_AN_END < first else high
            got = f"{outside:.4g} Hz" if outside > _STEADY_HZ else "a steady voltage"
            raise InputError(
                f"frequency_hz: expected one within the skin's dielectric table, {first:g} to "
                f"{last:g} Hz, got {got}; measure further, or state the law beyond its "
                'ends: dielectric.beyond = "power-law" or "hold"'
            )

    def relative_permittivity(self, frequency_hz: Tensor) -> Tensor:
        """Complex eps2 at frequencies [Hz] of any shape, the scale included."""
        if self.law == "refuse" and frequency_hz.numel():
            self._check_band(frequency_hz)
        log_f = torch.log(frequency_hz)
        nodes, *columns = log_f.new_tensor(
            [self.frequency_hz, self.permittivity, self.resistivity_ohm_m]
        ).log()
        table = torch.stack(columns, -1)
        within = MonotoneCubic.through(nodes, table)(log_f)
        if self.law == "power-law" and len(nodes) > 1:
            for end in (0, -1):
                # Two rows at least, and those of the last decade, whose noise then matters less.
                away = (nodes - nodes[end]).abs()
                near = away <= away.sort().values[1].clamp(min=_DECADE)
                x = nodes[near] - nodes[near].mean()
                rise = (x[:, None] * table[near]).sum(0) / (x**2).sum()
                past = log_f - nodes[end]
                past = past.clamp(max=0.0) if end == 0 else past.clamp(min=0.0)
                within = within + past[..., None] * rise.clamp(max=0.0)
        permittivity, resistivity = within.unbind(-1)
        loss = 1 / (2 * torch.pi * frequency_hz * VACUUM_PERMITTIVITY * torch.exp(resistivity))
        return torch.complex(torch.exp(permittivity), loss) / self.scale


# Names of columns, as patterns of what stands in headers in small letters, and their units.
_COLUMNS: dict[str, tuple[str, str]] = {
    "f": (r"f|freq.*", "Hz"),
    "permittivity": (r"(rel.*)?permittivity.*|eps.*|er|dielectric constant|ε.*", ""),
    "resistivity": (r"resistivity|rho.*|ρ", "Ohm m"),
    "conductivity": (r"conductivity|sigma.*|σ", "S/m"),
    "loss tangent": (r"loss[ _]tangent|tan.*|d|df|loss factor", ""),
    "Z": (r"\|?z\|?|impedance|\|?z\|? ?magnitude", "Ohm"),
    "theta": (r"theta|phase|phi|θ|φ", "deg"),
    "R": (r"r|re\(?z\)?|z'", "Ohm"),
    "X": (r"x|im\(?z\)?|z''", "Ohm"),
    "Cp": (r"cp|c", "F"),
    "Rp": (r"rp", "Ohm"),
    "G": (r"gp?", "S"),
    "Cs": (r"cs", "F"),
    "Rs": (r"rs|esr", "Ohm"),
}
_DEFAULT_UNITS = {
    "f": "Hz", "Z": "Ohm", "theta": "deg", "R": "Ohm", "X": "Ohm", "Cp": "F", "Rp": "Ohm", "G": "S",
    "Cs": "F", "Rs": "Ohm",
}  # fmt: skip
_PAIRS = (
    ("permittivity", "resistivity"), ("permittivity", "conductivity"),
    ("permittivity", "loss tangent"), ("Z", "theta"), ("R", "X"), ("Cp", "Rp"), ("Cp", "G"),
    ("Cp", "loss tangent"), ("Cs", "Rs"), ("Cs", "loss tangent"),
)  # fmt: skip
_LOSSES = {
    "resistivity": "resistivity_ohm_m",
    "conductivity": "conductivity_s_per_m",
    "loss tangent": "loss_tangent",
}


def _named_column(name: str) -> str:
    text = re.sub(r"[_-]+", " ", name.strip().lower())
    for known, (pattern, _) in _COLUMNS.items():
        if re.fullmatch(pattern, text) or re.fullmatch(pattern, name.strip().lower()):
            return known
    return ""


def _impedance(pair: tuple[str, str], omega: Array, first: Array, second: Array) -> Any:
    """Series impedance [Ohm] of a pair of an LCR meter's readings."""
    if pair == ("Z", "theta"):
        return first * np.exp(1j * np.radians(second))
    if pair == ("R", "X"):
        return first + 1j * second
    if pair[0] == "Cs":
        loss = second if pair[1] == "Rs" else second / (omega * first)
        return loss - 1j / (omega * first)
    conductance = second
    if pair[1] != "G":
        conductance = 1 / second if pair[1] == "Rp" else omega * first * second
    return 1 / (conductance + 1j * omega * first)


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
