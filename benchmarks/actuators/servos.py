"""Servos with a known truth for the diagnosis: written beside the product, many at a time, in steps of 0.1 ms (leapfrog).

A pendulum behind a drive that holds commands of 100 Hz and acts late; friction is dry (Karnopp: it holds below its level), viscous, and
where injected grows with the load; where injected, link and motor hang together by a spring, or small errors of position are none to the
drive."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

Array = np.ndarray
STEP = 1e-4
RATE = 200
SECONDS = 6.0
NOISE = 5e-4
#: Dry friction (N m) of a joint that sticks for a while.
STICKS = 1.0
MASS, LENGTH, INERTIA, GRAVITY = 0.6, 0.2, 0.002, 9.81
URDF = f"""<robot name="servo"><link name="base"/>
  <link name="arm"><inertial><origin xyz="0 0 {-LENGTH}"/><mass value="{MASS}"/>
    <inertia ixx="{INERTIA}" ixy="0" ixz="0" iyy="{INERTIA}" iyz="0" izz="0.0005"/></inertial></link>
  <joint name="joint1" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" effort="20" velocity="30"/></joint></robot>"""
FAULTS = ("clean", "joint_elasticity", "load_dependent_friction", "kp", "delay", "deadband")


@dataclass(frozen=True)
class Servo:
    """True numbers of one servo; `stiffness` 0: rigid. `declared`: what the study says of kp, kd and delay."""

    Ia: float
    Fv: float
    Fc: float
    offset: float
    kp: float
    kd: float
    delay: float
    load: float
    stiffness: float
    deadband: float
    declared: dict[str, float]


def servo(fault: str, seed: int) -> Servo:
    """Sizes are drawn, the same for every fault of a seed but for the fault."""
    rng = np.random.default_rng([7, seed])
    kp, kd = rng.uniform(15.0, 40.0), rng.uniform(0.4, 1.0)
    late = 5e-4 * rng.integers(8, 17)
    plain = {"Ia": rng.uniform(0.006, 0.02), "Fv": rng.uniform(0.03, 0.15), "Fc": rng.uniform(0.05, 0.2), "offset": rng.uniform(-0.1, 0.1)}
    share, hz, wrong = rng.uniform(0.1, 0.3), rng.uniform(7.0, 14.0), rng.choice([0.75, 0.8, 1.25, 1.35])
    band = rng.uniform(0.005, 0.03)
    inertia = MASS * LENGTH**2 + INERTIA
    return Servo(
        **plain,
        kp=kp,
        kd=kd,
        delay=2.0 * late if fault == "delay" else late,
        load=share if fault == "load_dependent_friction" else 0.0,
        stiffness=inertia * (2.0 * np.pi * hz) ** 2 if fault == "joint_elasticity" else 0.0,
        deadband=band if fault == "deadband" else 0.0,
        declared={"kp": kp * wrong if fault == "kp" else kp, "kd": kd, "delay_s": late},
    )


def command(seed: int) -> Array:
    """(N,) at 100 Hz, held: sines of several frequencies with steps."""
    rng = np.random.default_rng([8, seed])
    t = np.arange(round(SECONDS * 100)) / 100
    out = np.zeros(len(t))
    for f in rng.uniform(0.3, 4.0, 4):
        out += 0.3 / np.sqrt(f) * np.sin(2.0 * np.pi * f * (t - 0.5))
    for _ in range(4):
        out[t > rng.uniform(0.5, SECONDS)] += rng.uniform(-0.5, 0.5)
    out[t < 0.5] = 0.0
    return out


def recorded(servos: list[Servo], seeds: list[int], stuck: tuple[float, float] = (0.0, 0.0)) -> tuple[Array, Array, Array]:
    """Times (N,), positions with noise and commands (N, B) at `RATE`; from and to the seconds `stuck`, all joints stick."""
    value = {key: np.array([getattr(s, key) for s in servos]) for key in Servo.__dataclass_fields__ if key != "declared"}
    wanted = np.stack([command(seed) for seed in seeds], axis=1)
    count, every = round(SECONDS / STEP), round(1.0 / RATE / STEP)
    late = np.rint(value["delay"] / STEP).astype(int)
    hold = round(0.01 / STEP)
    lanes = np.arange(len(servos))
    inertia = MASS * LENGTH**2 + INERTIA
    elastic = value["stiffness"] > 0
    rotor, twist = value["Ia"], 0.04 * np.sqrt(value["stiffness"] * inertia)
    q, v = np.zeros(len(servos)), np.zeros(len(servos))
    p, w = q.copy(), v.copy()
    kept = np.empty((count // every, len(servos)))
    bias = np.zeros(len(servos))
    for k in range(count):
        if k % every == 0:
            kept[k // every] = q
        sent = wanted[np.maximum(k - late, 0) // hold, lanes]
        # Positions at the middle of the step, damping by the mean speed over it.
        q, p = q + 0.5 * STEP * v, p + 0.5 * STEP * w
        gravity = MASS * GRAVITY * LENGTH * np.sin(np.where(elastic, p, q))
        spring = value["stiffness"] * (q - p) + twist * (v - w)
        error = sent - q
        error = error - np.clip(error, -value["deadband"], value["deadband"])
        drive = value["kp"] * error - value["offset"] - np.where(elastic, spring, gravity)
        mass, damped = rotor + np.where(elastic, 0.0, inertia), 0.5 * STEP * (value["kd"] + value["Fv"])
        level = value["Fc"] + value["load"] * np.abs(bias) + (STICKS if stuck[0] <= k * STEP < stuck[1] else 0.0)
        momentum = (mass - damped) * v + STEP * drive
        stop = np.clip(momentum / STEP, -level, level)
        after = np.where(np.abs(stop) < level, 0.0, (momentum - STEP * stop) / (mass + damped))
        bias = np.where(elastic, spring, inertia * (after - v) / STEP + gravity)
        w = w + STEP / inertia * np.where(elastic, spring - gravity, 0.0)
        v = after
        q, p = q + 0.5 * STEP * v, p + 0.5 * STEP * w
    noise = np.stack([np.random.default_rng([9, seed]).standard_normal(len(kept)) for seed in seeds], axis=1)
    t = np.arange(len(kept)) / RATE
    return t, kept + NOISE * noise, wanted[np.minimum((t * 100 + 1e-9).astype(int), len(wanted) - 1)]
