"""Layered skin: stiff stratum corneum on soft tissue."""

from haptix.contact import ElasticSolid
from haptix.terms.term import PNAS_2018, Properties, Term


class LayeredSkin(Term):
    """``E*(q)`` of a layer bonded to a half-space: long waves feel the tissue below."""

    name = "layered-skin"
    summary = "stratum corneum bonded to soft tissue; off: a half-space of the stratum corneum"
    source = f"{PNAS_2018}, SI; physics page, section 3"
    uses = ("finger.layer_thickness_m", "finger.bulk_modulus_pa", "finger.bulk_poisson_ratio")

    def solid(self, solid: ElasticSolid, given: Properties) -> ElasticSolid:
        return given.finger.solid()
