from .active import ActiveTerms as ActiveTerms
from .registry import TERMS as TERMS
from .registry import chosen_terms as chosen_terms
from .registry import possible_terms as possible_terms
from .term import PNAS_2018 as PNAS_2018
from .term import Properties as Properties
from .term import Stage as Stage
from .term import Term as Term
