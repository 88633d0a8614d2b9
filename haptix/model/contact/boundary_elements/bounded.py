"""The contact problem: pressures between 0 and a ceiling that leave no overlap of the surfaces.

With u = K p the displacement and h the height, the gap is ``g = u - h + level``. The solver finds
pressures of a given mean with ``g = 0`` where ``0 < p < ceiling``, ``g >= 0`` where ``p = 0`` and
(elastoplastic, Almqvist et al., J. Mech. Phys. Solids 55 (2007)) ``g <= 0`` at the ceiling.

Polonsky and Keer (Wear 231, 206 (1999)) solve it by conjugate gradients over the points in contact.
Here the points about to join are part of the same search direction (Vollebregt, J. Optim.
Theory Appl. 162, 931 (2014)), the residual is preconditioned by the exact inverse ``q E*(q)/2`` of
the elastic response cut to those points, and a cold start solves the half-sized problem first.
While no pressure meets a bound the gap is updated from the step, without a convolution of its own.
Where one does, the pressures brought back must have less energy than before: else the step is taken
back, and a few shorter ones follow the gap without preconditioning, which always lowers the energy.
Otherwise pressures on a layer a thousand times stiffer than its base would cycle.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import inf, pi

import torch
from torch import Tensor

from haptix.base.display import Displayed
from haptix.model.contact.elasticity import ElasticSolid

COARSEST_POINTS = 64
_COARSE_TOLERANCE = 1e-3
_MOST_ROUNDS = 100
_PLAIN_STEPS = 5.0
_ROUNDING = 1e-13  # of the scale: energies that differ by less per moved pressure are equal


@dataclass(frozen=True)
class PeriodicSolid:
    """Surface compliance ``2 / (q E*(q))`` at every wavenumber of a square periodic box.

    The mean of the pressure moves a half-space bodily, which the gap's free level takes up: the
    compliance of the mean is set to 0, and displacements have no mean.
    """

    compliance: Tensor
    """Displacement per pressure [m/Pa], shape (n, n // 2 + 1), ordered as `torch.fft.rfft2`."""
    stiffness: Tensor
    """Its inverse ``q E*(q) / 2`` [Pa/m], and 0 for the mean."""

    @classmethod
    def on_grid(
        cls, solid: ElasticSolid, points: int, side_m: float, device: torch.device | None = None
    ) -> PeriodicSolid:
        """Sample `solid` at the wavenumbers of `points` x `points` pixels on `side_m` [m]."""
        q = wavenumbers(points, side_m)
        q[0, 0] = q[0, 1]  # any; the mean is set below
        stiffness = q * solid.effective_modulus(q).detach() / 2
        compliance = 1 / stiffness
        stiffness[0, 0] = compliance[0, 0] = 0.0
        return cls(compliance.to(device), stiffness.to(device))

    def displacement(self, pressure_pa: Tensor) -> Tensor:
        """Inward displacement [m] under a pressure, shape (..., n, n), without its mean."""
        return _filtered(pressure_pa, self.compliance)

    def pressure(self, displacement_m: Tensor) -> Tensor:
        """Pressure [Pa] that makes this displacement, shape (..., n, n), without its mean."""
        return _filtered(displacement_m, self.stiffness)


def wavenumbers(points: int, side_m: float) -> Tensor:
    """``|q|`` [1/m] of the half spectrum of `torch.fft.rfft2`, shape (n, n // 2 + 1)."""
    step = 2 * pi / side_m
    rows = torch.fft.fftfreq(points, 1 / points, dtype=torch.float64)[:, None]
    columns = torch.fft.rfftfreq(points, 1 / points, dtype=torch.float64)
    return step * torch.hypot(rows, columns)


def _filtered(field: Tensor, factor: Tensor) -> Tensor:
    waves = torch.fft.rfft2(field)
    torch.mul(waves, factor, out=waves)
    answer: Tensor = torch.fft.irfft2(waves, s=field.shape[-2:])
    return answer


@dataclass(frozen=True)
class BoundedSolution(Displayed):
    """Pressures and gaps of a batch of surfaces."""

    pressure_pa: Tensor
    """Contact pressure; shape (batch, n, n)."""
    gap_m: Tensor
    """Gap; within the residual of 0 in contact, negative where the ceiling lets surfaces overlap;
    shape (batch, n, n)."""
    residual: Tensor
    """Largest violation of the conditions on the gap anywhere, over the scale given; shape
    (batch,)."""
    iterations: Tensor
    """Steps on the finest grid; shape (batch,)."""
    converged: Tensor
    """Whether the residual is within the tolerance; shape (batch,)."""


def coarser(height: Tensor) -> Tensor:
    """Return the surfaces on every second point, without the waves that these cannot resolve."""
    points = height.shape[-1] // 2
    half = points // 2
    waves = torch.fft.rfft2(height)
    kept = waves.new_zeros((*height.shape[:-2], points, half + 1))
    kept[..., :half, :half] = waves[..., :half, :half]
    kept[..., -half + 1 :, :half] = waves[..., -half + 1 :, :half]
    lower: Tensor = torch.fft.irfft2(kept, s=(points, points)) / 4
    return lower


def finer(pressure: Tensor) -> Tensor:
    """Pressures on twice the points, each spread over two by two."""
    return pressure.repeat_interleave(2, -1).repeat_interleave(2, -2)


@dataclass(frozen=True)
class BoundedProblem:
    """A solid on a grid and on coarser grids, ready for any heights."""

    levels: tuple[PeriodicSolid, ...]
    """The finest grid first; each next one has half the points along a side."""
    ceiling_pa: float | None = None
    """Largest pressure, the hardness; None is elastic."""

    @classmethod
    def on_grid(
        cls,
        solid: ElasticSolid,
        points: int,
        side_m: float,
        ceiling_pa: float | None = None,
        device: torch.device | None = None,
    ) -> BoundedProblem:
        """Sample `solid` on the grid and on its halves down to `COARSEST_POINTS`."""
        sizes = [points]
        while sizes[-1] % 4 == 0 and sizes[-1] // 2 >= COARSEST_POINTS:
            sizes.append(sizes[-1] // 2)
        return cls(
            tuple(PeriodicSolid.on_grid(solid, n, side_m, device) for n in sizes), ceiling_pa
        )

    def solve(
        self,
        height_m: Tensor,
        mean_pressure_pa: Tensor,
        scale_m: Tensor,
        tolerance: float | Tensor,
        start_pa: Tensor | None = None,
        most_iterations: int = 1000,
    ) -> BoundedSolution:
        """Solve a batch at given mean pressures.

        Parameters
        ----------
        height_m : Tensor, shape (batch, n, n)
            Heights, towards the solid.
        mean_pressure_pa, scale_m : Tensor, shape (batch,)
            Mean pressure and the length by which the residual is measured.
        tolerance : float or Tensor, shape (batch,)
            Residual at which a surface counts as solved.
        start_pa : Tensor, shape (batch, n, n), optional
            Pressures of a problem close to this one; by default the coarser grids give them.
        most_iterations : int
            Largest number of steps for a surface.
        """
        tolerance = torch.as_tensor(tolerance, dtype=scale_m.dtype).to(scale_m.device)
        tolerance = tolerance.expand_as(scale_m)
        problem = height_m, mean_pressure_pa, scale_m, tolerance
        return _descend(
            self.levels[0],
            *problem,
            self._from_coarser(*problem, 1) if start_pa is None else start_pa,
            self.ceiling_pa,
            most_iterations,
        )

    def _from_coarser(
        self, height: Tensor, mean: Tensor, scale: Tensor, tolerance: Tensor, level: int
    ) -> Tensor:
        if level == len(self.levels):
            return mean[:, None, None].expand_as(height).clone()
        height = coarser(height)
        start = self._from_coarser(height, mean, scale, tolerance, level + 1)
        enough = tolerance.clamp(min=_COARSE_TOLERANCE)
        solved = _descend(
            self.levels[level], height, mean, scale, enough, start, self.ceiling_pa, 100
        )
        return finer(solved.pressure_pa)


def _descend(
    solid: PeriodicSolid,
    height: Tensor,
    mean: Tensor,
    scale: Tensor,
    tolerance: Tensor,
    start: Tensor,
    ceiling: float | None,
    most_iterations: int,
) -> BoundedSolution:
    """Preconditioned conjugate gradients; surfaces leave the batch once solved."""
    solved: list[tuple[Tensor, BoundedSolution]] = []
    rows = torch.arange(len(height), device=height.device)
    mean, scale, enough = mean[:, None, None], scale[:, None, None], tolerance
    p = start * (mean / start.mean((-2, -1), keepdim=True))
    del start
    p = _with_mean(p, mean, ceiling, p > 0)
    g = solid.displacement(p).sub_(height)
    exact = True  # g is a convolution of p, not a sum of steps
    search = torch.zeros_like(p)
    before, descent_before = torch.zeros_like(p), torch.ones_like(mean)
    reach, plain = torch.ones_like(mean), torch.zeros_like(mean)
    for step in range(most_iterations + 1):
        free, residual = _free_points(p, g, ceiling)
        worst = _largest(residual) / scale[:, 0, 0]
        done = (worst <= enough) | (step == most_iterations)
        if bool(done.any()) and not exact:
            g = solid.displacement(p).sub_(height)
            exact = True
            free, residual = _free_points(p, g, ceiling)
            worst = _largest(residual) / scale[:, 0, 0]
            done = (worst <= enough) | (step == most_iterations)
        if bool(done.any()):
            all_done = bool(done.all())  # a batch that ends together is not copied
            out, pressures, gaps = (rows, p, g) if all_done else (rows[done], p[done], g[done])
            steps = torch.full_like(out, step)
            is_met = (worst <= enough)[done]
            solved.append((out, BoundedSolution(pressures, gaps, worst[done], steps, is_met)))
            if all_done:
                break
            go_on = ~done
            rows, mean, scale, enough = rows[go_on], mean[go_on], scale[go_on], enough[go_on]
            height, p, g, search = height[go_on], p[go_on], g[go_on], search[go_on]
            before, descent_before = before[go_on], descent_before[go_on]
            reach, plain = reach[go_on], plain[go_on]
            free, residual = free[go_on], residual[go_on]
        _centre(residual, free)
        steepest = solid.pressure(residual)
        if bool((plain > 0).any()):
            steepest = torch.where(plain > 0, residual, steepest)
            plain = plain - 1
        _centre(steepest, free)
        descent = _dot(steepest, residual)
        # Polak and Ribiere's form forgets the old direction by itself where the free points change.
        carry = ((descent - _dot(steepest, before)) / descent_before).clamp_(min=0.0)
        search.mul_(carry).add_(steepest)
        _centre(search, free)
        before, descent_before = residual, descent
        del steepest
        answer = solid.displacement(search)
        length = reach * _dot(residual, search) / _dot(answer, search)
        trial = torch.addcmul(p, search, length, value=-1.0)
        beyond = trial.amin() < 0
        if ceiling is not None:
            beyond |= trial.amax() > ceiling
        reach = (2 * reach).clamp(max=1.0)
        if not bool(beyond):
            p = trial
            g.addcmul_(answer, length, value=-1.0)
            exact = False
            continue
        trial = _with_mean(trial, mean, ceiling, free)
        gap = solid.displacement(trial).sub_(height)
        rise = _rise(p, g, trial, gap)
        failed = rise[:, :1, None] > _ROUNDING * scale * rise[:, 1:, None]
        if not bool(failed.any()):
            p, g, exact = trial, gap, True
            continue
        exact = False
        p, g = torch.where(failed, p, trial), torch.where(failed, g, gap)
        search.masked_fill_(failed, 0.0)
        reach = torch.where(failed, reach / 8, reach)
        plain = torch.where(failed, _PLAIN_STEPS, plain)
    return solved[0][1] if len(solved) == 1 else _in_order(solved)


def _in_order(parts: list[tuple[Tensor, BoundedSolution]]) -> BoundedSolution:
    """Join solutions of some rows each in the order of the rows."""
    order = torch.cat([rows for rows, _ in parts]).argsort()
    names = [field.name for field in fields(BoundedSolution)]
    return BoundedSolution(
        *(torch.cat([getattr(part, name) for _, part in parts])[order] for name in names)
    )


def _rise(p: Tensor, g: Tensor, trial: Tensor, gap: Tensor) -> Tensor:
    """Rise of the energy from one pressure to another of the same mean, and the pressure moved.

    The gradient of the energy is the gap, whose level has no effect while the mean stays. The rise
    is the mean gap of both ends times the step, without a difference of large numbers.
    """
    moved = trial - p
    energy = ((g + gap) * moved).sum((-2, -1)) / 2
    return torch.stack([energy, moved.abs().sum((-2, -1))], -1)


def _dot(a: Tensor, b: Tensor) -> Tensor:
    batch = len(a)
    return torch.bmm(a.reshape(batch, 1, -1), b.reshape(batch, -1, 1))


def _centre(field: Tensor, free: Tensor) -> None:
    """Set `field` to 0 at the points that are not free, and subtract its mean from the rest."""
    field.mul_(free)
    count = free.sum((-2, -1), keepdim=True)
    field.sub_(field.sum((-2, -1), keepdim=True) / count).mul_(free)


def _largest(field: Tensor) -> Tensor:
    return field.abs().amax((-2, -1))


def _free_points(p: Tensor, g: Tensor, ceiling: float | None) -> tuple[Tensor, Tensor]:
    """Level the gaps in place; return the free points, and their gaps with 0 elsewhere.

    The free points are those between the bounds, whose gap should be 0, and those at a bound whose
    gap requires a pressure inside.
    """
    inside = p > 0 if ceiling is None else (p > 0) & (p < ceiling)
    weight = inside.to(p.dtype)
    count = weight.sum((-2, -1), keepdim=True)
    level = _dot(weight, g) / count.clamp(min=1.0)
    if ceiling is None:
        free = inside | (g < level)
    else:
        yielding = p >= ceiling
        if bool((count == 0).any()):
            # All contact yields: any level between the least gap and the shallowest yield will do.
            least = g.masked_fill(yielding, inf).amin((-2, -1), keepdim=True)
            shallowest = g.masked_fill(~yielding, -inf).amax((-2, -1), keepdim=True)
            level = torch.where(count == 0, (least + shallowest) / 2, level)
        free = inside | torch.where(yielding, g > level, g < level)
    g.sub_(level)
    return free, g * free


def _with_mean(p: Tensor, mean: Tensor, ceiling: float | None, free: Tensor) -> Tensor:
    """Project pressures, nearly, onto those within the bounds that have their mean."""
    p = p.clamp(min=0.0, max=ceiling)
    # Each round sends points to a bound or ends.
    for _ in range(_MOST_ROUNDS):
        lacking = mean - p.mean((-2, -1), keepdim=True)
        if bool((lacking.abs() <= 1e-13 * mean).all()):
            break
        below = torch.ones_like(free) if ceiling is None else p < ceiling
        movable = torch.where(lacking > 0, below, p > 0)
        chosen = movable & free
        movable = torch.where(chosen.any(-1, True).any(-2, True), chosen, movable)
        share = movable.to(p.dtype)
        p.addcmul_(share, lacking / share.mean((-2, -1), keepdim=True)).clamp_(0.0, ceiling)
    return p
