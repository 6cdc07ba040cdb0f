"""Actuators with a known truth: the compiled integrator with exact friction events plays the drive, and a log is made of it."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np
from scipy.signal import lfilter

import ident
from ident.robots.library.nominal import nominal_values
from ident.simulation.compiled import CompiledPlant
from ident.simulation.plant import Plant
from ident.simulation.script import Script

PENDULUM = """<robot name="pendulum"><link name="base"/>
  <link name="arm"><inertial><origin xyz="0 0 -0.2"/><mass value="0.6"/>
    <inertia ixx="0.002" ixy="0" ixz="0" iyy="0.002" iyz="0" izz="0.0005"/></inertial></link>
  <joint name="joint1" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" effort="20" velocity="30"/></joint></robot>"""

LEG = """<robot name="leg"><link name="base"/>
  <link name="thigh"><inertial><origin xyz="0 0 -0.1"/><mass value="1.0"/>
    <inertia ixx="0.005" ixy="0" ixz="0" iyy="0.005" iyz="0" izz="0.001"/></inertial></link>
  <link name="calf"><inertial><origin xyz="0 0 -0.12"/><mass value="0.3"/>
    <inertia ixx="0.002" ixy="0" ixz="0" iyy="0.002" iyz="0" izz="0.0001"/></inertial></link>
  <joint name="hip" type="revolute"><parent link="base"/><child link="thigh"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" effort="20" velocity="30"/></joint>
  <joint name="knee" type="revolute"><origin xyz="0 0 -0.2"/><parent link="thigh"/><child link="calf"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" effort="20" velocity="30"/></joint></robot>"""

#: Instants of the drive per second: every delay and every sample of these tests is a whole number of them. A slow one (4000) holds its
#: feedback for so long that it damps less than the law says: kp / (2 x 4000) N m s/rad of viscous friction are missing then.
DRIVE_HZ = 100_000


def command(seed: int, seconds: float, rate: float, n: int, rest: float = 0.5) -> np.ndarray:
    """(N, n) sums of sines with steps, different for each seed, after `rest` seconds at zero."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(seconds * rate)) / rate
    out = np.zeros((len(t), n))
    for j in range(n):
        for f in rng.uniform(0.3, 4.0, 4):
            out[:, j] += 0.25 / np.sqrt(f) * np.sin(2 * np.pi * f * (t - rest))
        for _ in range(4):
            out[t > rng.uniform(rest, seconds), j] += rng.uniform(-0.4, 0.4)
    out[t < rest] = 0.0
    return out


def smoothed(held: np.ndarray, lag: float) -> np.ndarray:
    """Commands (N, n) of each instant of the drive after a first-order filter of time constant `lag` (s), as it is halfway through it."""
    if lag == 0.0:
        return held
    kept, half = (float(np.exp(-share / (lag * DRIVE_HZ))) for share in (1.0, 0.5))
    found, _ = lfilter([0.0, 1.0 - kept], [1.0, -kept], held, axis=0, zi=held[:1])
    return np.asarray(held + half * (found - held))


@contextmanager
def compiled_kernel() -> Iterator[None]:
    """The compiled kernel, whichever IDENT_KERNEL asks for: half a million instants of a drive take NumPy minutes. What is fitted to such
    a log goes by the kernel that was asked for. Raises ConfigurationError where none was built."""
    asked = os.environ.get("IDENT_KERNEL")
    os.environ["IDENT_KERNEL"] = "native"
    try:
        yield
    finally:
        del os.environ["IDENT_KERNEL"]
        if asked is not None:
            os.environ["IDENT_KERNEL"] = asked


def commanded_log(
    robot: ident.Robot, truth: Mapping[str, Any], *, seed: int = 0, seconds: float = 5.0, rate: int = 100, noise: float = 5e-4,
    speed_command: bool = False, name: str = "run", before: float = 0.0,
) -> ident.Log:  # fmt: skip
    """A log of positions and commands. `truth`: Ia, Fv, Fc, offset, kp, kd and limit, a number or one per joint each, delay, and lag, the
    time constant of the filter that smooths the commands (s). `before`: seconds at rest that are not in the log; without, the joints drop
    from zero where gravity pulls."""
    model = robot.rigid_body() + ident.friction.RotorInertia() + ident.friction.Viscous() + ident.friction.Coulomb()
    model = model + ident.make_effect("offset")
    values = nominal_values(model)
    for i, parameter in enumerate(model.parameters):
        symbol, _, joint = parameter.name.partition("_")
        if symbol in ("Ia", "Fv", "Fc", "offset"):
            values[i] = np.broadcast_to(truth.get(symbol, 0.0), robot.n)[robot.joint_index(joint)]
    lead = round(before * rate)
    wanted = np.concatenate([np.zeros((lead, robot.n)), command(seed, seconds, rate, robot.n)])
    speed = np.gradient(wanted, 1.0 / rate, axis=0) if speed_command else np.zeros_like(wanted)
    every = DRIVE_HZ // rate
    late = round(truth.get("delay", 0.0) * DRIVE_HZ)

    def sent(samples: np.ndarray) -> np.ndarray:
        held = np.repeat(samples, every, axis=0)
        held = np.concatenate([np.repeat(held[:1], late, axis=0), held[: len(held) - late]])
        return smoothed(held, truth.get("lag", 0.0))[:, None]

    dynamics = Plant(model, values).dynamics()
    with compiled_kernel():
        compiled = CompiledPlant.of(dynamics)
    assert compiled is not None
    n = robot.n
    gains = [np.ones(n) * truth[key] for key in ("kp", "kd")]
    limit = np.ones(n) * truth.get("limit", np.inf)
    script = Script(ident.Side.JOINT, np.zeros((len(wanted) * every, 1, n)), sent(wanted), sent(speed), *gains, limit)
    state = dynamics.start(np.zeros(1), np.zeros((1, n)), np.zeros((1, n)))
    kept, *_ = compiled.run(script, state, None, period=1.0 / DRIVE_HZ, substeps=1, every=every)
    rng = np.random.default_rng([seed, 1])
    q = kept.q[:, 0] + noise * rng.standard_normal((len(wanted), n))
    q, wanted, speed = q[lead:], wanted[lead:], speed[lead:]
    extra = {f"q_cmd{j + 1}": wanted[:, j] for j in range(n)}
    if speed_command:
        extra |= {f"dq_cmd{j + 1}": speed[:, j] for j in range(n)}
    return ident.Log(name, t=np.arange(len(wanted)) / rate, q=q, extra=extra)
