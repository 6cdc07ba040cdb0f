"""Mistakes in a log that leave it readable: does a fit of it ever look sound while its parameters are wrong?

`python -m benchmarks.robustness.mistakes --count 200` draws mistakes in units, signs, order and clocks on simulated logs of three robots,
fits each as the command line does, and counts those that end without an error or a warning while a parameter is off by more than ten of
its standard deviations; and, on as many logs without a mistake, those that are warned of."""

from __future__ import annotations

import argparse
import time
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pandas as pd

import ident
from ident.errors import IdentError
from ident.estimate.status import StatusCode
from ident.study.session import Session

Array = np.ndarray
Table = dict[str, Array]
ROBOTS = ("puma560", "ur5", "z1")
#: A parameter is wrong if it is off by so many standard deviations, and by this share of the largest of its kind.
_DEVIATIONS, _SHARE = 10.0, 0.02
_SECONDS, _RATE, _NOISE = 12.0, 200.0, 0.02


@dataclass(frozen=True)
class World:
    """A robot with friction, its true values, and how its torque is named."""

    name: str
    model: ident.Model
    values: Array
    side: str

    @classmethod
    def of(cls, name: str) -> World:
        """Friction of a tenth of what gravity and motion ask for."""
        robot = ident.load_robot(name)
        model = robot.rigid_body() + ident.make_effect("viscous") + ident.make_effect("coulomb")
        values = np.concatenate([np.zeros(0) if robot.nominal is None else robot.nominal, np.zeros(2 * robot.n)])
        q, dq, ddq = motion(robot, np.random.default_rng(1))[1:]
        size = np.sqrt(np.mean(model.inverse_dynamics(q, dq, ddq, values) ** 2, axis=0)) + 1e-3
        values[-2 * robot.n :] = np.concatenate([0.1 * size / np.sqrt(np.mean(dq**2, axis=0)), 0.1 * size])
        return cls(name, model, values, "tau_m" if robot.transmission.measured == "motor" else "tau")

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.model.robot.n

    def log(self, rng: np.random.Generator) -> Table:
        """A right log: positions to 1e-6 rad, torque with white noise."""
        t, q, dq, ddq = motion(self.model.robot, rng)
        tau = self.model.inverse_dynamics(q, dq, ddq, self.values)
        tau = tau + _NOISE * np.sqrt(np.mean(tau**2, axis=0)) * rng.standard_normal(tau.shape)
        q = q + 1e-5 * rng.standard_normal(q.shape)
        columns = {f"q{j + 1}": q[:, j] for j in range(self.n)} | {f"{self.side}{j + 1}": tau[:, j] for j in range(self.n)}
        return {"t": t + rng.uniform(0.0, 100.0)} | columns

    def wrong(self, estimate: ident.Estimate) -> list[str]:
        """Names of parameters that are off beyond what their standard deviations say."""
        truth = estimate.base.regroup @ self.values
        kinds: dict[str, float] = defaultdict(float)
        for name, value in zip(estimate.names, truth, strict=True):
            kinds[name.split("_")[0]] = max(kinds[name.split("_")[0]], abs(value))
        return [
            name
            for name, value, right, std in zip(estimate.names, estimate.values, truth, estimate.std, strict=True)
            if abs(value - right) > _DEVIATIONS * std and abs(value - right) > _SHARE * kinds[name.split("_")[0]]
        ]


def motion(robot: ident.Robot, rng: np.random.Generator) -> tuple[Array, Array, Array, Array]:
    """Times (N,), positions, velocities and accelerations (N, n) of three harmonics a joint, within the limits."""
    t = np.arange(0.0, _SECONDS, 1.0 / _RATE)
    q, dq, ddq = (np.zeros((len(t), robot.n)) for _ in range(3))
    for j, joint in enumerate(robot.joints):
        size, centre = 0.6, 0.0
        if np.isfinite(joint.lower) and np.isfinite(joint.upper):
            centre, size = 0.5 * (joint.lower + joint.upper), min(0.6, 0.15 * (joint.upper - joint.lower))
        q[:, j] = centre + (0.2 * size * rng.standard_normal() if np.isfinite(centre) else 0.0)
        for k in range(3):
            w, a, phase = 2 * np.pi * rng.uniform(0.1, 0.7), size / (k + 1), rng.uniform(0.0, 2 * np.pi)
            q[:, j] += a * np.sin(w * t + phase)
            dq[:, j] += a * w * np.cos(w * t + phase)
            ddq[:, j] -= a * w**2 * np.sin(w * t + phase)
    return t, q, dq, ddq


def _scaled(table: Table, keys: list[str], factor: float) -> Table:
    return table | {key: factor * table[key] for key in keys}


def _permuted(table: Table, keys: list[str], order: Array) -> Table:
    return table | {key: table[keys[int(k)]] for key, k in zip(keys, order, strict=True)}


def _q(world: World) -> list[str]:
    return [f"q{j + 1}" for j in range(world.n)]


def _tau(world: World) -> list[str]:
    return [f"{world.side}{j + 1}" for j in range(world.n)]


def _one(keys: list[str], rng: np.random.Generator) -> list[str]:
    return [keys[int(rng.integers(len(keys)))]]


def _swap(count: int, rng: np.random.Generator) -> Array:
    order = np.arange(count)
    a, b = rng.choice(count, 2, replace=False)
    order[[a, b]] = order[[b, a]]
    return order


def _late(table: Table, keys: list[str], samples: int) -> Table:
    rows = np.maximum(np.arange(len(table["t"])) - samples, 0)
    return table | {key: table[key][rows] for key in keys}


Mistake = Callable[[Table, World, np.random.Generator], Table]
MISTAKES: dict[str, Mistake] = {
    "time in ms": lambda t, w, r: _scaled(t, ["t"], 1e3),
    "time in us": lambda t, w, r: _scaled(t, ["t"], 1e6),
    "time in minutes": lambda t, w, r: _scaled(t, ["t"], 1 / 60),
    "time in seconds, said to be ms": lambda t, w, r: {"t_ms": t["t"]} | {k: v for k, v in t.items() if k != "t"},
    "time in days": lambda t, w, r: _scaled(t, ["t"], 1 / 86400),
    "samples counted": lambda t, w, r: t | {"t": np.arange(len(t["t"]), dtype=float)},
    "time at half the rate": lambda t, w, r: _scaled(t, ["t"], 2.0),
    "degrees": lambda t, w, r: _scaled(t, _q(w), 180 / np.pi),
    "degrees on one joint": lambda t, w, r: _scaled(t, _one(_q(w), r), 180 / np.pi),
    "radians, said to be degrees": lambda t, w, r: {(f"{k}_deg" if k.startswith("q") else k): v for k, v in t.items()},
    "revolutions": lambda t, w, r: _scaled(t, _q(w), 1 / (2 * np.pi)),
    "every torque turned": lambda t, w, r: _scaled(t, _tau(w), -1.0),
    "one torque turned": lambda t, w, r: _scaled(t, _one(_tau(w), r), -1.0),
    "one position turned": lambda t, w, r: _scaled(t, _one(_q(w), r), -1.0),
    "every position turned": lambda t, w, r: _scaled(t, _q(w), -1.0),
    "positions swapped": lambda t, w, r: _permuted(t, _q(w), _swap(w.n, r)),
    "torques swapped": lambda t, w, r: _permuted(t, _tau(w), _swap(w.n, r)),
    "torques shifted by one": lambda t, w, r: _permuted(t, _tau(w), np.roll(np.arange(w.n), 1)),
    "positions shifted by one": lambda t, w, r: _permuted(t, _q(w), np.roll(np.arange(w.n), -1)),
    "torque of one joint ten times": lambda t, w, r: _scaled(t, _one(_tau(w), r), 10.0),
    "torque late by 20 samples": lambda t, w, r: _late(t, _tau(w), 20),
    "one position late by 10 samples": lambda t, w, r: _late(t, _one(_q(w), r), 10),
    "one position off by half a radian": lambda t, w, r: t | {k: t[k] + 0.5 for k in _one(_q(w), r)},
}


@dataclass(frozen=True)
class Ended:
    """How a fit of a log ended: an `error`, its `warnings`, and the `wrong` parameters."""

    error: str
    warnings: tuple[str, ...]
    wrong: tuple[str, ...]

    @property
    def silent(self) -> bool:
        """Whether it looks sound and is not."""
        return not self.error and not self.warnings and bool(self.wrong)


def ended(world: World, table: Table, folder: Path) -> Ended:
    """A fit as `ident fit --log` makes it."""
    pd.DataFrame(table).to_csv(folder / "log.csv", index=False)
    study = ident.Study.from_flags(robot=world.name, logs=[folder / "log.csv"], effects=["viscous", "coulomb"])
    session = Session(study)
    try:
        warnings = session.audit.warnings
        estimate = session.estimate
    except IdentError as error:
        return Ended(str(error), (), ())
    # What a log does not tell is said by the status: that is no alarm, but no sound fit either.
    poor = estimate.status.code != StatusCode.OK
    return Ended("", (*warnings, *estimate.warnings), () if poor else tuple(world.wrong(estimate)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=200, help="mistaken logs")
    parser.add_argument("--minutes", type=float, default=float("inf"), help="stop after so long, and count what was done")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kind", help="only mistakes whose name holds this")
    args = parser.parse_args()
    kinds = [k for k in MISTAKES if args.kind is None or args.kind in k]
    worlds = [World.of(name) for name in ROBOTS]
    told: dict[str, list[Ended]] = defaultdict(list)
    right: list[Ended] = []
    end = time.monotonic() + 60.0 * args.minutes
    with TemporaryDirectory() as folder:
        for k in range(args.count):
            if time.monotonic() > end:
                break
            rng = np.random.default_rng([args.seed, k])
            world, kind = worlds[k % len(worlds)], kinds[(k // len(worlds)) % len(kinds)]
            found = ended(world, MISTAKES[kind](world.log(rng), world, rng), Path(folder))
            told[kind].append(found)
            if found.silent:
                print(f"  silent: {kind}, {world.name}, seed {args.seed} {k}: {', '.join(found.wrong[:6])}", flush=True)
            right.append(ended(world, world.log(rng), Path(folder)))
            if right[-1].error or right[-1].warnings:
                print(f"  false: {world.name}, seed {args.seed} {k}: {(right[-1].error or right[-1].warnings[0])[:200]}", flush=True)
    print(f"{'mistake':<36} {'logs':>5} {'refused':>8} {'warned':>7} {'harmless':>9} {'silent':>7}")
    for kind, group in told.items():
        refused, warned = sum(bool(e.error) for e in group), sum(bool(e.warnings) for e in group)
        silent = sum(e.silent for e in group)
        print(f"{kind:<36} {len(group):>5} {refused:>8} {warned:>7} {len(group) - refused - warned - silent:>9} {silent:>7}")
    alarmed = sum(bool(e.error or e.warnings) for e in right)
    off = sum(bool(e.wrong) for e in right)
    print(f"{'none (right logs)':<36} {len(right):>5} {'':>8} {alarmed:>7}   with a parameter off by ten deviations: {off}")
    print(f"silent and wrong: {sum(e.silent for g in told.values() for e in g)} of {sum(map(len, told.values()))}")


if __name__ == "__main__":
    main()
