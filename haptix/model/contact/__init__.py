"""Area and gaps of a rough contact against pressure: roughness, elasticity, mean field."""

from haptix.base.threads import keep_freed_memory
from haptix.model.contact.accuracy import Accuracy, beyond_validation
from haptix.model.contact.area import AreaLaw
from haptix.model.contact.elasticity import ElasticSolid, HalfSpace, Layered
from haptix.model.contact.persson import ContactSpots, GapDistribution, MeanField
from haptix.model.contact.roughness import RoughnessSpectrum
from haptix.model.contact.theories import THEORIES, Theory, TheoryName

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
