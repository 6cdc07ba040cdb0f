"""Least squares on simulated positions: Levenberg-Marquardt steps within bounds, from several starts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..errors import DataError
from .plant import DrivePlant, joined
from .starts import expected

Array = np.ndarray
#: Damping factors that are tried beside each other in a step.
_TRIED = np.array([0.03, 0.3, 3.0, 30.0, 1000.0])
#: A step that lowers the cost by less than this share ends the search: a coarse one, and the last.
_NEAR = 1e-3
_SETTLED = 1e-5
#: Share of a parameter's size by which it is moved for a derivative.
_NUDGE = 3e-3
#: While residuals count in units of the motion, not of their own size, what is expected counts so little.
_COARSE = 1e-3
#: So many starts are followed for a few steps.
_FOLLOWED, _SHORT = 3, 6
#: Where a joint comes to rest makes valleys of their own: from the best end of a single joint, which is simulated in no time, dry friction
#: is set to these shares of it, the others make up for that, and the offset is none.
_HOPS = (0.3, 0.6, 1.6, 3.0)


@dataclass(frozen=True, eq=False)
class Fitted:
    """Values (p,) with the residual (N, n) in rad, its derivatives (N, n, p), weights (N, n), and whether the search settled.

    A reading that does not count has weight 0."""

    values: Array
    residual: Array
    slopes: Array
    weights: Array
    settled: bool
    steps: int

    @property
    def rms(self) -> Array:
        """Position error (n,), over all readings."""
        return np.sqrt(np.mean(self.residual**2, axis=0))

    @property
    def cost(self) -> float:
        """Sum of weighted squares."""
        return float(np.sum(np.square(self.residual * self.weights)))


def fitted(
    plant: DrivePlant, starts: Array, sizes: Array, *, counted: Array | None = None, steps: int = 40,
    progress: Callable[[float], None] | None = None,
) -> Fitted:  # fmt: skip
    """From starts (S, p): the better ones are followed coarsely, the best to the end, then again with weights from its own residual.

    `sizes` (p,): what is a usual size of each unknown. `counted` (N, n): which readings count; by default those that are no repeat."""
    measured = np.concatenate([log.q for log in plant.logs])
    fresh = np.concatenate([log.fresh for log in plant.logs]) if counted is None else counted
    counts = np.maximum(fresh.sum(axis=0), 1)
    spread = np.maximum(np.std(measured, axis=0), 1e-6)
    search = _SimulatedSearch(plant, measured, sizes, fresh / spread, *expected(plant), near=_COARSE)
    coarse = search.coarse()
    costs = coarse.costs(starts)
    order = [i for i in np.argsort(costs)[:_FOLLOWED] if np.isfinite(costs[i])]
    if not order:
        raise DataError("no start of the simulation stays within bounds: check the signs of commands and positions, and the gains.")
    ends = [coarse.run(starts[i], _SHORT, _NEAR) for i in order]
    best = min(ends, key=lambda end: end[1])
    best = coarse.run(best[0], steps, _NEAR)
    if plant.robot.n == 1:
        best = min([best, *(coarse.run(hop, 2 * _SHORT, _NEAR) for hop in _hops(coarse, best[0]))], key=lambda end: end[1])
    if progress is not None:
        progress(0.4)
    values, _, _, _ = search.run(best[0], steps)
    residual = search.residual(values)
    rms = np.sqrt(np.sum(np.square(residual * fresh), axis=0) / counts)
    search = replace(search, weights=fresh / np.maximum(rms, 1e-3 * spread), near=1.0)
    values, _, settled, used = search.run(values, steps)
    if progress is not None:
        progress(1.0)
    residual, slopes = search.linear(values, central=True)
    return Fitted(values, residual, slopes, search.weights, settled, used)


def _hops(search: _SimulatedSearch, values: Array) -> list[Array]:
    """Starts (p,) beside the best end, from which another valley may be found; what can make up for a change of friction does."""
    places = np.array([u.place for u in search.plant.unknowns])
    dry = np.flatnonzero(places == "dry")
    if not len(dry) or len(values) < 2:
        return []
    _, slopes = search.linear(values)
    J = (slopes * search.weights[..., None]).reshape(-1, len(values)) * search.sizes
    others = np.setdiff1d(np.arange(len(values)), dry)
    along = -np.linalg.lstsq(J[:, others], J[:, dry].sum(axis=1), rcond=1e-6)[0]
    out = []
    for share in _HOPS:
        hop, change = values.copy(), (share - 1.0) * float(np.mean(values[dry] / search.sizes[dry]))
        hop[dry] *= share
        moved = hop[others] + change * along * search.sizes[others]
        least = np.minimum(0.5 * hop[others], 2.0 * hop[others])
        hop[others] = np.clip(moved, least, 2.5 * hop[others] - least)
        hop[places == "offset"] = 0.0
        out.append(np.maximum(hop, search.lower))
    return out


def refitted(plant: DrivePlant, values: Array, sizes: Array, weights: Array, *, steps: int = 15) -> Fitted:
    """From near values (p,) on, with weights (N, n) that stay: costs of several models are then of one kind."""
    measured = np.concatenate([log.q for log in plant.logs])
    search = _SimulatedSearch(plant, measured, sizes, weights, *expected(plant))
    values, _, settled, used = search.run(values, steps)
    residual, slopes = search.linear(values, central=True)
    return Fitted(values, residual, slopes, weights, settled, used)


def followed(plant: DrivePlant, values: Array, sizes: Array, weights: Array, *, steps: int) -> tuple[float, Array]:
    """Cost and values (p,) after a few steps from near values on."""
    measured = np.concatenate([log.q for log in plant.logs])
    values, cost, _, _ = _SimulatedSearch(plant, measured, sizes, weights, *expected(plant)).run(values, steps, _NEAR)
    return cost, values


def sensitivities(plant: DrivePlant, values: Array, sizes: Array) -> tuple[Array, Array]:
    """Simulated less measured positions (N, n) at values (p,), and their derivatives (N, n, p)."""
    measured = np.concatenate([log.q for log in plant.logs])
    return _SimulatedSearch(plant, measured, sizes, np.ones_like(measured)).linear(values)


@dataclass(frozen=True, eq=False)
class _SimulatedSearch:
    """`centre`, `width` (p,): what is expected of the unknowns and how far off it may be; `near`: how much that counts."""

    plant: DrivePlant
    measured: Array
    sizes: Array
    weights: Array
    centre: Array | float = 0.0
    width: Array | float = np.inf
    near: float = 1.0

    def coarse(self) -> _SimulatedSearch:
        """The same in larger steps of time, where the samples leave room for them."""
        period = min(log.period for log in self.plant.logs)
        return replace(self, plant=replace(self.plant, step=max(self.plant.longest, min(0.5 * period, 2.5e-3))))

    @property
    def lower(self) -> Array:
        return np.array([u.lower for u in self.plant.unknowns])

    def residual(self, values: Array) -> Array:
        return joined(self.plant.positions(values))[0] - self.measured

    def costs(self, sets: Array) -> Array:
        """Sum of weighted squares of each set (Q,), inf where the motion has no bounds."""
        found = joined(self.plant.positions(sets)) - self.measured
        off = (sets - self.centre) / self.width
        cost = np.sum(np.square(found * self.weights), axis=(1, 2)) + self.near * np.sum(off**2, axis=1)
        return np.where(np.isfinite(cost), cost, np.inf)

    def linear(self, values: Array, central: bool = False) -> tuple[Array, Array]:
        """Residual (N, n) and its derivatives (N, n, p), by differences: one-sided, or `central` where their precision counts."""
        nudge = _NUDGE * np.maximum(np.abs(values), self.sizes)
        slots = self._slots()
        ahead = np.tile(values, (len(slots), 1))
        for row, members in zip(ahead, slots, strict=True):
            row[members] += nudge[members]
        behind = 2.0 * values - ahead if central else ahead[:0]
        exchanges = self._exchanges(values) if central else []
        along = [values + sign * _NUDGE * d for _, d in exchanges for sign in (1.0, -1.0)]
        found = joined(self.plant.positions(np.concatenate([values[None], ahead, behind, *(x[None] for x in along)])))
        plain, moved = found[0], found[1 : len(slots) + 1]
        change = 0.5 * (moved - found[len(slots) + 1 : 2 * len(slots) + 1]) if central else moved - plain
        slopes = np.zeros((*plain.shape, len(values)))
        branches = self.plant.branches
        for moves, members in zip(change, slots, strict=True):
            for i in members:
                joint = self.plant.unknowns[i].joint
                own = slice(None) if joint < 0 else np.flatnonzero(branches == branches[joint])
                slopes[:, own, i] = moves[:, own] / nudge[i]
        for k, (pivot, direction) in enumerate(exchanges):
            one, other = found[2 * len(slots) + 1 + 2 * k :][:2]
            others = np.where(np.arange(len(values)) == pivot, 0.0, direction)
            # A drive that is off: its constants move nothing, and nothing is to be said of them.
            if np.any(slopes[..., pivot]):
                slopes[..., pivot] = ((one - other) / (2.0 * _NUDGE) - slopes @ others) / direction[pivot]
        return plain - self.measured, np.nan_to_num(slopes)

    def _exchanges(self, values: Array) -> list[tuple[int, Array]]:
        """Directions (p,) along which a motion may not change at all, each with an unknown that moves along it: kd or back-EMF for
        viscous friction, and all torque of a branch by one factor. Differences along them are exact where those of single
        unknowns would leave a trace of their own error, and make such unknowns seem determined."""
        unknown, out = self.plant.unknowns, []
        places = {(u.place, u.joint): i for i, u in enumerate(unknown)}
        for (place, joint), i in places.items():
            if place in ("kd", "back_emf") and (viscous := places.get(("viscous", joint))) is not None:
                direction = np.zeros(len(values))
                direction[[i, viscous]] = 1.0, -1.0
                out.append((i, direction * max(values[i], self.sizes[i])))
        scale = "torque_scale" if self.plant.law.kind == "pwm" else "kp"
        apart = {
            "delay_s",
            "load",
            "gear_loss",
            "gear_loss_slow",
            "slow_speed",
            *({"kp", "kd", "effort_limit"} if scale == "torque_scale" else {"torque_scale"}),
        }
        branches = self.plant.branches
        for branch in np.unique(branches):
            own = [i for i, u in enumerate(unknown) if u.place not in apart and (u.joint < 0 or branches[u.joint] == branch)]
            pivots = [i for i in own if unknown[i].place == scale and values[i] > 0]
            if pivots:
                direction = np.zeros(len(values))
                direction[own] = values[own]
                # A share of the torque squared is the smaller the larger all torque is.
                direction[[i for i in own if unknown[i].place == "gear_loss_square"]] *= -1.0
                out.append((pivots[-1], direction))
        return out

    def _slots(self) -> list[list[int]]:
        """Unknowns that can be moved together: those of different branches, which do not act on each other."""
        slots: list[list[int]] = []
        for i, unknown in enumerate(self.plant.unknowns):
            branch = -1 if unknown.joint < 0 else int(self.plant.branches[unknown.joint])
            for slot in slots:
                others = {self.plant.branches[self.plant.unknowns[k].joint] if self.plant.unknowns[k].joint >= 0 else -1 for k in slot}
                if branch >= 0 and -1 not in others and branch not in others:
                    slot.append(i)
                    break
            else:
                slots.append([i])
        return slots

    def run(self, values: Array, steps: int, near: float = _SETTLED) -> tuple[Array, float, bool, int]:
        """Values, cost, whether it settled, steps taken."""
        values = np.maximum(values, self.lower)
        cost, damping = float(self.costs(values[None])[0]), 1e-2
        if not np.isfinite(cost):
            return values, cost, False, 0
        for step in range(steps):
            residual, slopes = self.linear(values)
            J = (slopes * self.weights[..., None]).reshape(-1, len(values))
            r = (residual * self.weights).reshape(-1)
            tried = damping * _TRIED
            sets = np.stack([self._moved(values, J, r, factor) for factor in tried])
            costs = self.costs(sets)
            best = int(np.argmin(costs))
            gain = (cost - costs[best]) / max(cost, 1e-300)
            if gain <= 0:
                damping *= 1e3
                if damping > 1e8:
                    return values, cost, True, step + 1
                continue
            values, cost, damping = sets[best], float(costs[best]), max(1e-9, tried[best])
            if gain < near:
                return values, cost, True, step + 1
        return values, cost, False, steps

    def _moved(self, values: Array, J: Array, r: Array, damping: float) -> Array:
        """One damped step, unknowns at their bounds held there if they press against them."""
        hold = self.near / np.square(self.width) * np.ones(len(values))
        F, g = J.T @ J + np.diag(hold), J.T @ r + hold * (values - self.centre)
        floor = 1e-9 * np.max(np.diag(F) * self.sizes**2) / self.sizes**2
        A = F + np.diag(damping * (np.diag(F) + floor))
        move, free = np.zeros(len(values)), np.ones(len(values), bool)
        for _ in range(len(values)):
            held = ~free
            move[free] = -np.linalg.solve(A[np.ix_(free, free)], g[free] + A[np.ix_(free, held)] @ move[held])
            out = free & (values + move < self.lower)
            if not out.any():
                break
            move[out] = (self.lower - values)[out]
            free &= ~out
            if not free.any():
                break
        return np.maximum(values + move, self.lower)
