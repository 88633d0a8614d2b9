"""Apparent contact area that grows with the normal force."""

from torch import Tensor

from haptix.terms.term import PNAS_2018, Properties, Term


class ApparentArea(Term):
    """``A0 = A0(1 N) (F_N / 1 N)^m``: a fingertip flattens as it presses."""

    name = "apparent-area"
    summary = "apparent contact area grows with force, A0 ~ F_N^m; off: its value at 1 N"
    source = f"{PNAS_2018}: 3 kPa at 0.1 N, 20 kPa at 0.9 N"
    uses = ("finger.apparent_area_at_1n_m2", "finger.apparent_area_exponent")

    def size(self, area_m2: Tensor, normal_force_n: Tensor, given: Properties) -> Tensor:
        return given.finger.apparent_area_m2(normal_force_n)
