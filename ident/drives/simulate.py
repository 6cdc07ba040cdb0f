"""Many joints' drives in closed loop under their logged commands, many sets of parameters at once.

One step: implicit midpoint rule for the drive's gains and viscous friction, dry friction as the impulse that stops a joint or stays
within its level (projected Gauss-Seidel over the joints). Second order between velocity reversals, stable for stiff gains."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Protocol

import numpy as np

from .._native.choice import compiled

Array = np.ndarray
#: Sweeps over the joints to find the dry friction of a step, which starts from that of the step before.
_SWEEPS = 2
#: Steps between two looks for lanes that have left every bound.
_LOOK = 20
#: Motion beyond so many rad or rad/s is none of a robot.
_BEYOND = 1e4


class LinkTerms(Protocol):
    """Links in each lane. Those that have `single()` as well give a `SingleLink` where there is but one. `terms`: inertia matrix
    (B, n, n) and bias torque (B, n) of the links at states (B, n), of a set of parameters per lane."""

    def terms(self, q: Array, dq: Array) -> tuple[Array, Array]: ...


@dataclass(frozen=True, eq=False)
class SingleLink:
    """The only link: inertia, and bias torque as factors of sine and cosine of its position; stiffness and damping of the spring between
    motor and link, if there is one. Numbers, or one per lane (B,)."""

    inertia: Array
    sine: Array
    cosine: Array
    stiffness: Array | float = 0.0
    twist: Array | float = 0.0


@dataclass(frozen=True, eq=False)
class LaneDrives:
    """Drive and friction of B lanes, each (B, n): `armature`, `viscous`, `dry` (level of dry friction), `load` (its growth with the
    load), `excess` (more at low speed) and `fall` (the speed at which that is gone), `offset`; `kp`, `kd`, `limit`, `back_emf`; `spring`;
    growth of dry friction with the drive's torque: `loss`, `loss_square` (with its square), `loss_slow` (more at low speed), `slow` (that
    speed); `droop`: by which the limit falls with the speed of a joint that is driven along its motion, None where none does; `band`:
    errors of position that are none to the drive, None where it has none; beside integrals, whose gain may be 0: their commands count."""

    armature: Array
    viscous: Array
    dry: Array
    load: Array
    excess: Array
    fall: Array
    offset: Array
    kp: Array
    kd: Array
    limit: Array
    back_emf: Array
    spring: Array
    loss: Array
    loss_square: Array
    loss_slow: Array
    slow: Array
    droop: Array | None = None
    band: Array | None = None

    def stacked(self) -> Array:
        """Everything but droop and band, (16, B, n)."""
        return np.stack([getattr(self, part.name) for part in fields(self) if part.name not in ("droop", "band")])

    @property
    def loaded(self) -> bool:
        """Whether dry friction is anything but constant."""
        return any(bool(np.any(x)) for x in (self.load, self.excess, self.loss, self.loss_square, self.loss_slow))


@dataclass(frozen=True, eq=False)
class LaneIntegrals:
    """Drives that integrate their error: gain `ki` (B, n), position command of each step `wanted` (K, B, n), and the integral's part of
    the command, `start` (B, n), at first."""

    ki: Array
    wanted: Array
    start: Array

    @classmethod
    def together(cls, parts: Sequence[LaneIntegrals]) -> LaneIntegrals | None:
        """All lanes of the parts; None where there are none."""
        if not parts:
            return None
        ki, wanted, start = ([getattr(part, f.name) for part in parts] for f in fields(cls))
        return cls(np.concatenate(ki), np.concatenate(wanted, axis=1), np.concatenate(start))


def simulated(
    links: LinkTerms, drives: LaneDrives, target: Array, strength: Array | None, q: Array, dq: Array, h: float, groups: list[slice],
    integrals: LaneIntegrals | None = None,
) -> Array:  # fmt: skip
    """Positions (K + 1, B, n) from states q, dq (B, n), in K steps of h seconds.

    `target` (K, B, n): kp q_cmd + kd dq_cmd + feed-forward of each step; `strength` (K, B, n): factor of the drive's torque, None: 1.
    `groups`: joints that do not act on each other, in one slice each. Lanes that leave every bound are NaN from there on."""
    out = np.empty((len(target) + 1, *q.shape))
    out[0] = q
    recursions = compiled("_recursions")  # None: NumPy does the same
    with np.errstate(all="ignore"):
        single = getattr(links, "single", lambda: None)()
        if recursions is not None and single is not None:
            _single(out, recursions.drive_single, single, drives, target, strength, dq, h, integrals)
        elif recursions is None:
            _plain(out, links, drives, target, strength, dq, h, groups, integrals)
        else:
            _compiled(out, recursions.drive_step, links, drives, target, strength, dq, h, len(groups), integrals)
    lost = np.cumsum(~np.isfinite(out).all(axis=2), axis=0) > 0
    out[lost] = np.nan
    return out


def _single(
    out: Array, steps: Any, link: SingleLink, drives: LaneDrives, target: Array, strength: Array | None, dq: Array, h: float,
    integrals: LaneIntegrals | None,
) -> None:  # fmt: skip
    """Positions of one joint (with a spring: of motor and link) from out[0] on, all steps in C++."""
    lanes, n = dq.shape
    H = np.zeros((lanes, n, n))
    H[:, n - 1, n - 1] = link.inertia
    parts = (np.ascontiguousarray(np.broadcast_to(x, lanes), float) for x in (link.sine, link.cosine, link.stiffness, link.twist))
    constants = drives.stacked()
    state = np.zeros((5, lanes, n))
    state[:3] = out[0], dq, dq
    target, strength = np.ascontiguousarray(target), None if strength is None else np.ascontiguousarray(strength)
    steps(H, *parts, constants, target, strength, state, out[1:], lanes, n, len(target), h, _BEYOND, *_further(drives, integrals))


def _further(drives: LaneDrives, integrals: LaneIntegrals | None) -> tuple[Array | None, ...]:
    """Gain, command and state of integrals, the fall of limits and deadbands, as the compiled steps take them; nothing where there are
    none."""
    droop, band = (None if x is None else np.ascontiguousarray(x) for x in (drives.droop, drives.band))
    more = (droop,) if band is None else (droop, band)
    if integrals is None:
        return () if droop is None else (None, None, None, droop)
    wound = np.ascontiguousarray(integrals.ki), np.ascontiguousarray(integrals.wanted), np.array(integrals.start, order="C")
    return wound if droop is None and band is None else (*wound, *more)


def _compiled(
    out: Array, step: Any, links: LinkTerms, drives: LaneDrives, target: Array, strength: Array | None, dq: Array, h: float, block: int,
    integrals: LaneIntegrals | None,
) -> None:  # fmt: skip
    """Positions from out[0] on, each step in C++; joints act on each other within blocks of so many that follow each other."""
    lanes, n = dq.shape
    constants = drives.stacked()
    state = np.zeros((5, lanes, n))
    state[:3] = out[0], dq, dq
    ahead = np.stack([out[0] + 0.5 * h * dq, dq])
    target = np.ascontiguousarray(target)
    strength = None if strength is None else np.ascontiguousarray(strength)
    more = _further(drives, integrals)
    for k in range(len(target)):
        H, c = links.terms(ahead[0], ahead[1])
        now = None if strength is None else strength[k]
        here = more if integrals is None else (more[0], integrals.wanted[k], *more[2:])
        H, c = np.ascontiguousarray(H), np.ascontiguousarray(c)
        step(H, c, constants, target[k], now, state, ahead, out[k + 1], lanes, n, block, _SWEEPS, h, _BEYOND, *here)


def _plain(
    out: Array, links: LinkTerms, drives: LaneDrives, target: Array, strength: Array | None, dq: Array, h: float, groups: list[slice],
    integrals: LaneIntegrals | None,
) -> None:  # fmt: skip
    """Positions from out[0] on, in NumPy."""
    q = out[0]
    wound = None if integrals is None else _Wound(integrals, drives, h)
    n, f, load, before = q.shape[1], np.zeros_like(q), np.zeros_like(q), dq
    loaded, limited = drives.loaded, bool(np.isfinite(drives.limit).any())
    diagonal = np.arange(n)
    half, level = 0.5 * h, drives.dry
    for k in range(len(target)):
        H, c = links.terms(q + half * dq, 1.5 * dq - 0.5 * before)
        M = H.copy()
        M[:, diagonal, diagonal] += drives.armature
        now = None if strength is None else strength[k]
        whole, sent = (drives, target[k]) if wound is None else wound.ahead(k, target[k])
        wanted = None if integrals is None else integrals.wanted[k]
        pull, damping = _drive(whole, sent, now, q, dq, half, limited, wanted)
        motor = np.abs(pull - (damping - drives.viscous) * dq)
        pull, damping = pull - drives.spring * q, damping + half * drives.spring
        A = M.copy()
        A[:, diagonal, diagonal] += half * damping
        inverse = 1.0 / A if n == 1 else np.linalg.inv(A)
        momentum = _times(M, dq) + half * (pull - drives.offset - c)
        free = 2.0 * _times(inverse, momentum) - dq
        if loaded:
            level = drives.dry + drives.load * np.abs(load) + drives.excess * np.exp(-np.square(dq / drives.fall))
            level = level + motor * (drives.loss + drives.loss_square * motor + drives.loss_slow * np.exp(-np.square(dq / drives.slow)))
        f, after = _rubbed(free, h * inverse, f, level, groups)
        if loaded:
            load = _times(H, (after - dq) / h) + c
        if wound is not None:
            wound.step(k, target[k], now, q, dq, after)
        q, before, dq = q + half * (dq + after), dq, after
        out[k + 1] = q
        if k % _LOOK == 0 and (wild := ~(np.abs(dq).max(axis=1) < _BEYOND)).any():
            lost = wild[:, None]
            out[k + 1, wild] = np.nan
            q, dq, f, load, before = (np.where(lost, 0.0, x) for x in (q, dq, f, load, before))


def held_share(asked: Array, then: Array, change: Array, limits: tuple[Array, Array]) -> Array:
    """Share of a step in which a limit holds and a change of the integral would wind it further; commands `asked` at first, `then` at last,
    straight between, and as many `limits`."""
    along = np.where(change > 0.0, 1.0, -1.0)
    first, last = along * asked - limits[0], along * then - limits[1]
    high, low = np.maximum(first, last), np.minimum(first, last)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(high > 0.0, np.where(low >= 0.0, 1.0, high / (high - low)), 0.0)


class _Wound:
    """The integral's part z (B, n) of each drive's command, step by step. Over a step the error is that of the mean position, so that the
    mean z is that of a drive with ki h/2 more of kp."""

    def __init__(self, integrals: LaneIntegrals, drives: LaneDrives, h: float) -> None:
        self.ki, self.wanted, self.z, self.h, self.own = integrals.ki, integrals.wanted, integrals.start, h, drives
        self.drives = replace(drives, kp=drives.kp + 0.5 * h * integrals.ki)

    def ahead(self, k: int, target: Array) -> tuple[LaneDrives, Array]:
        """Drives and target (B, n) of a step, the integral in them."""
        return self.drives, target + self.z + 0.5 * self.h * self.ki * self.wanted[k]

    def step(self, k: int, target: Array, strength: Array | None, q: Array, dq: Array, after: Array) -> None:
        """Integrate over a step from q, dq to the speed `after`, but for the share of it in which the limit holds and the error would wind
        it further; a drive that is off keeps nothing."""
        own, moved, error = self.own, 0.5 * self.h * (dq + after), self.wanted[k] - q
        change = self.h * self.ki * (error - 0.5 * moved)
        asked = target + self.z - own.kp * q - own.kd * dq
        then = asked - own.kp * moved - own.kd * (after - dq)
        if own.band is not None:
            width = np.abs(own.band)
            change = change - self.h * self.ki * _within(error - 0.5 * moved, width)
            asked, then = asked - own.kp * _within(error, width), then - own.kp * _within(error - moved, width)
        limits = own.limit, own.limit
        if own.droop is not None:
            along = np.where(change > 0.0, 1.0, -1.0)
            limits = tuple(own.limit - own.droop * np.maximum(along * speed, 0.0) for speed in (dq, after))
        self.z = self.z + (1.0 - held_share(asked, then, change, limits)) * change
        if strength is not None:
            self.z = np.where(strength > 0.0, self.z, 0.0)


def _times(matrices: Array, vectors: Array) -> Array:
    """Products (B, n) of matrices (B, n, n) and vectors (B, n)."""
    return matrices[:, 0] * vectors if vectors.shape[1] == 1 else (matrices @ vectors[..., None])[..., 0]


def _drive(
    drives: LaneDrives, target: Array, strength: Array | None, q: Array, dq: Array, half: float, limited: bool, wanted: Array | None
) -> tuple[Array, Array]:  # fmt: skip
    """Torque (B, n) of the drive at q with no speed, and what damps the mean speed of the step."""
    kp, kd, pull = drives.kp, drives.kd, target - drives.kp * q
    if drives.band is not None and wanted is not None:
        error = wanted - q - half * dq
        inside = np.abs(error) < drives.band
        pull = pull - kp * np.where(inside, wanted - q, np.where(error > 0.0, drives.band, -drives.band))
        kp = np.where(inside, 0.0, kp)
    if limited:
        asked = pull - (kp * half + kd) * dq
        droop = np.zeros_like(dq) if drives.droop is None else drives.droop
        along = np.where(dq > 0.0, 1.0, -1.0)
        ahead = along * asked > drives.limit - droop * np.abs(dq)
        clipped = ahead | (along * asked < -drives.limit)
        if clipped.any():
            pull = np.where(clipped, np.where(ahead, along, -along) * drives.limit, pull)
            kp, kd = np.where(clipped, 0.0, kp), np.where(clipped, np.where(ahead, droop, 0.0), kd)
    damping = kp * half + kd
    if strength is None:
        return pull, damping + drives.back_emf + drives.viscous
    on = strength > 0
    return strength * pull, strength * damping + np.where(on, drives.back_emf, 0.0) + drives.viscous


def _rubbed(free: Array, response: Array, f: Array, level: Array, groups: list[slice]) -> tuple[Array, Array]:
    """Dry friction (B, n) of a step, and the speed after it; `free`: the speed without, `response` (B, n, n): speed per torque."""
    n = free.shape[1]
    if n == 1:
        own = response[:, 0]
        f = _within(free / own, level)
        return f, free - own * f
    f = _within(f, level)
    speed = free - _times(response, f)
    diagonal = response[:, range(n), range(n)]
    for _ in range(_SWEEPS):
        for at in groups:
            own = f[:, at]
            new = _within(own + speed[:, at] / diagonal[:, at], level[:, at])
            speed = speed - (response[:, :, at] @ (new - own)[..., None])[..., 0]
            f[:, at] = new
    # What a joint at rest keeps of round-off is taken off.
    return f, np.where(np.abs(f) < level, 0.0, speed)


def _within(x: Array, level: Array) -> Array:
    return np.maximum(np.minimum(x, level), -level)
