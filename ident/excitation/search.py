"""The search for a good trajectory: descent on the measure inside the limits, from several random starts.

Limits act as a logarithmic barrier that is lowered step by step, so every trajectory on the way is admissible; the last step
scales the trajectory until its true extremes, between samples too, lie within the limits."""

from __future__ import annotations

from functools import partial

import numpy as np

from ..effects.motion import Coordinates
from ..errors import ConfigurationError
from .candidate import TrajectoryCandidate
from .certificate import certify
from .clearance import Clearance, NearMemory
from .descent import descend
from .families import AnchoredFamily, Family
from .information import MotionInformation
from .limits import Limits
from .objective import Measure

Array = np.ndarray
_BARRIERS = (0.1, 0.01, 1e-3)
_CANDIDATES = 20
_PEAKS, _ZOOMS = 3, 8
#: Postures that are tried for one that is clear, shares to which a motion about it is scaled until it is, and the least that is left.
_POSTURES = 2000
_SHARES = (1.0, 0.8, 0.6, 0.45, 0.3, 0.2, 0.1, 0.05)
_LEAST = 0.02
#: Shares of the limits that random trajectories use, the next where there are none at the one before.
_START_SHARES = (0.7, 0.85, 0.95)
#: Seconds between the moments at which torque is looked at in the end, and how far it may exceed that between them, relative.
_TORQUE_STEP, _TORQUE_MARGIN = 1e-3, 2e-4


class TrajectorySearch:
    """One search problem. `limited_torque`: whether the parameter values allow a torque limit; `clearance`: what the motion keeps clear
    of, if anything; `posture` (n,): where it starts and ends, None: wherever is best."""

    def __init__(
        self,
        information: MotionInformation,
        limits: Limits,
        family: Family,
        measure: Measure,
        clearance: Clearance | None = None,
        posture: Array | None = None,
    ) -> None:
        self.information, self.limits, self.measure = information, limits, measure
        self.posture = posture
        self.family = family if posture is None else AnchoredFamily(family, posture)
        self.clearance = clearance
        self.n = limits.n
        self.limited_torque = information.values is not None and bool(np.isfinite(limits.torque).any())
        self.limited_jerk = bool(np.isfinite(limits.jerk).any())
        count = int(np.ceil(30 * family.highest_hz * family.duration)) + 1
        self.t = np.linspace(0.0, family.duration, max(count, 60))
        self.basis = self._bases(self.t)
        fine = 4 * (len(self.t) - 1) + 1
        self.fine_t = np.linspace(0.0, family.duration, fine)
        self.fine_basis = self._bases(self.fine_t)
        # Distances bend faster than a joint moves: they are looked at twice as often as the motion.
        self.clear_basis = self.fine_basis[0][::2]
        self.torque_t = np.linspace(0.0, family.duration, int(np.ceil(family.duration / _TORQUE_STEP)) + 1)
        self._memory = NearMemory()
        self._near: tuple[bytes, tuple[float, Array]] | None = None
        self._clear: Array | None = None

    def _bases(self, t: Array) -> tuple[Array, ...]:
        """Position, velocity, acceleration and, where it is limited, jerk per unit coefficient."""
        return (*self.family.basis(t), *((self.family.jerk(t),) if self.limited_jerk else ()))

    # --- one trajectory -----------------------------------------------------------------------------------------------

    def motion(self, offset: Array, coefficients: Array, basis: tuple[Array, ...]) -> Coordinates:
        """Motion at the times of a basis."""
        q, dq, ddq = (b @ coefficients for b in basis[:3])
        return Coordinates(q + offset, dq, ddq)

    def packed(self, offset: Array, coefficients: Array) -> Array:
        """What the descent moves in: coefficients, then the offset where it is free."""
        return np.concatenate([coefficients.reshape(-1), offset if self.posture is None else []])

    def unpacked(self, x: Array) -> tuple[Array, Array]:
        """Offset and coefficients."""
        if self.posture is not None:
            return self.posture, x.reshape(-1, self.n)
        return x[-self.n :], x[: -self.n].reshape(-1, self.n)

    def value(self, offset: Array, coefficients: Array) -> float:
        """The measure, limits aside."""
        info = self.information
        columns = info.columns(info.motion(self.t, self.motion(offset, coefficients, self.basis)))
        return self.measure.exact(info.matrix(columns), info.base.names)

    def barrier_value(self, x: Array, mu: float, wants_gradient: bool) -> tuple[float, Array | None]:
        """Measure plus mu × the mean barrier of the limits, and its gradient; inf outside the limits. x: as `packed` makes it."""
        info, limits = self.information, self.limits
        offset, coefficients = self.unpacked(x)
        joint = self.motion(offset, coefficients, self.basis)
        shares = limits.shares(joint, self.basis[3] @ coefficients if self.limited_jerk else None)
        if np.abs(shares).max() >= 1.0:
            return np.inf, None
        motion = info.motion(self.t, joint)
        columns = info.columns(motion)
        torque_share: Array | None = None
        if self.limited_torque:
            torque_share = info.joint_torque(columns) / limits.torque
            if np.abs(torque_share).max() >= 1.0:
                return np.inf, None
        value, dA = self.measure.evaluate(info.matrix(columns), info.base.names)
        if not np.isfinite(value):
            return np.inf, None
        near, near_slope = self.nearness(offset, coefficients)
        if not np.isfinite(near):
            return np.inf, None
        count = shares[0].size
        value += mu * near
        value -= mu * float(np.sum(np.log1p(-(shares**2)))) / count
        if torque_share is not None:
            value -= mu * float(np.sum(np.log1p(-(torque_share**2)))) / count
        if not wants_gradient:
            return value, None
        reach = np.stack([0.5 * (limits.upper - limits.lower), *(getattr(limits, kind) for kind in limits.kinds[1:])])
        slope = 2.0 * mu / count * shares / (1.0 - shares**2) / reach[:, None, :]
        d_torque = None
        if torque_share is not None:
            d_torque = 2.0 * mu / count * torque_share / (1.0 - torque_share**2) / limits.torque
        pull = info.pull(motion, columns, dA, d_torque)
        to_q, to_dq, to_ddq = pull.q + slope[0], pull.dq + slope[1], pull.ddq + slope[2]
        gradient = self.basis[0].T @ to_q + self.basis[1].T @ to_dq + self.basis[2].T @ to_ddq + mu * self.clear_basis.T @ near_slope[1:]
        if self.limited_jerk:
            gradient += self.basis[3].T @ slope[3]
        return value, self.packed(to_q.sum(axis=0) + mu * near_slope.sum(axis=0), gradient)

    # --- clearance ----------------------------------------------------------------------------------------------------

    def nearness(self, offset: Array, coefficients: Array) -> tuple[float, Array]:
        """The barrier of the clearance, and its gradient (T + 1, n): the first row at the offset, which stays clear so that a motion can be
        scaled down to it."""
        if self.clearance is None:
            return 0.0, np.zeros((len(self.clear_basis) + 1, self.n))
        q = np.vstack([offset, self.clear_basis @ coefficients + offset])
        key = q.tobytes()
        if self._near is None or self._near[0] != key:  # a step is asked for its value first, then for its gradient
            self._near = key, self.clearance.barrier(q, True, self._memory)
        return self._near[1]

    def is_clear(self, offset: Array, coefficients: Array) -> bool:
        """Whether the barrier of the clearance is finite."""
        return self.clearance is None or bool(
            (self.clearance.slack(self.clear_basis @ coefficients + offset, 0.01) > self.clearance.margin).all()
        )

    def cleared(self, offset: Array, coefficients: Array) -> Array | None:
        """The coefficients times the largest of some shares that keeps clear; None where even the smallest does not."""
        return next((s * coefficients for s in _SHARES if self.is_clear(offset, s * coefficients)), None)

    def certified(self, offset: Array, coefficients: Array) -> Array | None:
        """The coefficients, scaled down until torque holds and the motion keeps clear at every moment; None where hardly any is left."""
        share = 1.0
        while share > _LEAST:
            own = share * coefficients
            # A smaller motion takes less speed, but not always less torque.
            if self.torque_share(offset, own, self.torque_t) <= 1.0 and (
                self.clearance is None or certify(self.clearance, self.family.build(offset, own), self.limits).holds
            ):
                return own
            share *= 0.97 if share > 0.5 else 0.8
        return None

    def _postures(self, rng: np.random.Generator) -> Array:
        """Random postures (K, n) that are clear. Raises ConfigurationError, saying what is in the way, where there is none."""
        if self.posture is not None:
            return np.repeat(self.posture[None], 5, axis=0)
        reach = 0.5 * (self.limits.upper - self.limits.lower)
        if self.clearance is None:
            return self.limits.middle + rng.uniform(-0.5, 0.5, (_POSTURES // 10, self.n)) * reach
        if self._clear is None:
            self._clear = self._clear_postures(self.limits.middle + rng.uniform(-0.8, 0.8, (_POSTURES, self.n)) * reach)
        return rng.permutation(self._clear)

    def _clear_postures(self, offsets: Array) -> Array:
        """Those of some postures (K, n) that are clear."""
        assert self.clearance is not None
        slack = self.clearance.slack(offsets, 0.01) - self.clearance.margin
        clear = offsets[(slack > 0.0).all(axis=1)]
        if len(clear):
            return clear
        blocked = np.mean(slack <= 0.0, axis=0)
        worst = ", ".join(f"{self.clearance.constraints[k].what} ({100 * blocked[k]:.0f} %)" for k in np.argsort(-blocked)[:3])
        raise ConfigurationError(
            f"excitation: none of {_POSTURES} random postures within the limits keeps {1000 * self.clearance.surroundings.clearance:g} mm"
            f" clear. Nearer in most of them: {worst}. Allow more room (ground, workspace, clearance), or give other position limits."
        )

    def _level(self, mu: float, x: Array, wants_gradient: bool) -> tuple[float, Array | None]:
        return self.barrier_value(x, mu, wants_gradient)

    # --- limits -------------------------------------------------------------------------------------------------------

    def extremes(self, coefficients: Array) -> Array:
        """True extremes of the motion about its offset, (4 or 5, n): highest and lowest position, largest speed, acceleration and, where
        it is limited, jerk."""

        def signals(basis: tuple[Array, ...]) -> Array:
            q, *rates = (b @ coefficients for b in basis)
            return np.stack([q, -q, *(np.abs(x) for x in rates)])

        values = signals(self.fine_basis)
        found = values.max(axis=1)
        # The highest peaks of each signal between samples, found by zooming in on the highest ones at samples.
        padded = np.pad(values, ((0, 0), (1, 1), (0, 0)), constant_values=-np.inf)
        peak = (values >= padded[:, :-2]) & (values >= padded[:, 2:])
        ranked = np.argsort(np.where(peak, values, -np.inf), axis=1)[:, -_PEAKS:]  # (kinds, peaks, n)
        places = np.indices(ranked.shape).reshape(3, -1)
        kind, joint, centre = places[0], places[2], self.fine_t[ranked].reshape(-1)
        step = float(self.fine_t[1])
        for _ in range(_ZOOMS):
            at = np.clip(centre[:, None] + np.linspace(-step, step, 9), 0.0, self.family.duration)
            near = signals(self._bases(at.reshape(-1))).reshape(len(found), len(centre), 9, self.n)
            own = near[kind, np.arange(len(centre)), :, joint]
            best = own.argmax(axis=1)
            centre = at[np.arange(len(centre)), best]
            np.maximum.at(found, (kind, joint), own.max(axis=1))
            step /= 4.0
        found[1] *= -1.0
        return found

    def torque_share(self, offset: Array, coefficients: Array, t: Array) -> float:
        """The largest share of any torque limit at uniform times t, with a margin for what lies between them."""
        if not self.limited_torque:
            return 0.0
        joint = self.family.build(offset, coefficients).sample(t)
        torque = np.concatenate([self.information.torque(t, joint), self.information.torque_at_reversals(t, joint)])
        return float(np.abs(torque / self.limits.torque).max()) * (1.0 + _TORQUE_MARGIN)

    def scaled(self, offset: Array, coefficients: Array, share: float) -> Array | None:
        """The coefficients times the largest factor that keeps within `share` of the limits; None if rest itself does not."""
        limits = self.limits
        reach = 0.5 * (limits.upper - limits.lower) * share
        if self.torque_share(offset, 0.0 * coefficients, self.fine_t[:2]) > share:
            return None
        high, low, *rates = self.extremes(coefficients)
        tiny = 1e-300
        factor = min(
            float(np.min((limits.middle + reach - offset) / np.maximum(high, tiny))),
            float(np.min((offset - limits.middle + reach) / np.maximum(-low, tiny))),
            *(float(np.min(share * getattr(limits, k) / np.maximum(x, tiny))) for k, x in zip(limits.kinds[1:], rates, strict=True)),
        )
        if factor <= 0:
            return None
        if self.torque_share(offset, factor * coefficients, self.fine_t) > share:
            inside, outside = 0.0, factor
            for _ in range(20):
                middle = 0.5 * (inside + outside)
                if self.torque_share(offset, middle * coefficients, self.fine_t) <= share:
                    inside = middle
                else:
                    outside = middle
            factor = inside
        # What coarse samples let pass is seen by fine ones.
        while factor > 0 and self.torque_share(offset, factor * coefficients, self.torque_t) > share:
            factor = 0.998 * factor if factor > 1e-6 else 0.0
        return factor * coefficients if factor > 0 else None

    def random(self, rng: np.random.Generator, share: float = 1.0) -> TrajectoryCandidate:
        """A random trajectory scaled to use `share` of the limits. Raises ConfigurationError if gravity alone exceeds the torque limits."""
        held_up = False
        for postures in (self._postures, self._easy):
            for offset in postures(rng)[:200]:
                coefficients = self.scaled(offset, self.family.random(self.n, rng), share)
                held_up |= coefficients is not None
                coefficients = None if coefficients is None else self.cleared(offset, coefficients)
                if coefficients is not None:
                    return TrajectoryCandidate(offset, coefficients, self.value(offset, coefficients))
        raise ConfigurationError(self._refusal(rng, held_up, share))

    def _holding(self, postures: Array) -> Array:
        """Shares (K, n) of the torque limits that holding postures (K, n) still takes."""
        still = Coordinates(postures, np.zeros_like(postures), np.zeros_like(postures))
        return np.abs(self.information.torque(np.arange(len(postures)) * 0.01, still) / self.limits.torque)

    def _easy(self, rng: np.random.Generator) -> Array:
        """Postures (K, n), in random order, that take the least torque to hold of many that are clear: for where random ones fail."""
        if not self.limited_torque or self.posture is not None:
            return self._postures(rng)
        reach = 0.5 * (self.limits.upper - self.limits.lower)
        many = self._clear if self._clear is not None else self.limits.middle + rng.uniform(-0.9, 0.9, (_POSTURES, self.n)) * reach
        worst = self._holding(many).max(axis=1)
        return rng.permutation(many[np.argsort(worst)[: max(20, len(many) // 20)]])

    def _refusal(self, rng: np.random.Generator, held_up: bool, share: float) -> str:
        """Why there is no random trajectory."""
        if held_up:
            where = (
                "the posture given for the start the robot cannot"
                if self.posture is not None
                else "none of many clear postures can the robot"
            )
            return (
                f"excitation: about {where} move without coming too near to something; allow more room (ground, workspace, clearance), or"
                " another start."
            )
        holding = self._holding(self._easy(rng))
        easiest = holding[int(holding.max(axis=1).argmin())]
        j = int(easiest.argmax())
        where = "the posture given for the start" if self.posture is not None else "the easiest of many random postures"
        return (
            f"excitation: the torque limits leave no room to move: in {where} joint {self.information.model.robot.joint_names[j]} takes"
            f" {100 * easiest[j]:.0f} % of its limit merely to hold still (at most {100 * share:.0f} % may be). Raise the torque limits, or"
            " give other positions."
        )

    # --- search -------------------------------------------------------------------------------------------------------

    def run(self, rng: np.random.Generator, iterations: int) -> TrajectoryCandidate | None:
        """Descent from the best of some random trajectories; None where what it finds cannot be shown to keep clear."""
        first = min(self._starts(rng), key=lambda c: c.value)
        x = self.packed(first.offset, first.coefficients)
        for mu in _BARRIERS:
            x = descend(partial(self._level, mu), x, iterations)
        offset, coefficients = self.unpacked(x)
        full = self.scaled(offset, coefficients, 1.0 - 1e-10)
        if full is None:
            offset, full = first.offset, first.coefficients
            coefficients = full
        # The largest motion is not always the best conditioned.
        own = coefficients if np.linalg.norm(coefficients) <= np.linalg.norm(full) else full
        kept = [c for c in (self.certified(offset, full), self.certified(offset, own)) if c is not None]
        return min((TrajectoryCandidate(offset, c, self.value(offset, c)) for c in kept), key=lambda c: c.value, default=None)

    def _starts(self, rng: np.random.Generator) -> list[TrajectoryCandidate]:
        """Random trajectories to start from, at the least of some shares of the limits at which there are any."""
        refused: list[ConfigurationError] = []
        for share in _START_SHARES:
            try:
                return [self.random(rng, share) for _ in range(_CANDIDATES)]
            except ConfigurationError as error:
                refused.append(error)
        raise refused[-1]
