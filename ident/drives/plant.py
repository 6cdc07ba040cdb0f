"""Logs, model and drive law as one simulation: from sets of unknowns to simulated positions at the samples of every log."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..effects.rigid_body import RigidBody
from ..errors import ConfigurationError
from ..friction.speed import Stribeck
from ..robots.transmission import Side
from ..simulation.rigid import RigidDynamics, require_fixed_base
from .commands import DriveLog
from .law import DriveLaw
from .links import ElasticLinks, FreeLinks, KnownLinks
from .sent import means
from .simulate import LaneDrives, LaneIntegrals, LinkTerms, simulated
from .unknowns import Unknown, unknowns

if TYPE_CHECKING:
    from ..model import Model
    from ..robots.robot import Robot

Array = np.ndarray
#: Seconds of a step at most; of a single joint, which is simulated in no time: where it comes to rest depends on the step.
STEP, _SINGLE = 1e-3, 5e-4
#: Numbers that a block of lanes may hold at a time.
_AT_ONCE = 40_000_000
_DRIVE = ("armature", "viscous", "dry", "load", "excess", "offset", "spring")
_GEAR = {"loss": "gear_loss", "loss_square": "gear_loss_square", "loss_slow": "gear_loss_slow", "slow": "slow_speed"}


@dataclass(frozen=True, eq=False)
class _Lanes:
    """What one log's lanes are simulated with."""

    target: Array
    strength: Array | None
    integrals: LaneIntegrals | None
    drive: dict[str, Array]
    inertial: Array | None
    stiffness: Array
    twist: Array


@dataclass(frozen=True, eq=False)
class DrivePlant:
    """A model under a drive law, and the logs to be simulated. `step`: seconds of a step at most, 0: the usual one."""

    model: Model
    law: DriveLaw
    logs: tuple[DriveLog, ...]
    step: float = 0.0

    def __post_init__(self) -> None:
        require_fixed_base(self.robot)
        if not self.robot.loop.is_trivial:
            raise ConfigurationError(f"robot {self.robot.name!r} has loop closures, which fits under a drive law do not support yet.")

    @property
    def robot(self) -> Robot:
        return self.model.robot

    @property
    def longest(self) -> float:
        """Seconds of a step at most."""
        return self.step or (_SINGLE if self.robot.n == 1 else STEP)

    @cached_property
    def inertia(self) -> Array:
        """What each joint moves of known links (n,), kg m² (kg), on average over the logs; zero where links are unknown and have no nominal
        parameters."""
        if not self.law.links_known and self.robot.nominal is None:
            return np.zeros(self.robot.n)
        q = np.concatenate([log.q[:: max(1, len(log.q) // 20)] for log in self.logs])
        H, _ = RigidDynamics(self.robot, self.nominal).terms(q, np.zeros_like(q))
        return np.asarray(np.diagonal(H, axis1=1, axis2=2).mean(axis=0))

    @cached_property
    def unknowns(self) -> tuple[Unknown, ...]:
        """What is to be identified."""
        return unknowns(self.model, self.law, self.integral_starts)

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """Names of the logs, each of them once."""
        names = [log.name for log in self.logs]
        return tuple(name if names.count(name) == 1 else f"{name} #{names[: i + 1].count(name)}" for i, name in enumerate(names))

    @cached_property
    def integral_starts(self) -> tuple[tuple[str, int], ...]:
        """Log and joint of each integral whose start is not known: what is declared is that of the recording's beginning."""
        open_ = [np.isnan(self.law.for_log(log.name).constants["integral_start"]) | log.later for log in self.logs]
        return tuple(
            (label, int(j)) for label, of in zip(self.labels, open_, strict=True) for j in np.flatnonzero(of & self.law.integrates)
        )

    @cached_property
    def nominal(self) -> Array:
        """Inertial parameters (10 nb,) of the URDF."""
        if self.robot.nominal is None:
            raise ConfigurationError(
                f'the URDF of robot {self.robot.name!r} has no inertials, so its dynamics are unknown: set [drive] links = "identify".'
            )
        return np.asarray(self.robot.nominal, float)

    @cached_property
    def groups(self) -> list[slice]:
        """Joints of which none acts on another: those at the same place of like branches from the base, else each by itself."""
        n, branches = self.robot.n, self.branches
        count = int(branches.max()) + 1
        alike = n % count == 0 and np.array_equal(branches, np.repeat(np.arange(count), n // count))
        return [slice(k, None, n // count) for k in range(n // count)] if alike else [slice(j, j + 1) for j in range(n)]

    @cached_property
    def branches(self) -> Array:
        """(n,) number of the branch from the base on which each joint stands: joints of two branches do not act on each other."""
        roots = np.zeros(self.robot.n, int)
        for i in range(self.robot.n):
            up = int(self.robot.tree.parent[i])
            roots[i] = i if up < 0 else roots[up]
        return np.unique(roots, return_inverse=True)[1]

    def positions(self, sets: Array) -> list[Array]:
        """Simulated positions (Q, N, n) at the samples of each log for sets of unknowns (Q, p); NaN where a motion has no bounds."""
        sets = np.atleast_2d(sets)
        h = self._step()
        counts = [int(np.ceil(log.duration / h - 1e-6)) for log in self.logs]
        most = max(1, _AT_ONCE // (max(counts) * self.robot.n * len(self.logs)))
        blocks = [self._together(sets[i : i + most], h, counts) for i in range(0, len(sets), most)]
        return [np.concatenate(parts) for parts in zip(*blocks, strict=True)]

    def possible(self, sets: Array) -> Array:
        """(Q,) whether joints with sets of unknowns (Q, p) have mass in every direction: large steps may hide that they have not."""
        if self.law.links_known:
            return np.ones(len(sets), bool)
        log = self.logs[0]
        _, drive, inertial = self._split(log, sets)
        assert inertial is not None
        H, _ = FreeLinks(self.robot, inertial).terms(np.tile(log.origin, (len(sets), 1)), np.zeros((len(sets), self.robot.n)))
        diagonal = np.arange(self.robot.n)
        H[:, diagonal, diagonal] += drive["armature"]
        return np.asarray(np.linalg.eigvalsh(0.5 * (H + np.swapaxes(H, 1, 2))).min(axis=1) > 0.0)

    def stiffness(self, values: Array) -> Array:
        """Torque of each drive (n,) per rad of error, in the first log, at values (p,) of the unknowns."""
        log = self.logs[0]
        constants, _, _ = self._split(log, values[None])
        volts = log.supply.mean(axis=0) if self.law.kind == "pwm" and log.supply is not None else 1.0
        return np.asarray((constants["torque_scale"] * constants["kp"])[0] * volts)

    def _step(self) -> float:
        """Seconds of a step: a whole number of them in a sample, where the logs agree on one."""
        periods = [log.period for log in self.logs]
        if max(periods) - min(periods) > 0.01 * min(periods):
            return self.longest
        return periods[0] / max(1, int(np.ceil(periods[0] / self.longest - 1e-6)))

    def _together(self, sets: Array, h: float, counts: list[int]) -> list[Array]:
        """All logs with all sets as lanes of one simulation."""
        lanes = [self._lanes(log, sets, h, max(counts)) for log in self.logs]
        drives = LaneDrives(**{key: np.concatenate([lane.drive[key] for lane in lanes]) for key in lanes[0].drive})
        strength = None
        if any(lane.strength is not None for lane in lanes):
            strength = np.concatenate([np.ones_like(x.target) if x.strength is None else x.strength for x in lanes], axis=1)
        free = [lane.inertial for lane in lanes if lane.inertial is not None]
        links: LinkTerms = FreeLinks(self.robot, np.concatenate(free)) if free else KnownLinks(self.robot, self.nominal)
        q = np.concatenate([np.tile(log.origin, (len(sets), 1)) for log in self.logs])
        dq = np.concatenate([np.tile(log.start, (len(sets), 1)) for log in self.logs])
        target = np.concatenate([lane.target for lane in lanes], axis=1)
        integrals = LaneIntegrals.together([lane.integrals for lane in lanes if lane.integrals is not None])
        groups = self.groups
        elastic = np.flatnonzero(np.isfinite(np.concatenate([lane.stiffness for lane in lanes])).any(axis=0))
        if len(elastic):
            stiffness, twist = (np.concatenate([getattr(lane, key) for lane in lanes]) for key in ("stiffness", "twist"))
            sprung = ElasticLinks(links, self.robot.n, elastic, stiffness[:, elastic], twist[:, elastic])
            drives, target, links = sprung.drives(drives), sprung.widened(target), sprung
            strength = None if strength is None else sprung.widened(strength)
            integrals = None if integrals is None else sprung.integrals(integrals)
            q, dq, groups = sprung.resting(q), sprung.widened(dq, elastic), sprung.groups
        fine = simulated(links, drives, target, strength, q, dq, h, groups, integrals)[..., : self.robot.n]
        return [_at(fine[:, i * len(sets) : (i + 1) * len(sets)], log.t / h) for i, log in enumerate(self.logs)]

    def _lanes(self, log: DriveLog, sets: Array, h: float, count: int) -> _Lanes:
        constants, drive, inertial = self._split(log, sets)
        lanes, n = len(sets), self.robot.n
        target = np.empty((count, lanes, n))
        wanted = np.empty_like(target) if np.any(self.law.integrates | self.law.deadbands) else None
        form = self.law.for_log(log.name).command
        edges = np.arange(count + 1) * h
        plans: dict[bytes, tuple[Array, ...]] = {}
        for lane in range(lanes):
            delay, lag = constants["delay_s"][lane], constants["command_lag_s"][lane]
            key = delay.tobytes() + lag.tobytes()
            if key not in plans:
                # What is fed forward is added behind the filter of the commands.
                commands = ((log.q_cmd, lag), (log.dq_cmd, lag), (log.tau_ff, np.zeros(n)))
                plans[key] = tuple(means(log.t, x, delay, of, edges, h, form) for x, of in commands)
            position, rate, forward = plans[key]
            if wanted is not None:
                wanted[:, lane] = position
            target[:, lane] = constants["kp"][lane] * position + constants["kd"][lane] * rate + constants["feed_forward"][lane] * forward
        fall = np.ones((lanes, n))
        for effect in self.model.effects:
            if isinstance(effect, Stribeck):
                at = effect.at(self.robot)
                fall[:, at] = effect.v_s * (1.0 if effect.side == Side.JOINT else np.abs(np.diag(self.robot.transmission.K)[at]))
        kept = {key: constants[key] for key in ("kp", "kd", "back_emf")} | {key: constants[name] for key, name in _GEAR.items()}
        whole = {**drive, **kept, "fall": fall, "limit": constants["effort_limit"]}
        if np.any(self.law.deadbands):
            whole["band"] = constants["deadband"]
        if np.any(self.law.droops):
            whole["droop"] = np.nan_to_num(whole["limit"] / np.maximum(constants["no_load_speed"], 1e-9), nan=0.0)
        return _Lanes(
            target,
            self._strength(log, constants["torque_scale"], h, count),
            None if wanted is None else LaneIntegrals(constants["ki"], wanted, constants["integral_start"]),
            whole,
            inertial,
            constants["joint_stiffness"],
            constants["joint_damping"],
        )

    def _strength(self, log: DriveLog, scale: Array, h: float, count: int) -> Array | None:
        """Factor (K, B, n) of the drives' torque; None where it is always 1."""
        if self.law.kind != "pwm" and np.all(log.enabled == 1.0) and np.all(scale == 1.0):
            return None
        at = np.clip(np.searchsorted(log.t, (np.arange(count) + 0.5) * h, side="right") - 1, 0, None)
        share = log.enabled * log.supply if self.law.kind == "pwm" and log.supply is not None else log.enabled
        return np.asarray(share[at][:, None] * scale)

    def _split(self, log: DriveLog, sets: Array) -> tuple[dict[str, Array], dict[str, Array], Array | None]:
        """Constants of the law, drive and friction as (Q, n) each, and parameters of the links (Q, 10 nb), None where they are known."""
        law, lanes, n = self.law.for_log(log.name), len(sets), self.robot.n
        constants = {key: np.tile(values, (lanes, 1)) for key, values in law.constants.items()}
        if log.later:
            constants["integral_start"][:] = np.nan
        drive = {key: np.zeros((lanes, n)) for key in _DRIVE}
        inertial = None if self.law.links_known else np.zeros((lanes, 10 * self.robot.tree.nb))
        if self.law.links_known and self.law.loaded:
            inertial = np.tile(self.nominal, (lanes, 1))
        first = next((part.start for e, part in zip(self.model.effects, self.model.slices, strict=True) if isinstance(e, RigidBody)), 0)
        label = self.labels[self.logs.index(log)]
        for unknown, values in zip(self.unknowns, sets.T, strict=True):
            if unknown.log not in ("", label):
                continue
            if unknown.place == "link":
                assert inertial is not None
                inertial[:, unknown.column - first] = values
            elif unknown.place in drive:
                drive[unknown.place][:, unknown.joint] += unknown.factor * values
            else:
                own = constants[unknown.place]
                at = slice(None) if unknown.joint < 0 else [unknown.joint]
                own[:, at] = np.where(np.isnan(own[:, at]), values[:, None], own[:, at])
        if inertial is not None and law.load is not None:
            inertial += law.load.parameters(self.robot)
        return {key: np.nan_to_num(x, nan=0.0, posinf=np.inf) for key, x in constants.items()}, drive, inertial


def _at(fine: Array, place: Array) -> Array:
    """Positions (Q, N, n) at places counted in steps, straight between the steps' (K + 1, Q, n)."""
    low = np.clip(np.floor(place + 1e-9).astype(int), 0, len(fine) - 2)
    share = (place - low)[:, None, None]
    return np.moveaxis(fine[low] * (1.0 - share) + fine[low + 1] * share, 0, 1)


def joined(parts: Sequence[Array]) -> Array:
    """Arrays (Q, N_i, n) of several logs as (Q, Σ N_i, n)."""
    return np.concatenate(list(parts), axis=1)
