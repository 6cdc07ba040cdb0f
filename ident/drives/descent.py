"""Steps of a search on simulated positions: Levenberg-Marquardt within bounds, with derivatives along which nothing moves exact."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .plant import DrivePlant, joined

Array = np.ndarray
#: Damping factors that are tried beside each other in a step.
_TRIED = np.array([0.03, 0.3, 3.0, 30.0, 1000.0])
#: A step that lowers the cost by less than this share ends the search.
SETTLED = 1e-5
#: Share of a parameter's size by which it is moved for a derivative: of a step, and of an interval. Where a joint comes to rest a step of
#: time earlier the motion has a small corner, and many of them make a derivative rough: over a wide difference they average out. Rough
#: derivatives are never quite alike, and what a log hardly distinguishes would seem distinguished.
_NUDGE, _WIDE = 3e-3, 6e-2
#: What scales with the torque of a joint, and the factors that are tried.
_TORQUE = ("armature", "viscous", "dry", "excess", "offset", "spring", "kp", "kd", "back_emf", "torque_scale", "effort_limit")
_FACTORS = (1.0, 0.1, 0.3, 0.6, 0.8, 0.9, 1.1, 1.25, 1.6, 3.0, 10.0)
#: Seconds of a step of the last search at most, and steps in a sample at least: where a joint comes to rest depends on them, and the more
#: samples there are, the less of that may be left.
_FINE, _OF_A_SAMPLE = 2.5e-4, 20


@dataclass(frozen=True, eq=False)
class SimulatedSearch:
    """Residuals of simulated positions and steps that lower them. `centre`, `width` (p,): what is expected of the unknowns and how far
    off it may be; `near`: how much that counts; `exact`: what residuals are simulated with, where not with the plant itself."""

    plant: DrivePlant
    measured: Array
    sizes: Array
    weights: Array
    centre: Array | float = 0.0
    width: Array | float = np.inf
    near: float = 1.0
    exact: DrivePlant | None = None

    def fine(self) -> SimulatedSearch:
        """The same with residuals of smaller steps of time; what they change by is that of the usual ones."""
        period = min(log.period for log in self.plant.logs)
        return replace(self, exact=replace(self.plant, step=min(_FINE, period / _OF_A_SAMPLE, self.plant.longest)))

    def coarse(self) -> SimulatedSearch:
        """The same in larger steps of time, where the samples leave room for them."""
        period = min(log.period for log in self.plant.logs)
        return replace(self, plant=replace(self.plant, step=max(self.plant.longest, min(0.5 * period, 2.5e-3))))

    @property
    def lower(self) -> Array:
        return np.array([u.lower for u in self.plant.unknowns])

    def residual(self, values: Array) -> Array:
        return joined((self.exact or self.plant).positions(values))[0] - self.measured

    def costs(self, sets: Array) -> Array:
        """Sum of weighted squares of each set (Q,), inf where the motion has no bounds."""
        found = joined((self.exact or self.plant).positions(sets)) - self.measured
        off = (sets - self.centre) / self.width
        cost = np.sum(np.square(found * self.weights), axis=(1, 2)) + self.near * np.sum(off**2, axis=1)
        return np.where(np.isfinite(cost) & self.plant.possible(sets), cost, np.inf)

    def linear(self, values: Array, central: bool = False) -> tuple[Array, Array]:
        """Residual (N, n) and its derivatives (N, n, p), by differences: one-sided, or `central` where their precision counts."""
        share = _WIDE if central else _NUDGE
        nudge = share * np.maximum(np.abs(values), self.sizes)
        slots = self._slots()
        ahead = np.tile(values, (len(slots), 1))
        for row, members in zip(ahead, slots, strict=True):
            row[members] += nudge[members]
        behind = 2.0 * values - ahead if central else ahead[:0]
        exchanges = self._exchanges(values) if central else []
        along = [values + sign * share * d for _, d in exchanges for sign in (1.0, -1.0)]
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
                slopes[..., pivot] = ((one - other) / (2.0 * share) - slopes @ others) / direction[pivot]
        residual = plain - self.measured if self.exact is None else self.residual(values)
        return residual, np.nan_to_num(slopes)

    def rescaled(self, values: Array) -> Array:
        """Values (p,) with all torque of single joints by other factors, where those are nearer: what scales it may be hard to see."""
        for joint in range(self.plant.robot.n) if self._scales() else ():
            own = [i for i, u in enumerate(self.plant.unknowns) if u.joint == joint and u.place in _TORQUE]
            sets = np.tile(values, (len(_FACTORS), 1))
            sets[:, own] *= np.array(_FACTORS)[:, None]
            values = sets[int(np.argmin(self.costs(sets)))]
        return values

    def _scales(self) -> bool:
        return any(u.place in ("kp", "torque_scale") for u in self.plant.unknowns)

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

    def run(self, values: Array, steps: int, near: float = SETTLED) -> tuple[Array, float, bool, int]:
        """Values, cost, whether it settled, steps taken."""
        values = np.maximum(values, self.lower)
        cost, damping = float(self.costs(values[None])[0]), 1e-2
        if not np.isfinite(cost):
            return values, cost, False, 0
        # A scale of all torque is seen by little: derivatives along it have to be exact.
        central = self._scales() and self.exact is not None
        for step in range(steps):
            residual, slopes = self.linear(values, central)
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
