"""Area and gaps of a rough contact against pressure: roughness, elasticity, mean field."""

from haptix.allocator import keep_freed_memory
from haptix.contact.elasticity import ElasticSolid, HalfSpace, Layered
from haptix.contact.meanfield import ContactSpots, GapDistribution, MeanField
from haptix.contact.roughness import RoughnessSpectrum

__all__ = [
    "ContactSpots",
    "ElasticSolid",
    "GapDistribution",
    "HalfSpace",
    "Layered",
    "MeanField",
    "RoughnessSpectrum",
]

keep_freed_memory()
