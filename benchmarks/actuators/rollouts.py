"""Random robots rolled out by MuJoCo from the exported file, beside our own replay of the same commands.

`python -m benchmarks.actuators.rollouts [ROBOTS]`. Of every five robots three follow a drive law (position actuators; damping,
friction loss, armature, delay, limits, offsets, springs), one has a transmission that couples its motors (tendons), one has a joint that
follows another (equality); the last two are driven by given torque. They have to agree to what both change when steps are halved."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import ident
from ident.drives import DriveFit, DriveLaw, DriveLog
from ident.drives.plant import DrivePlant
from ident.exporting import Identified
from ident.exporting.target import ExportOptions, make_target
from ident.regressor.rigid import bias_torque, mass_matrix
from ident.simulation import Plant

Array = np.ndarray
#: Seconds of a run, of a command, and of a step of MuJoCo's (its half is what is compared).
SECONDS, PERIOD, STEP = 1.0, 0.01, 5e-4
#: How much more than what halving the steps changes the two may differ by, and what is no difference at all (rad, m).
FACTOR, LEAST = 2.0, 2e-5
KINDS = ("law", "law", "coupled", "law", "follower")


@dataclass(frozen=True)
class Rollout:
    """Rms over time and joints (rad, m): `motion` of the joints, `apart` of the two, `mujoco` and `ours` of each with its step halved;
    `limit`: apart of ours and MuJoCo's first-order integrator extrapolated to no step."""

    seed: int
    kind: str
    joints: int
    motion: float
    apart: float
    mujoco: float
    ours: float
    limit: float

    @property
    def agrees(self) -> bool:
        return self.apart <= max(FACTOR * (self.mujoco + self.ours), LEAST)


def robot_text(rng: np.random.Generator, n: int, follower: bool = False, chain: bool = False) -> str:
    """A URDF of n joints: chains and branches, frames turned at random, one in five joints slides; `follower`: one more, which follows;
    `chain`: without branches (between which MuJoCo's tendons have no inertia)."""
    parts = ['<robot name="random"><link name="base"/>']
    for i in range(n + follower):
        up = "base" if i == 0 else f"link{i - 1 if chain else int(rng.integers(max(0, i - 2), i))}"
        slides = i < n and rng.uniform() < 0.2
        m, size = rng.uniform(0.3, 2.0), rng.uniform(0.03, 0.1)
        com, rpy = rng.uniform(-0.1, 0.1, 3), rng.uniform(-1.5, 1.5, 3)
        xyz, axis = rng.uniform(-0.25, 0.25, 3), rng.standard_normal(3)
        moments = m * size**2 * rng.uniform(0.8, 1.2, 3)
        parts.append(
            f'<link name="link{i}"><inertial><origin xyz="{_words(com)}"/><mass value="{m}"/><inertia ixx="{moments[0]}" ixy="0" ixz="0"'
            f' iyy="{moments[1]}" iyz="0" izz="{moments[2]}"/></inertial></link>'
        )
        follows = f'<mimic joint="joint0" multiplier="{rng.uniform(-1.2, 1.2)}" offset="0.1"/>' if i == n else ""
        kind = "prismatic" if slides else "revolute"
        if follower and i == 0:
            kind = "revolute"
        parts.append(
            f'<joint name="joint{i}" type="{kind}"><origin xyz="{_words(xyz)}" rpy="{_words(rpy)}"/><parent link="{up}"/><child'
            f' link="link{i}"/><axis xyz="{_words(axis / np.linalg.norm(axis))}"/><limit lower="-50" upper="50" effort="999" velocity="9"/>'
            f"{follows}</joint>"
        )
    return "".join([*parts, "</robot>"])


def _words(values: Array) -> str:
    return " ".join(repr(float(x)) for x in values)


def rolled(seed: int) -> Rollout:
    """One robot: exported, rolled out, compared."""
    rng, kind = np.random.default_rng([17, seed]), KINDS[seed % len(KINDS)]
    return _under_law(seed, rng) if kind == "law" else _under_torque(seed, rng, kind)


def _under_law(seed: int, rng: np.random.Generator) -> Rollout:
    n = int(rng.integers(1, 7))
    robot = ident.Robot.from_urdf(robot_text(rng, n))
    model = robot.rigid_body()
    for name in (
        "rotor_inertia",
        "viscous",
        "coulomb",
        *(["offset"] if seed % 3 == 0 else []),
        *(["linear_spring"] if seed % 4 == 1 else []),
    ):
        model = model + ident.make_effect(name)
    inertia, weight = _sizes(robot)
    armature = inertia * rng.uniform(0.2, 1.0, n)
    kp = (inertia + armature) * (2 * np.pi * rng.uniform(2.0, 5.0, n)) ** 2 + weight
    kd = rng.uniform(0.3, 1.0, n) * np.sqrt(kp * (inertia + armature))
    limit = np.where(rng.uniform(size=n) < 0.3, 0.3 * kp + 2.0 * weight, np.inf)
    delay = STEP * rng.integers(0, 16) * (rng.uniform() < 0.5)
    law = DriveLaw.of(robot, kp=kp.tolist(), kd=kd.tolist(), delay_s=float(delay), effort_limit=limit.tolist())
    truth = {
        "armature": armature, "viscous": 0.2 * kd * rng.uniform(0, 1, n), "dry": 0.05 * kp * rng.uniform(0, 1, n),
        "offset": 0.05 * kp * rng.uniform(-1, 1, n), "spring": 0.3 * kp * rng.uniform(0, 1, n),
    }  # fmt: skip
    unknowns = DrivePlant(model, law, ()).unknowns
    values = np.array([truth[u.place][u.joint] for u in unknowns])
    fit = DriveFit(model, law, unknowns, values, np.eye(len(values)), None, np.zeros(n), PERIOD, 1, True)
    q0, commands = rng.uniform(-0.5, 0.5, n), _commands(rng, n, 0.4)
    commands += q0
    t = PERIOD * np.arange(len(commands))
    log = ident.Log("run", t=t, q=np.tile(q0, (len(t), 1)), extra={f"q_cmd{j + 1}": commands[:, j] for j in range(n)})
    ready = DriveLog.of(log, robot, law)
    ours = [DrivePlant(model, law, (ready,), step=h).positions(values)[0][0] for h in (STEP, STEP / 2)]
    text = str(make_target("mujoco_actuator", Path()).written(Identified.of(fit), ExportOptions()).content)
    theirs = [in_mujoco(text, q0, commands, h, robot.joint_names) for h in (STEP, STEP / 2)]
    return _compared(seed, "law", ours, theirs)


def _under_torque(seed: int, rng: np.random.Generator, kind: str) -> Rollout:
    n = int(rng.integers(2, 6))
    robot = ident.Robot.from_urdf(robot_text(rng, n, follower=kind == "follower", chain=kind == "coupled"))
    inertia, weight = _sizes(robot)
    spring = inertia * (2 * np.pi * rng.uniform(1.0, 3.0, n)) ** 2 + 2.0 * weight
    damping, dry = 0.3 * np.sqrt(spring * inertia), 0.03 * spring
    if kind == "coupled":
        back = np.eye(n) + 0.4 * rng.uniform(-1, 1, (n, n)) * (rng.uniform(size=(n, n)) < 0.5)
        robot = robot.with_transmission(ident.Transmission(np.linalg.inv(back), np.zeros(n), "joint"))
    model = robot.rigid_body()
    for name in ("rotor_inertia", "viscous", "coulomb", "linear_spring"):
        model = model + ident.make_effect(name)
    held = np.stack([spring, np.zeros(n)], axis=1).ravel()
    values = np.concatenate([robot.nominal, 0.5 * inertia, damping, dry, held])
    torque = _commands(rng, n, 0.5) * spring
    q0 = np.zeros(n)
    plant = Plant(model, values)
    given = np.concatenate([torque, torque[-1:]])
    ours = [ident.simulate(plant, torque=given, start=(q0, q0), rate=1 / PERIOD, step=h).link.q[: len(torque)] for h in (STEP, STEP / 2)]
    text = str(make_target("mujoco_actuator", Path()).written(Identified(model, values), ExportOptions()).content)
    start = robot.tree_position(q0)
    names = tuple(joint.name for joint in robot.tree_joints)
    at = [names.index(name) for name in robot.joint_names]
    theirs = [in_mujoco(text, start, torque, h, names)[:, at] for h in (STEP, STEP / 2)]
    return _compared(seed, kind, ours, theirs)


def _sizes(robot: ident.Robot) -> tuple[Array, Array]:
    """Inertia about each joint and gravity's torque on it, in a posture of their middle."""
    rng = np.random.default_rng(0)
    q = robot.tree_position(rng.uniform(-0.5, 0.5, (20, robot.n)))
    W = robot.loop.W
    H = W.T @ mass_matrix(robot.tree, robot.nominal, q) @ W
    g = bias_torque(robot.tree, robot.nominal, q, np.zeros_like(q)) @ W
    return np.diagonal(H, axis1=1, axis2=2).mean(axis=0), np.abs(g).max(axis=0)


def _commands(rng: np.random.Generator, n: int, size: float) -> Array:
    """(N, n) staircases of sines and steps from zero."""
    t = PERIOD * np.arange(round(SECONDS / PERIOD))
    out = np.zeros((len(t), n))
    for j in range(n):
        for f in rng.uniform(0.5, 3.0, 2):
            out[:, j] += 0.4 * size * np.sin(2 * np.pi * f * t)
        out[t > rng.uniform(0.1, 0.8) * SECONDS, j] += size * rng.uniform(-0.5, 0.5)
    return out


def in_mujoco(text: str, q0: Array, commands: Array, step: float, joints: tuple[str, ...]) -> Array:
    """Positions (N, n) at the samples of the commands (N, n), which are held.

    Dry friction and couplings are soft there: they are made as hard as the step allows, and harden with it."""
    import mujoco

    model = mujoco.MjModel.from_xml_string(text)
    model.opt.timestep, model.opt.integrator = step, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    model.opt.tolerance, model.opt.iterations = 1e-12, 200
    hard, stiff = (2 * step, 1.0), (0.9999, 0.9999)
    model.dof_solref[:], model.dof_solimp[:, :2] = hard, stiff
    model.tendon_solref_fri[:], model.tendon_solimp_fri[:, :2] = hard, stiff
    model.eq_solref[:], model.eq_solimp[:, :2] = hard, stiff
    model.jnt_limited[:] = 0
    data: Any = mujoco.MjData(model)
    where = [model.jnt_qposadr[model.joint(name).id] for name in joints]
    data.qpos[where] = q0
    for i in range(model.nu):
        if model.actuator_delay[i] > 0:
            count = int(model.actuator_history[i, 0])
            mujoco.mj_initCtrlHistory(model, data, i, None, np.full((count, 1), commands[0, i]))
    every, out = round(PERIOD / step), []
    for row in commands:
        out.append(data.qpos[where].copy())
        data.ctrl[:] = row
        mujoco.mj_step(model, data, every)
    return np.array(out)


def _compared(seed: int, kind: str, ours: list[Array], theirs: list[Array]) -> Rollout:
    def rms(x: Array) -> float:
        return float(np.sqrt(np.mean(x**2)))

    motion = rms(ours[1] - ours[1].mean(axis=0))
    halved = rms(theirs[0] - theirs[1]), rms(ours[0] - ours[1])
    return Rollout(seed, kind, ours[1].shape[1], motion, rms(ours[1] - theirs[1]), *halved, rms(2 * theirs[1] - theirs[0] - ours[1]))


def main(count: int = 200) -> int:
    """Print one line per kind, and the robots whose two rollouts differ by more than their steps explain."""
    import mujoco

    rows = [rolled(seed) for seed in range(count)]
    print(f"MuJoCo {mujoco.__version__}, {count} robots, {SECONDS:g} s at steps of {1e3 * STEP / 2:g} ms (halved from {1e3 * STEP:g} ms)")
    print(
        f"{'robots':<10}{'count':>6}{'agree':>7}{'motion':>9}{'apart':>9}{'worst':>9}{'MuJoCo halved':>15}{'ours halved':>13}{'no step':>9}"
    )
    for kind in dict.fromkeys(KINDS):
        own = [row for row in rows if row.kind == kind]
        mid = {key: float(np.median([getattr(row, key) for row in own])) for key in ("motion", "apart", "mujoco", "ours", "limit")}
        worst, agree = max(row.apart for row in own), sum(row.agrees for row in own)
        left = f"{kind:<10}{len(own):>6}{agree:>7}{mid['motion']:>9.2g}{mid['apart']:>9.2g}{worst:>9.2g}"
        print(f"{left}{mid['mujoco']:>15.2g}{mid['ours']:>13.2g}{mid['limit']:>9.2g}")
    print("medians of rms over time and joints, rad (m); no step: MuJoCo extrapolated from both steps, apart from ours")
    for row in rows:
        if not row.agrees:
            print(f"not within {FACTOR:g} times: {row}")
    return 0 if all(row.agrees for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else 200))
