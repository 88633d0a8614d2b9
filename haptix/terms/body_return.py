"""Body return: the person closes the circuit to earth, and takes a share of the voltage."""

from torch import Tensor

from haptix.terms.term import Properties, Term


class BodyReturn(Term):
    """``C_b / (C_b + n C_c)`` of the voltage is left for each of n alike contacts.

    They stand side by side on one electrode, in series with the body's capacitance to earth.
    """

    name = "body-return"
    summary = "the body's capacitance to earth takes a share of the voltage from all contacts"
    source = "series circuit; body of 100 pF (ANSI/ESDA/JEDEC JS-001) to 150 pF (IEC 61000-4-2)"
    uses = ("screen.body_capacitance_f", "finger.fingers_on_screen")
    on_request = True
    left_to_scene = True

    def supply(self, share: Tensor, capacitance_f: Tensor, given: Properties) -> Tensor:
        body = given.screen.body_capacitance_f
        return share * (body / (body + given.finger.fingers_on_screen * capacitance_f))
