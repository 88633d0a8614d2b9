"""The finger: elasticity, roughness, friction and contact area of its skin, and its response."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import pi, sqrt
from typing import Annotated, Any, ClassVar, Self

import numpy as np
import numpy.typing as npt
from pydantic import (
    Discriminator,
    Field,
    PlainSerializer,
    PlainValidator,
    PositiveFloat,
    PositiveInt,
    Tag,
    model_validator,
)
from torch import Tensor

from haptix.base.checks import Array, plain, positive
from haptix.base.documents import Document, Part
from haptix.base.files import digest
from haptix.model.contact import ElasticSolid, HalfSpace, Layered, RoughnessSpectrum, TheoryName
from haptix.model.electro.dielectric import AnySkinDielectric, SkinDielectric
from haptix.model.presets import FINGERS

_STANDING_MM_PER_S = 1e-3  # gains of slower fingers are those at this speed

SHORTEST_PER_M = 1e7
"""Wavenumber [1/m] up to which a finger's roughness must be measured: waves of 0.6 um. Shorter ones
leave the gaps of the insulator's thickness, and tau_f takes up their part of the slope."""

_AREA_MEASURED_N = (0.1, 0.9)  # of the default law, see `Finger`
_LONGEST_WAVES = 2.0  # q0 times the side of the apparent area over 2 pi: longer waves carry height
_ROUGHNESS = "roughness spectrum of the finger"


def _positive(value: Any) -> float | Tensor:
    number = plain(value)
    if number is None:
        raise ValueError("expected a number")
    if not 0 < number < float("inf"):
        raise ValueError("expected a finite number above 0")
    return value if isinstance(value, Tensor) else number


Quantity = Annotated[float | Tensor, PlainValidator(_positive), PlainSerializer(plain)]
"""A positive number, or a tensor of one for gradients."""
PoissonRatio = Annotated[float, Field(gt=-1, le=0.5)]


class Roughness(Part):
    """Self-affine roughness with a roll-off: the numbers of `RoughnessSpectrum.self_affine`.

    The default has the paper's h_rms 22 um and H = 0.86 and its rms slope of 0.91; the spectrum of
    the paper's finger itself is only printed as a figure, so its band is a placeholder.
    """

    h_rms_m: Quantity = 22e-6
    hurst: Annotated[float, Field(gt=0, le=1)] = 0.86
    q0_per_m: PositiveFloat = 1e3
    q_rolloff_per_m: PositiveFloat = 3992.9
    q1_per_m: PositiveFloat = 1e9
    is_placeholder: bool = True

    @model_validator(mode="after")
    def _waves_in_order(self) -> Self:
        q0, rolloff, q1 = self.q0_per_m, self.q_rolloff_per_m, self.q1_per_m
        if not q0 <= rolloff <= q1 or q0 == q1:
            raise ValueError("expected q0_per_m <= q_rolloff_per_m <= q1_per_m, and q0 < q1")
        return self

    def unmeasured(self, apparent_area_m2: float) -> list[str]:
        """Name what friction rests on and was not measured."""
        return [_ROUGHNESS] if self.is_placeholder else []

    @property
    def warnings(self) -> list[str]:
        """None: it is a law."""
        return []

    def spectrum(self) -> RoughnessSpectrum:
        """Return the spectrum itself."""
        return RoughnessSpectrum.self_affine(
            self.h_rms_m, self.hurst, self.q0_per_m, self.q_rolloff_per_m, self.q1_per_m
        )


class MeasuredRoughness(Part):
    """A measured spectrum, as `RoughnessSpectrum.from_table` takes it.

    A table may be given in another ``convention``, and with its ``h_rms_m``, which is then
    compared; it is kept as the C of Persson.
    """

    q_per_m: tuple[float, ...]
    density_m4: tuple[float, ...]
    """Wavenumbers [1/m], increasing, and C(q) [m^4]; nothing is assumed beyond their band."""
    source: str = ""
    """Where the numbers come from."""
    is_placeholder: bool = False
    measured_per_m: Annotated[
        tuple[PositiveFloat, PositiveFloat] | None, Field(exclude_if=lambda band: band is None)
    ] = None
    """Band [1/m] that was measured, where the table goes further by a law."""
    notes: Annotated[tuple[str, ...], Field(exclude_if=lambda notes: not notes)] = ()
    """How it was made of a measurement; one that begins with "warning: " is told with results."""

    @classmethod
    def of(cls, spectrum: RoughnessSpectrum, source: str = "") -> Self:
        """Keep a spectrum, such as that of a measured topography."""
        return cls(
            q_per_m=tuple(spectrum.wavenumber.tolist()),
            density_m4=tuple(spectrum.density.tolist()),
            source=source,
            measured_per_m=spectrum.measured_per_m,
            notes=spectrum.notes,
        )

    @model_validator(mode="before")
    @classmethod
    def _in_convention(cls, table: Any) -> Any:
        if not isinstance(table, dict) or not {"convention", "h_rms_m"} & table.keys():
            return table
        rest = {key: value for key, value in table.items() if key not in ("convention", "h_rms_m")}
        spectrum = RoughnessSpectrum.from_table(
            table.get("q_per_m"), table.get("density_m4"), table.get("convention", "C")
        )
        if "h_rms_m" in table:
            spectrum.check_h_rms(table["h_rms_m"])
        return {
            **rest,
            "q_per_m": tuple(spectrum.wavenumber.tolist()),
            "density_m4": tuple(spectrum.density.tolist()),
        }

    def unmeasured(self, apparent_area_m2: float) -> list[str]:
        """Name what friction on an apparent area [m^2] rests on and was not measured."""
        if self.is_placeholder:
            return [_ROUGHNESS]
        low, high = self.measured_per_m or (self.q_per_m[0], self.q_per_m[-1])
        unseen = []
        if high < SHORTEST_PER_M:
            unseen.append(f"shorter than {2e6 * pi / high:.3g} um")
        if low > _LONGEST_WAVES * 2 * pi / sqrt(apparent_area_m2):
            unseen.append(f"longer than {2e3 * pi / low:.3g} mm")
        return [f"roughness of the finger in waves {' and '.join(unseen)}"] if unseen else []

    @property
    def warnings(self) -> list[str]:
        """Notes on values that are likely to be wrong."""
        return [note.removeprefix("warning: ") for note in self.notes if "warning: " in note[:9]]

    @model_validator(mode="after")
    def _is_a_spectrum(self) -> Self:
        self.spectrum()
        return self

    def spectrum(self) -> RoughnessSpectrum:
        """Return the spectrum itself."""
        spectrum = RoughnessSpectrum.from_table(self.q_per_m, self.density_m4)
        return replace(spectrum, notes=self.notes, measured_per_m=self.measured_per_m)


def _kind_of_roughness(value: Any) -> str:
    table = value if isinstance(value, dict) else getattr(type(value), "model_fields", ())
    return "as-measured" if "q_per_m" in table else "self-affine"


AnyRoughness = Annotated[
    Annotated[Roughness, Tag("self-affine")] | Annotated[MeasuredRoughness, Tag("as-measured")],
    Discriminator(_kind_of_roughness),
]


class Finger(Document):
    """One fingertip. Presets: "semi-wet" (the paper's Fig. 3C), "dry" and "wet".

    Sources: physics page, section 3 (Ayyildiz et al., PNAS 2018). Their tau_f is the paper's,
    carried over to the theory "local" by `haptix.model.in_theory`.

    Parameters
    ----------
    name : str
        Name of the finger.
    youngs_modulus_pa, poisson_ratio, layer_thickness_m
        The stratum corneum.
    bulk_modulus_pa, bulk_poisson_ratio
        The tissue below. Without a bulk modulus the skin is one half-space.
    hardness_pa
        Penetration hardness of dry skin, or None for elastic contact.
    frictional_shear_stress_pa
        tau_f, the friction force per real contact area.
    theory
        The form of the mean field that tau_f was fitted with, see `haptix.model.THEORIES`;
        a `ContactModel` of the finger uses it.
    apparent_area_at_1n_m2, apparent_area_exponent
        ``A0 = area * (F_N / 1 N)^exponent``, from 3 kPa at 0.1 N and 20 kPa at 0.9 N.
    fingers_on_screen : int
        Equal fingers of one person that touch the electrode at once. They share the body's return
        to earth (term "body-return"); friction is that of each finger.
    response_hz_per_mm_per_s
        Friction follows the attraction like a first-order system whose cut-off frequency rises in
        proportion to the sliding speed: this much per mm/s (2025; physics page, section 7).
    contact_time_s, softening_time_s, softened_share
        Time since the finger came down; time constant with which the stratum corneum softens under
        the screen, and the share of its modulus that is left (term "occlusion").
    sliding_speed_mm_per_s, speed_exponent
        Speed, and the power with which tau_f grows with it (term "sliding-speed").
    shear_area_loss : float
        Share of the apparent area at rest that shear takes (term "shear-area").
    roughness, dielectric
        Roughness spectrum, and the skin's permittivity and resistivity: a table, or a name of
        `haptix.model.SKIN_DIELECTRICS`.

    Examples
    --------
    >>> Finger.preset("wet").name
    'wet'
    """

    presets: ClassVar = FINGERS

    name: str = "custom"
    youngs_modulus_pa: Quantity = 40e6
    poisson_ratio: PoissonRatio = 0.5
    layer_thickness_m: Quantity = 200e-6
    bulk_modulus_pa: Quantity | None = None
    bulk_poisson_ratio: PoissonRatio = 0.5
    hardness_pa: Quantity | None = None
    frictional_shear_stress_pa: Quantity = 8e6
    theory: TheoryName = Field(default="open-gaps", exclude_if=lambda value: value == "open-gaps")
    apparent_area_at_1n_m2: PositiveFloat = 45.65e-6
    apparent_area_exponent: Annotated[float, Field(ge=0, lt=1)] = 0.1366
    response_hz_per_mm_per_s: PositiveFloat = 13.8
    # Files and hashes leave out what has its usual value.
    fingers_on_screen: Annotated[PositiveInt, Field(exclude_if=lambda count: count == 1)] = 1
    # For terms on request, the largest published effects: a plan states what lacking them may cost.
    contact_time_s: Annotated[float, Field(ge=0, exclude_if=lambda value: value == 10.0)] = 10.0
    softening_time_s: Annotated[float, Field(gt=0, exclude_if=lambda value: value == 5.0)] = 5.0
    softened_share: Annotated[float, Field(gt=0, le=1, exclude_if=lambda value: value == 0.1)] = 0.1
    sliding_speed_mm_per_s: Annotated[
        float, Field(gt=0, exclude_if=lambda value: value == 200.0)
    ] = 200.0
    speed_exponent: Annotated[float, Field(ge=-1, le=1, exclude_if=lambda value: value == 0.3)] = (
        0.3
    )
    shear_area_loss: Annotated[float, Field(ge=0, lt=1, exclude_if=lambda value: value == 0.2)] = (
        0.2
    )
    roughness: AnyRoughness = Roughness()
    dielectric: AnySkinDielectric = SkinDielectric()

    def solid(self) -> ElasticSolid:
        """Return the elastic solid: the layered skin, or a half-space without a bulk modulus.

        Examples
        --------
        >>> type(Finger.preset("wet").solid()).__name__  # a stratum corneum over tissue
        'Layered'
        """
        if self.bulk_modulus_pa is None:
            return HalfSpace(self.youngs_modulus_pa, self.poisson_ratio)
        return Layered(
            self.youngs_modulus_pa,
            self.poisson_ratio,
            self.layer_thickness_m,
            self.bulk_modulus_pa,
            self.bulk_poisson_ratio,
        )

    def area_warnings(self, normal_force_n: float) -> list[str]:
        """Name a force at which the contact area of the presets is extrapolated.

        Examples
        --------
        >>> Finger().area_warnings(0.5)
        []
        """
        low_n, high_n = _AREA_MEASURED_N
        names = ("apparent_area_at_1n_m2", "apparent_area_exponent")
        is_own = any(getattr(self, name) != type(self).model_fields[name].default for name in names)
        if is_own or low_n <= normal_force_n <= high_n:
            return []
        return [
            f"a normal force of {normal_force_n:g} N: the contact area was measured from {low_n:g} "
            f"to {high_n:g} N"
        ]

    def apparent_area_m2(self, normal_force_n: Tensor) -> Tensor:
        """A0 [m^2] at normal forces [N] of any shape.

        Examples
        --------
        >>> finger = Finger.preset("wet")
        >>> bool(finger.apparent_area_m2(1.0) > finger.apparent_area_m2(0.5))
        True
        """
        return self.apparent_area_at_1n_m2 * normal_force_n**self.apparent_area_exponent

    def content_hash(self) -> str:
        """SHA-256 of everything in the profile.

        Examples
        --------
        >>> Finger.preset("wet").content_hash() == Finger.preset("wet").content_hash()
        True
        >>> Finger.preset("wet").content_hash() == Finger.preset("dry").content_hash()
        False
        """
        return digest(self.model_dump(mode="json"))


@dataclass(frozen=True)
class FingerResponse:
    """The finger's response: a first-order low-pass filter over slid distance.

    Friction follows the attraction like a first-order system whose cut-off rises in proportion to
    the sliding speed (physics page, section 7). Such a cut-off is a fixed length: at r Hz per mm/s,
    1/e of an old state is left after 1/(2 pi r) mm of sliding (11.5 um for 13.8), however the speed
    changes. Over slid distance the equation has constant coefficients, and one step of it is exact.
    """

    response_hz_per_mm_per_s: float
    """Cut-off frequency per sliding speed, see `Finger`."""

    def __post_init__(self) -> None:
        positive("response_hz_per_mm_per_s", self.response_hz_per_mm_per_s)

    def gain(
        self, frequency_hz: float | Array, speed_mm_per_s: float | Array
    ) -> npt.NDArray[np.complex128]:
        """Complex gain ``1/(1 + i f/f_c)`` at a frequency of the attraction; both broadcast."""
        cutoff_hz = self.response_hz_per_mm_per_s * np.maximum(speed_mm_per_s, _STANDING_MM_PER_S)
        return np.asarray(1 / (1 + 1j * np.asarray(frequency_hz) / cutoff_hz))

    def power(
        self, frequency_hz: float | Array, speed_mm_per_s: float | Array
    ) -> npt.NDArray[np.float64]:
        """Squared size of `gain`. A ripple adds to mean friction nearly in proportion to it."""
        gain = self.gain(frequency_hz, speed_mm_per_s)
        return np.asarray(np.square(gain.real) + np.square(gain.imag))

    def follow(self, drive: Array, distance_mm: Array, before: Array | None = None) -> Array:
        """Filter a drive that is linear in slid distance between samples, without an error.

        Solves ``dy/ds = 2 pi r (drive - y)``.

        Parameters
        ----------
        drive : ndarray, shape (rows, samples)
            Signal that friction follows, such as the attraction.
        distance_mm : ndarray, shape (samples,)
            Slid distance of two samples or more, not decreasing.
        before : ndarray, shape (rows,), optional
            y at the first sample; by default that of the drive.

        Returns
        -------
        ndarray, shape (rows, samples)
        """
        from scipy.linalg import solve_banded  # slow to import; rendering uses `gain` alone

        if before is None:
            before = drive[:, 0]
        step = 2 * np.pi * self.response_hz_per_mm_per_s * np.diff(distance_mm)
        decay = np.exp(-step)
        # (1 - exp(-d))/d, by expm1 without cancellation; 1 - d/2 where the finger hardly moves.
        moving = np.where(step > 1e-9, step, 1.0)
        share = np.where(step > 1e-9, -np.expm1(-step) / moving, 1 - step / 2)
        gain = (share - decay) * drive[:, :-1] + (1 - share) * drive[:, 1:]
        # y_k = decay_k y_(k-1) + gain_k from y_0 = before: a matrix of two bands.
        bands = np.stack([np.ones(len(step) + 1), np.append(-decay, 0.0)])
        right = np.concatenate([before[:, None], gain], axis=1)
        return np.asarray(solve_banded((1, 0), bands, right.T, check_finite=False).T)
