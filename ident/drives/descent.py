"""Steps of a search on simulated positions: Levenberg-Marquardt within bounds, with derivatives along which nothing moves exact."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from .._utils.singular_values import pinv
from .plant import DrivePlant, joined
from .unknowns import Unknown

Array = np.ndarray
#: Damping factors that are tried beside each other in a step.
TRIED = np.array([0.03, 0.3, 3.0, 30.0, 1000.0])
#: A step that lowers the cost by less than this share ends the search.
SETTLED = 1e-5
#: Share of a parameter's size by which it is moved for a derivative: of a step, and of an interval. Where a joint comes to rest a step of
#: time earlier the motion has a small corner, and many of them make a derivative rough: over a wide difference they average out. Rough
#: derivatives are never quite alike, and what a log hardly distinguishes would seem distinguished.
_NUDGE, _WIDE = 3e-3, 6e-2
#: Where gains are unknown, all torque of a joint may nearly be exchanged for another, and what is left of that is next to nothing: a wide
#: difference is bent by more, and a narrow one is rough unless the steps of time (s) are small.
_NARROW, _FINEST = 3e-2, 1e-4
#: The last steps: so many at most, damping, and the share of a reading's variance that one is to take off.
_LAST, _HARDLY, _WORTH = 3, 1e-6, 1e-2
#: What scales with the torque of a joint, and the factors that are tried.
_TORQUE = (
    "armature", "viscous", "dry", "excess", "offset", "spring", "kp", "kd", "back_emf", "torque_scale", "effort_limit", "feed_forward",
    "ki", "integral_start",
)  # fmt: skip
_FACTORS = (1.0, 0.1, 0.3, 0.6, 0.8, 0.9, 1.1, 1.25, 1.6, 3.0, 10.0)
#: Seconds of a step of the last search at most, and steps in a sample at least: where a joint comes to rest depends on them, and the more
#: samples there are, the less of that may be left.
_FINE, _OF_A_SAMPLE = 2.5e-4, 20


@dataclass(frozen=True, eq=False)
class SimulatedSearch:
    """Residuals of simulated positions and steps that lower them. `centre`, `width` (p,): what is expected of the unknowns and how far
    off it may be; `near`: how much that counts; `exact`: what residuals are simulated with, where not with the plant itself; `share`: of an
    unknown by which it is moved for a derivative of an interval."""

    plant: DrivePlant
    measured: Array
    sizes: Array
    weights: Array
    centre: Array | float = 0.0
    width: Array | float = np.inf
    near: float = 1.0
    exact: DrivePlant | None = None
    share: float = _WIDE

    def fine(self) -> SimulatedSearch:
        """The same with residuals of smaller steps of time; what they change by is that of the usual ones."""
        period = min(log.period for log in self.plant.logs)
        return replace(self, exact=replace(self.plant, step=min(_FINE, period / _OF_A_SAMPLE, self.plant.longest)))

    def precise(self) -> SimulatedSearch:
        """The same with derivatives that distinguish what a log hardly does."""
        if not self._scales():
            return self
        return replace(
            self, plant=replace(self.plant, step=min(_FINEST, self.plant.longest)), exact=self.exact or self.plant, share=_NARROW
        )

    def coarse(self) -> SimulatedSearch:
        """The same in larger steps of time, where the samples leave room for them."""
        period = min(log.period for log in self.plant.logs)
        return replace(self, plant=replace(self.plant, step=max(self.plant.longest, min(0.5 * period, 2.5e-3))))

    @property
    def lower(self) -> Array:
        return np.array([u.lower for u in self.plant.unknowns])

    def residual(self, values: Array) -> Array:
        return self.residuals(values)[0]

    def costs(self, sets: Array) -> Array:
        """Sum of weighted squares of each set (Q,), inf where the motion has no bounds."""
        return self.costs_of(sets, self.residuals(sets))

    def residuals(self, sets: Array) -> Array:
        """Simulated less measured positions (Q, N, n) of sets (Q, p)."""
        return joined((self.exact or self.plant).positions(sets)) - self.measured

    def costs_of(self, sets: Array, found: Array) -> Array:
        """The same where the residuals (Q, N, n) are at hand."""
        off = (sets - self.centre) / self.width
        cost = np.sum(np.square(found * self.weights), axis=(1, 2)) + self.near * np.sum(off**2, axis=1)
        return np.where(np.isfinite(cost) & self.plant.possible(sets), cost, np.inf)

    def linear(self, values: Array, central: bool = False) -> tuple[Array, Array]:
        """Residual (N, n) and its derivatives (N, n, p), by differences: one-sided, or `central` where their precision counts."""
        share = self.share if central else _NUDGE
        nudge = share * np.maximum(np.abs(values), np.maximum(self.sizes, self._felt(values) if central else 0.0))
        slots = self._slots(range(len(values)))
        ahead = np.tile(values, (len(slots), 1))
        for row, members in zip(ahead, slots, strict=True):
            row[members] += nudge[members]
        behind, sides = ahead[:0], np.ones(len(slots))
        if central:
            behind, sides = self._within(values, ahead, 2.0 * values - ahead)
        exchanges = self._exchanges(values) if central else ()
        along = [values + sign * share * d for d in exchanges for sign in (1.0, -1.0)]
        found = joined(self.plant.positions(np.concatenate([values[None], ahead, behind, *(x[None] for x in along)])))
        plain, moved = found[0], found[1 : len(slots) + 1]
        other = found[len(slots) + 1 : 2 * len(slots) + 1] if central else plain
        change = (moved - other) / sides[:, None, None]
        slopes = np.zeros((*plain.shape, len(values)))
        self._spread(slopes, change, slots, nudge)
        if len(exchanges):
            ends = found[2 * len(slots) + 1 :]
            slopes = _exact_along(slopes, np.asarray(exchanges), (ends[::2] - ends[1::2]) / (2.0 * share), nudge / share)
        residual = plain - self.measured if self.exact is None else self.residual(values)
        return residual, np.nan_to_num(slopes)

    def _felt(self, values: Array) -> Array:
        """Sizes (p,) from which on a change is no matter of the instant at which a joint comes to rest, where links and gains are unknown
        together: of an offset that of friction, of a first moment the largest of all. Next to nothing, both seemed distinguished."""
        least = np.zeros(len(values))
        if self.plant.law.links_known or not self._scales():
            return least
        links = {i: u.name.split("_")[0][0] for i, u in enumerate(self.plant.unknowns) if u.place == "link"}
        for i, unknown in enumerate(self.plant.unknowns):
            dry = [abs(values[k]) for k, u in enumerate(self.plant.unknowns) if u.place == "dry" and u.joint == unknown.joint]
            if unknown.place == "offset":
                least[i] = max(dry, default=0.0)
            elif unknown.place == "link":
                least[i] = max(abs(values[k]) for k, symbol in links.items() if symbol == links[i])
        return least

    def _within(self, values: Array, ahead: Array, behind: Array) -> tuple[Array, Array]:
        """Sets behind (S, p), and how many of both sides count (S,). A side on which a joint has no mass moves beyond every bound, and is
        no part of a derivative: `ahead` and `behind` (S, p) are put to the values (p,) there."""
        lost = [~self.plant.possible(side) for side in (ahead, behind)]
        for side, gone in zip((ahead, behind), lost, strict=True):
            side[gone] = values
        return behind, np.maximum(2.0 - np.sum(lost, axis=0), 1.0)

    def along(self, values: Array, own: Array) -> Array:
        """Derivatives (N, n, m) along some of the unknowns (m,), one-sided."""
        nudge = _NUDGE * np.maximum(np.abs(values), self.sizes)
        slots = self._slots(own.tolist())
        sets = np.tile(values, (len(slots) + 1, 1))
        for row, members in zip(sets[1:], slots, strict=True):
            row[members] += nudge[members]
        found = joined(self.plant.positions(sets))
        slopes = np.zeros((*found.shape[1:], len(values)))
        self._spread(slopes, found[1:] - found[0], slots, nudge)
        return np.nan_to_num(slopes[..., own])

    def _spread(self, slopes: Array, change: Array, slots: list[list[int]], nudge: Array) -> None:
        """Write what each slot has changed into the slopes (N, n, p) of its members, each in its own branch."""
        branches = self.plant.branches
        for moves, members in zip(change, slots, strict=True):
            for i in members:
                unknown = self.plant.unknowns[i]
                at = slice(None) if unknown.joint < 0 else np.flatnonzero(branches == branches[unknown.joint])
                rows = self._rows(unknown)
                slopes[rows, at, i] = moves[rows, at] / nudge[i]

    def _rows(self, unknown: Unknown) -> slice:
        """The readings that an unknown can move: of its log, or all."""
        if not unknown.log:
            return slice(None)
        k, ends = self.plant.labels.index(unknown.log), np.cumsum([0, *(len(log.t) for log in self.plant.logs)])
        return slice(int(ends[k]), int(ends[k + 1]))

    def rescaled(self, values: Array) -> Array:
        """Values (p,) with all torque of single joints by other factors, where those are nearer: what scales it may be hard to see."""
        for joint in range(self.plant.robot.n) if self._scales() else ():
            own = [i for i, u in enumerate(self.plant.unknowns) if u.joint == joint and u.place in _TORQUE]
            beside = np.array([self._links_beside(self.plant.unknowns[i]) for i in own])
            sets = np.tile(values, (len(_FACTORS), 1))
            sets[:, own] = np.maximum((values[own] + beside) * np.array(_FACTORS)[:, None] - beside, self.lower[own])
            values = sets[int(np.argmin(self.costs(sets)))]
        return values

    def _scales(self) -> bool:
        return any(u.place in self.plant.law.scales for u in self.plant.unknowns)

    def _exchanges(self, values: Array) -> list[Array]:
        """Directions (p,) along which a motion may change next to nothing: kd or back-EMF for viscous friction, a deadband for dry
        friction, an offset for all that integrals begin with, and all torque of a joint by one factor, or of a branch with its links.
        Differences along them are taken by themselves: of those of single unknowns they would be what their errors leave, and make such
        unknowns seem determined."""
        unknown, out = self.plant.unknowns, []
        places = {(u.place, u.joint): i for i, u in enumerate(unknown)}
        for (place, joint), i in places.items():
            if place in ("kd", "back_emf") and (viscous := places.get(("viscous", joint))) is not None:
                direction = np.zeros(len(values))
                direction[[i, viscous]] = 1.0, -1.0 / unknown[viscous].factor
                out.append(direction * max(values[i], self.sizes[i]))
            if place == "deadband" and (dry := places.get(("dry", joint))) is not None:
                direction, stiff = np.zeros(len(values)), max(float(self.plant.stiffness(values)[joint]) / unknown[dry].factor, 1e-300)
                direction[[i, dry]] = 1.0, -stiff
                # Dry friction below nothing is none: it gives what it has.
                most = max(values[dry], _NARROW * self.sizes[dry]) / stiff
                out.append(direction * min(max(values[i], self.sizes[i]), most))
        for joint in range(self.plant.robot.n):
            begun = [i for i, u in enumerate(unknown) if u.place == "integral_start" and u.joint == joint]
            if len(begun) == len(self.plant.logs) and (offset := places.get(("offset", joint))) is not None:
                direction = np.zeros(len(values))
                direction[[offset, *begun]] = 1.0
                direction[offset] /= unknown[offset].factor
                out.append(direction * max(*np.abs(values[begun]), *self.sizes[begun]))
        scales = ("torque_scale",) if self.plant.law.in_volts else self.plant.law.scales
        return [*out, *(direction for scale in scales for direction in self._scaled(values, scale))]

    def _scaled(self, values: Array, scale: str) -> list[Array]:
        """Directions (p,) of all torque of a joint by one factor, or of a branch with its links, where its `scale` is unknown."""
        unknown, out = self.plant.unknowns, []
        apart = {"delay_s", "command_lag_s", "deadband", "load", "gear_loss", "gear_loss_slow", "slow_speed", "no_load_speed"}
        apart |= {"kp", "kd", "ki", "integral_start", "effort_limit"} if scale == "torque_scale" else {"torque_scale"}
        torque = [i for i, u in enumerate(unknown) if u.place not in apart]
        branches = self.plant.branches
        groups = [[i for i in torque if unknown[i].joint == joint] for joint in range(self.plant.robot.n)]
        if not self.plant.law.links_known:
            groups += [[i for i in torque if unknown[i].joint < 0 or branches[unknown[i].joint] == b] for b in np.unique(branches)]
        for own in groups:
            if any(unknown[i].place == scale and values[i] > 0 for i in own):
                direction = np.zeros(len(values))
                direction[own] = values[own] + [self._links_beside(unknown[i]) for i in own]
                # A share of the torque squared is the smaller the larger all torque is.
                direction[[i for i in own if unknown[i].place == "gear_loss_square"]] *= -1.0
                out.append(direction)
        return out

    def _links_beside(self, unknown: Unknown) -> float:
        """What stands beside an unknown and scales with it: beside a rotor the known links, since the sum of both is moved."""
        if unknown.place != "armature" or unknown.joint < 0 or not self.plant.law.links_known:
            return 0.0
        return float(self.plant.inertia[unknown.joint]) / unknown.factor

    def _slots(self, own: Iterable[int]) -> list[list[int]]:
        """Which of these unknowns can be moved together: those of different branches or logs, which do not act on each other."""
        slots: list[list[int]] = []
        for i in own:
            slot = next((slot for slot in slots if all(self._apart(i, k) for k in slot)), None)
            if slot is None:
                slots.append([i])
            else:
                slot.append(i)
        return slots

    def _apart(self, i: int, k: int) -> bool:
        """Whether two unknowns never move the same reading."""
        one, other = self.plant.unknowns[i], self.plant.unknowns[k]
        if one.log and other.log and one.log != other.log:
            return True
        branches = self.plant.branches
        return min(one.joint, other.joint) >= 0 and bool(branches[one.joint] != branches[other.joint])

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
            tried = damping * TRIED
            sets = np.stack([self.moved(values, J, r, factor) for factor in tried])
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

    def ended(self, values: Array) -> tuple[Array, Array, Array]:
        """Values (p,) after the last steps, residual (N, n) and derivatives (N, n, p): what intervals are computed from. A search that
        ended on derivatives less precise may not be at its end along what is hardly distinguished."""
        residual, slopes = self.linear(values, central=True)
        J = (slopes * self.weights[..., None]).reshape(-1, len(values))
        for _ in range(_LAST):
            r = (residual * self.weights).reshape(-1)
            to = self.moved(values, J, r, _HARDLY)
            predicted = float(r @ r) - float(np.sum(np.square(r + J @ (to - values))))
            if predicted < _WORTH * float(r @ r) / max(int(np.count_nonzero(self.weights)), 1):
                break
            there = self.residual(to)
            before, after = (float(self.costs_of(x[None], e[None])[0]) for x, e in ((values, residual), (to, there)))
            if not after < before:
                break
            values, residual = to, there
        return values, residual, slopes

    def moved(self, values: Array, J: Array, r: Array, damping: float) -> Array:
        """One damped step, unknowns at their bounds held there if they press against them."""
        hold = self.near / np.square(self.width) * np.ones(len(values))
        F, g = J.T @ J + np.diag(hold), J.T @ r + hold * (values - self.centre)
        floor = 1e-9 * np.max(np.diag(F) * self.sizes**2) / self.sizes**2
        A = F + np.diag(damping * (np.diag(F) + floor))
        move, free = np.zeros(len(values)), np.ones(len(values), bool)
        for _ in range(len(values)):
            held = ~free
            pull = g[free] + A[np.ix_(free, held)] @ move[held]
            # Where nothing is moved by anything (a joint at rest, a drive that is off) all of this is zero.
            move[free] = -np.linalg.solve(A[np.ix_(free, free)], pull) if A.any() else 0.0
            out = free & (values + move < self.lower)
            if not out.any():
                break
            move[out] = (self.lower - values)[out]
            free &= ~out
            if not free.any():
                break
        return np.maximum(values + move, self.lower)


def _exact_along(slopes: Array, directions: Array, changes: Array, scale: Array) -> Array:
    """Slopes (N, n, p) that agree with the changes (m, N, n) along directions (m, p), and differ from what they were by as little as can
    be, in units of `scale` (p,): an error that is put on one unknown alone would be all that its own weak direction shows.

    What moves nothing (a drive that is off) stays so."""
    along = directions / scale
    moving = np.any(slopes != 0.0, axis=(0, 1))
    missing = np.moveaxis(changes, 0, -1) - slopes @ directions.T
    return np.asarray(slopes + missing @ pinv((along * moving).T, rcond=1e-8) / scale)
