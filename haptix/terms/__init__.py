"""The terms of the contact model: effects that can be switched on and off by name, one a file."""

from haptix.terms.active import ActiveTerms
from haptix.terms.registry import TERMS, chosen_terms, possible_terms
from haptix.terms.term import PNAS_2018, Properties, Stage, Term

__all__ = [
    "PNAS_2018",
    "TERMS",
    "ActiveTerms",
    "Properties",
    "Stage",
    "Term",
    "chosen_terms",
    "possible_terms",
]
