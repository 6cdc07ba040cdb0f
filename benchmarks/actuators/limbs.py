"""Limbs of several joints with a known truth for the diagnosis, written beside the product: Pinocchio's inertias and forces, many at a
time, in steps of 0.1 ms (leapfrog), dry friction by impulses that stop a joint or stay within its level.

Commands of 100 Hz are held and act late. The fault sits on one joint, which is drawn; a delay on all."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .coverage import Machine

Array = np.ndarray
STEP = 1e-4
RATE = 200
SECONDS = 6.0
NOISE = 5e-4
_SWEEPS = 8
_HELD = 0.01


@dataclass(frozen=True)
class Limb:
    """True numbers (n,) of one robot; `joint`: index of the one with the fault; `declared`: what the study says of kp, kd and delay."""

    truth: dict[str, Array]
    delay: float
    stiffness: float
    joint: int
    declared: dict[str, Any]


def limb(machine: Machine, fault: str, seed: int) -> Limb:
    """Sizes are drawn, the same for every fault of a seed but for the fault."""
    rng = np.random.default_rng([17, seed])
    n = len(machine.kp)
    truth = {key: np.array(getattr(machine, key)) * rng.uniform(0.7, 1.3, n) for key in ("kp", "kd", "Ia", "Fv", "Fc")}
    truth["offset"] = rng.uniform(0.2, 0.5, n) * np.array(machine.Fc) * rng.choice([-1.0, 1.0], n)
    late = 5e-4 * int(rng.integers(8, 17))
    joint = int(rng.integers(n))
    share, hz, wrong = rng.uniform(0.1, 0.3), rng.uniform(7.0, 14.0), rng.choice([0.75, 0.8, 1.25, 1.35])
    band = rng.uniform(0.005, 0.03)
    declared = {"kp": truth["kp"].copy(), "kd": truth["kd"].copy(), "delay_s": late}
    truth["load"], truth["deadband"] = np.zeros(n), np.zeros(n)
    if fault == "kp":
        declared["kp"][joint] *= wrong
    if fault == "load_dependent_friction":
        truth["load"][joint] = share
    if fault == "deadband":
        truth["deadband"][joint] = band
    pin = _Pinocchio(machine)
    inertia = pin.terms(np.zeros((1, n)), np.zeros((1, n)))[0][0, joint, joint]
    stiffness = float(inertia * (2.0 * np.pi * hz) ** 2) if fault == "joint_elasticity" else 0.0
    return Limb(truth, 2.0 * late if fault == "delay" else late, stiffness, joint, declared)


def command(machine: Machine, seed: int) -> Array:
    """(N, n) at 100 Hz: sines of several frequencies with steps, no two joints alike."""
    rng = np.random.default_rng([18, seed])
    t = np.arange(round(SECONDS / _HELD)) * _HELD
    out = np.zeros((len(t), len(machine.kp)))
    for column in out.T:
        for f in rng.uniform(0.3, 4.0, 4):
            column += 0.25 / np.sqrt(f) * np.sin(2.0 * np.pi * f * (t - 0.5))
        for _ in range(4):
            column[t > rng.uniform(0.5, SECONDS)] += rng.uniform(-0.4, 0.4)
    out[t < 0.5] = 0.0
    return out


class _Pinocchio:
    """Inertia matrices and bias torques of many states."""

    def __init__(self, machine: Machine) -> None:
        import pinocchio as pin

        self.pin = pin
        self.model = pin.buildModelFromXML(machine.urdf) if machine.urdf.lstrip().startswith("<") else pin.buildModelFromUrdf(machine.urdf)
        self.data = self.model.createData()

    def terms(self, q: Array, v: Array) -> tuple[Array, Array]:
        H, c = np.empty((*q.shape, q.shape[1])), np.empty_like(q)
        for k in range(len(q)):
            upper = np.triu(self.pin.crba(self.model, self.data, q[k]))
            H[k] = upper + np.triu(upper, 1).T
            c[k] = self.pin.nonLinearEffects(self.model, self.data, q[k], v[k])
        return H, c


def recorded(machine: Machine, limbs: list[Limb], seeds: list[int]) -> tuple[Array, Array, Array]:
    """Times (N,), positions of the motors with noise and commands (N, B, n) at `RATE`; the joints begin at rest."""
    pin, n, lanes = _Pinocchio(machine), len(machine.kp), np.arange(len(limbs))
    value = {key: np.stack([one.truth[key] for one in limbs]) for key in limbs[0].truth}
    wanted = np.stack([command(machine, seed) for seed in seeds], axis=1)
    late = np.array([round(one.delay / STEP) for one in limbs])
    stiffness, joint = np.array([one.stiffness for one in limbs]), np.array([one.joint for one in limbs])
    sprung = np.zeros((len(limbs), n), bool)
    sprung[lanes, joint] = stiffness > 0
    spring, twist = np.where(sprung, stiffness[:, None], 0.0), np.zeros((len(limbs), n))
    lead, count, every, hold = round(1.0 / STEP), round(SECONDS / STEP), round(1.0 / RATE / STEP), round(_HELD / STEP)
    # Motors (q, v) and links (p, w): the same where no spring is between them.
    q, v, p, w = (np.zeros((len(limbs), n)) for _ in range(4))
    f, load, before = np.zeros_like(q), np.zeros_like(q), np.zeros_like(q)
    kept = np.empty((count // every, len(limbs), n))
    damped, diagonal = value["kd"] + value["Fv"], np.arange(n)
    half = 0.5 * STEP
    for k in range(-lead, count):
        if k >= 0 and k % every == 0:
            kept[k // every] = q
        sent = wanted[np.maximum(k - late, 0) // hold, lanes]
        q, p = q + half * v, p + half * w
        H, c = pin.terms(p, 1.5 * w - 0.5 * before)
        if k == -lead:
            twist = np.where(sprung, 0.04 * np.sqrt(spring * H[:, diagonal, diagonal]), 0.0)
        bent = spring * (q - p) + twist * (v - w)
        error = sent - q
        error = error - np.clip(error, -value["deadband"], value["deadband"])
        drive = value["kp"] * error - value["offset"]
        # A joint with a spring: its row is the link's, which the spring pulls; its motor stands for itself.
        A = H.copy()
        A[:, diagonal, diagonal] += np.where(sprung, 0.0, value["Ia"] + half * damped)
        pull = np.where(sprung, bent, drive - damped * w) - c
        inverse = np.linalg.inv(A)
        free = w + STEP * (inverse @ pull[..., None])[..., 0]
        level = value["Fc"] + value["load"] * np.abs(load)
        alone = value["Ia"] + half * damped
        motor = v + STEP * (drive - damped * v - bent) / alone
        own = STEP * np.where(sprung, 1.0 / alone, inverse[:, diagonal, diagonal])
        for _ in range(_SWEEPS):
            for j in range(n):
                speed = np.where(sprung[:, j], motor[:, j] - own[:, j] * f[:, j], free[:, j] - STEP * _row(inverse, f, sprung, j))
                f[:, j] = np.clip(f[:, j] + speed / own[:, j], -level[:, j], level[:, j])
        rubbed = np.where(sprung, 0.0, f)
        after = free - STEP * (inverse @ rubbed[..., None])[..., 0]
        motor = motor - own * np.where(sprung, f, 0.0)
        stuck = np.abs(f) < level
        after = np.where(stuck & ~sprung, 0.0, after)
        motor = np.where(stuck & sprung, 0.0, motor)
        load = np.where(sprung, bent, (H @ ((after - w) / STEP)[..., None])[..., 0] + c)
        before, w = w, after
        v = np.where(sprung, motor, after)
        q, p = q + half * v, p + half * w
        p = np.where(sprung, p, q)
    noise = np.stack([np.random.default_rng([19, seed]).standard_normal((len(kept), n)) for seed in seeds], axis=1)
    t = np.arange(len(kept)) / RATE
    return t, kept + NOISE * noise, wanted[np.minimum((t / _HELD + 1e-9).astype(int), len(wanted) - 1)]


def _row(inverse: Array, f: Array, sprung: Array, j: int) -> Array:
    """Speed per step that the friction (B, n) of joints without a spring takes off joint j (B,)."""
    return np.sum(inverse[:, j] * np.where(sprung, 0.0, f), axis=1)
