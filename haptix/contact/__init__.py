"""Area and gaps of a rough contact against pressure: roughness, elasticity, mean field."""

from haptix.base.threads import keep_freed_memory
from haptix.contact.accuracy import Accuracy, beyond_validation
from haptix.contact.area import AreaLaw
from haptix.contact.elasticity import ElasticSolid, HalfSpace, Layered
from haptix.contact.meanfield import ContactSpots, GapDistribution, MeanField
from haptix.contact.roughness import RoughnessSpectrum
from haptix.contact.theories import THEORIES, Theory, TheoryName

__all__ = [
    "THEORIES",
    "Accuracy",
    "AreaLaw",
    "ContactSpots",
    "ElasticSolid",
    "GapDistribution",
    "HalfSpace",
    "Layered",
    "MeanField",
    "RoughnessSpectrum",
    "Theory",
    "TheoryName",
    "beyond_validation",
]

keep_freed_memory()
