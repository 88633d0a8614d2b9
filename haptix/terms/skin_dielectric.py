"""Skin dielectric: the insulation of the stratum corneum, which falls with frequency."""

from torch import Tensor

from haptix.terms.term import PNAS_2018, Properties, Term


class SkinInsulation(Term):
    """``h0 = d1/eps1 + d2/eps2(f)``. Without a frequency the skin counts as a conductor."""

    name = "skin-dielectric"
    summary = "the stratum corneum's d2/eps2(f) adds to h0, where a frequency is given"
    source = f"{PNAS_2018}, Eq. 4"
    uses = ("finger.layer_thickness_m", "finger.dielectric")

    def insulators(self, h0_m: Tensor, frequency_hz: Tensor, given: Properties) -> Tensor:
        skin = given.finger.dielectric
        return h0_m + given.finger.layer_thickness_m / skin.relative_permittivity(frequency_hz)

    def placeholders(self, given: Properties) -> list[str]:
        return ["dielectric of the skin"] if given.finger.dielectric.is_placeholder else []
