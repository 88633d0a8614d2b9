"""Field limit: a gap's field does not rise past what the gap bears."""

from functools import partial

from haptix.electro import FieldLimit
from haptix.electro.breakdown import bearable_field
from haptix.terms.term import Properties, Term


class FieldLimited(Term):
    """Each gap's amplitude is held at what it bears: discharge leaks the rest.

    The attraction of a gap is then ``eps0/4 min(V0^2/|u + h0|^2, E_b(u)^2)``, with E_b of
    `haptix.electro.breakdown.bearable_field`. Contact spots have no gap and keep theirs.
    """

    name = "field-limit"
    summary = "the field of each gap is held at what the gap bears, since discharge leaks the rest"
    source = "physics page, sections 3 and 9; arXiv 2409.18725"
    uses = ("screen.insulator_permittivity", "screen.insulator_strength_v_per_m")
    on_request = True
    left_to_scene = True

    def pull(self, limit: FieldLimit | None, given: Properties) -> FieldLimit:
        screen = given.screen
        return partial(
            bearable_field,
            insulator_permittivity=screen.insulator_permittivity,
            insulator_strength_v_per_m=screen.insulator_strength_v_per_m,
        )
