"""A second simulator, made for the test bed: many arms at once, each with laws of its own, apart from the toolkit's simulation.

Leapfrog steps: torque is held from half a period before an instant to half a period after it, so that what is logged at the
instant is its mean (no delay of half a period). Dry friction is solved as a contact at the new speed (projected Gauss-Seidel),
so that it holds at rest and never has to be smoothed. A drive (`drive.Drive`) turns what the motors do into what is asked of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ident.effects.motion import Coordinates
from ident.simulation.trajectory import Trajectory

from .arms import Arm
from .drive import Drive, Wanted
from .laws import Law, Soft

Array = np.ndarray

_SWEEPS = 8


@dataclass(frozen=True, eq=False)
class Lane:
    """One run: the true arm, its motion, what loads it beside (laws), limits (n,) and losses (n,) of its drives, a soft joint,
    and from `change_at` on another set of true values."""

    arm: Arm
    motion: Trajectory
    laws: tuple[Law, ...] = ()
    limit: Array | None = None
    loss: Array | None = None
    soft: Soft | None = None
    change_at: float = np.inf
    changed: Arm | None = None


@dataclass(frozen=True, eq=False)
class Run:
    """What happened: `t` (N,), link positions `q`, motor positions `phi`, `torque` of the motors, what dry friction had beside its
    level (`restless`), (N, n) each; NaN from where the motion grew without bound."""

    t: Array
    q: Array
    phi: Array
    torque: Array
    restless: Array


def simulate(declared: Arm, lanes: Sequence[Lane], seconds: float, rate: float, steps: int, drive: Drive | None = None) -> list[Run]:
    """Runs of arms that share declared controller and number of joints. `steps` integration steps a sample; `drive`: by default one
    that knows the motion at every step and gives what is asked."""
    world = _World(declared, lanes, seconds, 1.0 / (rate * steps), drive or Drive())
    return world.run(round(seconds * rate) + 1, steps)


class _World:
    def __init__(self, declared: Arm, lanes: Sequence[Lane], seconds: float, h: float, how: Drive) -> None:
        from ident.model import Model
        from ident.robots.transmission import Side
        from ident.simulation.controller import typical_inertia

        self.lanes, self.h, self.n = list(lanes), h, declared.robot.n
        n, B = self.n, len(lanes)
        self.arms = [lane.arm for lane in lanes]
        self.models = [pinocchio_model(lane.arm) for lane in lanes]
        self.K_inverse = np.stack([a.robot.transmission.K_inverse for a in self.arms])
        self.zero = np.stack([a.robot.transmission.zero for a in self.arms])
        self.Ia, self.Fv, self.Fc = (np.stack([a.drive[s] for a in self.arms]) for s in ("Ia", "Fv", "Fc"))
        # The controller knows the declared arm.
        keep = 10 * declared.robot.tree.nb + n
        rigid = Model(declared.robot, declared.model.effects[:2])
        w = 2.0 * np.pi * declared.frequency_hz
        inertia = typical_inertia(rigid, declared.values[:keep], Side.MOTOR)
        kp, kd = w**2 * inertia, 2.0 * 0.8 * w * inertia
        count = round(seconds / h) + 2
        t = np.arange(count) * h
        drive = declared.robot.transmission
        ahead, phi_d, w_d = [], [], []
        start = []
        for lane in lanes:
            c = lane.motion.sample(t)
            tau = rigid.inverse_dynamics(c.q, c.dq, c.ddq, declared.values[:keep])
            ahead.append(drive.torque(tau, drive.measured, Side.MOTOR))
            phi_d.append(drive.motor_position(c.q))
            w_d.append(drive.motor_rate(c.dq))
            start.append(c.q[0])
        self.asked = how.begin(Wanted(*(np.stack(x, axis=1) for x in (phi_d, w_d, ahead)), kp, kd), h)
        self.limit = np.stack([np.full(n, np.inf) if lane.limit is None else lane.limit for lane in lanes])
        self.loss = np.stack([np.zeros(n) if lane.loss is None else lane.loss for lane in lanes])
        # Generalised coordinates: the links, and the motor end of a soft joint (of no consequence where there is none).
        self.J = np.zeros((B, n, n + 1))
        self.J[:, :, :n] = self.K_inverse
        for b, lane in enumerate(lanes):
            if lane.soft is not None:
                j = lane.soft.j
                self.J[b, j, n], self.J[b, j, j] = self.J[b, j, j], 0.0
        joint = np.zeros((B, n, n + 1))
        joint[:, :, :n] = np.eye(n)
        self.contacts = np.concatenate([self.J, joint], axis=1)
        # The position that a motor shows at link position q on the *true* transmission, where the motion is to begin.
        self.y = np.zeros((B, n + 1))
        self.y[:, :n] = np.stack(start)
        for b, lane in enumerate(lanes):
            if lane.soft is not None:
                self.y[b, n] = self.y[b, lane.soft.j]
        self.v = np.zeros((B, n + 1))
        self.states = [[np.zeros(law.states) for law in lane.laws] for lane in lanes]
        self.load = np.zeros((B, n))

    def run(self, samples: int, steps: int) -> list[Run]:
        import pinocchio as pin

        n, B, h = self.n, len(self.lanes), self.h
        out = np.empty((4, samples, B, n))
        y, v, before = self.y, self.v, self.v
        H, bias = np.zeros((B, n, n)), np.zeros((B, n))
        upper = np.triu(np.ones((n, n), bool))
        level_before = np.zeros((B, 2 * n))
        last_y = y.copy()
        diagonal = np.arange(2 * n)
        for k in range((samples - 1) * steps + 1):
            t = k * h
            now = 1.5 * v - 0.5 * before
            for b, lane in enumerate(self.lanes):
                if lane.changed is not None and t >= lane.change_at:
                    self.models[b] = pinocchio_model(lane.changed)
                    self.lanes[b] = Lane(lane.arm, lane.motion, lane.laws, lane.limit, lane.loss, lane.soft)
                model, data = self.models[b]
                H[b] = pin.crba(model, data, y[b, :n])
                bias[b] = pin.nonLinearEffects(model, data, y[b, :n], now[b, :n])
            M = np.zeros((B, n + 1, n + 1))
            M[:, :n, :n] = np.where(upper, H, np.swapaxes(H, 1, 2))
            drive = np.einsum("bij,bi,bik->bjk", self.J, self.Ia, self.J)
            M += drive
            M[:, n, n] += ~(np.abs(self.J[:, :, n]).max(axis=1) > 0)
            phi = (self.J @ (y - np.concatenate([self.zero, np.zeros((B, 1))], axis=1))[..., None])[..., 0]
            speed = (self.J @ now[..., None])[..., 0]
            asked = self.asked.torque(k, phi, (self.J @ v[..., None])[..., 0])
            share = self.asked.friction(phi)
            if k % steps == 0:
                out[:, k // steps] = y[:, :n], phi, asked, share * self.Fc * np.sign(speed)
            force = ((np.clip(asked, -self.limit, self.limit) - self.Fv * speed)[:, None] @ self.J)[:, 0]
            force[:, :n] -= bias
            levels = np.zeros((B, 2 * n))
            levels[:, :n] = self.Fc * (1.0 + share) + self.loss * np.abs(self.load)
            self._laws(t, y, now, phi, speed, force, levels, last_y)
            free = v + h * np.linalg.solve(M, force[..., None])[..., 0]
            # Contacts that carry friction: A s = change of their speeds for levels s.
            reply = np.linalg.solve(M, np.swapaxes(self.contacts, 1, 2)) * h
            A = self.contacts @ reply
            u = (self.contacts @ free[..., None])[..., 0]
            s = np.clip(level_before, -levels, levels)
            u -= (A @ s[..., None])[..., 0]
            pivot = np.maximum(A[:, diagonal, diagonal], 1e-300)
            used = np.flatnonzero(levels.any(axis=0))
            for _ in range(_SWEEPS):
                for c in used:
                    new = np.clip(s[:, c] + u[:, c] / pivot[:, c], -levels[:, c], levels[:, c])
                    u -= A[:, :, c] * (new - s[:, c])[:, None]
                    s[:, c] = new
            level_before = s
            after = free - (reply @ s[..., None])[..., 0]
            acceleration = (after - v) / h
            self.load = ((np.where(upper, H, np.swapaxes(H, 1, 2)) @ acceleration[:, :n, None])[..., 0] + bias)[:, None] @ np.stack(
                [a.robot.transmission.K for a in self.arms]
            )
            self.load = self.load[:, 0]
            last_y = y
            lost = ~np.isfinite(after).all(axis=1) | (np.abs(after).max(axis=1) > 1e3)
            before, v = v, np.where(lost[:, None], 0.0, after)
            y = y + h * v
            out[:, (k + steps - 1) // steps :, lost] = np.nan
        times = np.arange(samples) * steps * h
        return [Run(times, *(x[:, b].copy() for x in out)) for b in range(B)]

    def _laws(self, t: float, y: Array, now: Array, phi: Array, speed: Array, force: Array, levels: Array, last_y: Array) -> None:
        n = self.n
        for b, lane in enumerate(self.lanes):
            if lane.soft is not None:
                j = lane.soft.j
                torque = lane.soft.torque(y[b, n] - y[b, j], now[b, n] - now[b, j])
                force[b, n] -= torque
                force[b, j] += torque
            for i, law in enumerate(lane.laws):
                on_motor = law.side == "motor"
                x = Coordinates(phi[b], speed[b], speed[b]) if on_motor else Coordinates(y[b, :n], now[b, :n], now[b, :n])
                if law.states:
                    moved = y[b] - last_y[b]
                    step = (self.J[b] @ moved)[law.j] if on_motor else moved[law.j]
                    self.states[b][i] = law.moved(self.states[b][i], float(step), self.h)
                smooth, dry = law.torque(t, x, self.states[b][i])
                if on_motor:
                    force[b] -= smooth * self.J[b, law.j]
                    levels[b, law.j] += dry
                else:
                    force[b, law.j] -= smooth
                    levels[b, n + law.j] += dry
        np.maximum(levels, 0.0, out=levels)


def pinocchio_model(a: Arm):
    """Model and data of an arm's links as they truly are."""
    import pinocchio as pin

    model = a.robot.model.copy()
    for i, parameters in enumerate(a.values[: 10 * a.robot.tree.nb].reshape(-1, 10)):
        model.inertias[i + 1] = pin.Inertia.FromDynamicParameters(parameters)
    return model, model.createData()
