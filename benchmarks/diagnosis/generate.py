"""Logs with an undeclared effect in them, by forward simulation under closed-loop control.

    python -m benchmarks.diagnosis.generate FOLDER --suite development

Each case becomes FOLDER/<id>.npz (t, q, tau: one log) and a line of FOLDER/cases.jsonl (what is in it). Cases of one arm are
simulated side by side."""

from __future__ import annotations

import argparse
import json
import time
import zlib
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import groupby
from pathlib import Path

import numpy as np

from ident.effects.motion import Coordinates, Motion
from ident.robots.transmission import Side
from ident.simulation.sensors import Quantisation, Readings, TorqueNoise

from .arms import Arm, arm
from .faults import FAULTS, OUTSIDE, Fault, Setting
from .world import Lane, Run, simulate

Array = np.ndarray

SECONDS = 40.0
SHORT_SECONDS = 8.0
RATE = 200.0
#: Torque noise (standard deviation at 200 Hz, colour 0.3) as a share of each joint's rms torque.
NOISE = 0.02
_LANES = 60
#: Steps of the simulator a sample, and where stiff flanks strike each other.
STEPS, FINE_STEPS = 4, 16
#: A demand of so many times what a drive can give.
_LOST = 4.0


@dataclass(frozen=True)
class Case:
    """One log: `parts` are (fault, joint index, size); none is a clean log. `seed`: motion, noise and random choices."""

    arm: str
    parts: tuple[tuple[str, int, float], ...]
    seed: int
    kind: str
    seconds: float = SECONDS

    @property
    def id(self) -> str:
        names = "+".join(f"{name}-{j + 1}-{size:g}" for name, j, size in self.parts) or "clean"
        return f"{self.arm}_{names}_{self.seed}"


def settings(a: Arm, case: Case) -> tuple[list[Setting], Array, Array]:
    """For each part its setting; also rms torque on the motor side and reach of the motion."""
    motion = a.motion(case.seed, case.seconds)
    c = motion.sample(np.arange(0.0, case.seconds, 0.02))
    robot = a.robot
    tau = a.model.torque(Motion.of(robot, c.q, c.dq, c.ddq), a.values)
    tau = robot.transmission.torque(tau, robot.transmission.measured, Side.MOTOR)
    rms = np.sqrt(np.mean(tau**2, axis=0))
    speed = np.quantile(np.abs(robot.transmission.motor_rate(c.dq)), 0.95, axis=0)
    reach = np.stack([c.q.min(axis=0), c.q.max(axis=0)], axis=1)
    out = []
    for name, j, size in case.parts:
        rng = np.random.default_rng([case.seed, j, zlib.crc32(name.encode())])
        out.append(Setting(a, j, size, rng, rms, speed, reach, tau, case.seconds))
    return out, rms, reach


def faults(a: Arm, case: Case) -> list[Fault] | None:
    """The faults of a case; None where this arm cannot have one of them there."""
    found = []
    for (name, _, _), setting in zip(case.parts, settings(a, case)[0], strict=True):
        made = (FAULTS | OUTSIDE)[name](setting)
        if made is None:
            return None
        found.append(made)
    return found


def simulate_cases(a: Arm, cases: Sequence[Case], made: Sequence[list[Fault]]) -> list[dict[str, Array]]:
    """Logs of cases on one arm, all of one length."""
    robot = a.robot
    runs = _runs(a, [lane_of(a, case, own) for case, own in zip(cases, made, strict=True)], cases[0].seconds)
    logs = []
    for case, own, run in zip(cases, made, runs, strict=True):
        rms = settings(a, case)[1]
        measured = robot.transmission.measured
        noise = NOISE * (rms if measured == Side.MOTOR else rms * np.abs(np.diag(robot.transmission.K_inverse)))
        tau = robot.transmission.torque(run.torque, Side.MOTOR, measured)
        still = Coordinates(run.phi, np.zeros_like(run.phi), np.zeros_like(run.phi))
        readings = Readings(robot, Side.MOTOR, run.t, still, tau, lambda at, still=still: still, lambda at, tau=tau: tau)
        distortions = (*(d for f in own for d in f.distortions), Quantisation.counts(a.counts), TorqueNoise(tuple(noise), 0.3))
        rng = np.random.default_rng([case.seed, 99])
        for distortion in distortions:
            readings = distortion.apply(readings, rng)
        # Joint positions as the robot is declared: where the true transmission differs from it, so do the positions in the log.
        q = robot.transmission.joint_position(readings.motion.q)
        logs.append({"t": readings.t, "q": q, "tau": readings.tau, "noise": noise})
    return logs


def _runs(a: Arm, lanes: Sequence[Lane], seconds: float) -> list[Run]:
    """Runs of all lanes; where a flank strikes, in finer steps."""
    strikes = [lane.soft is not None and lane.soft.gap > 0.0 for lane in lanes]
    out: dict[int, Run] = {}
    for fine, steps in ((False, STEPS), (True, FINE_STEPS)):
        own = [i for i, x in enumerate(strikes) if x == fine]
        if own:
            out.update(zip(own, simulate(a, [lanes[i] for i in own], seconds, RATE, steps), strict=True))
    return [out[i] for i in range(len(lanes))]


def lane_of(a: Arm, case: Case, own: list[Fault]) -> Lane:
    """One run of a case with its faults."""
    n = a.robot.n
    limits = [f.limit for f in own if f.limit is not None]
    return Lane(
        next((f.arm for f in own if f.arm is not None), a),
        a.motion(case.seed, case.seconds),
        tuple(law for f in own for law in f.laws),
        np.min(limits, axis=0) if limits else None,
        sum((f.loss for f in own if f.loss is not None), np.zeros(n)),
        next((f.soft for f in own if f.soft is not None), None),
        min(f.change_at for f in own) if own else np.inf,
        next((f.changed for f in own if f.changed is not None), None),
    )


def generate(folder: Path, cases: Iterable[Case]) -> None:
    """Simulate what the folder does not hold yet."""
    folder.mkdir(parents=True, exist_ok=True)
    index = folder / "cases.jsonl"
    known = {json.loads(line)["id"] for line in index.read_text().splitlines()} if index.exists() else set()
    wanted = [c for c in cases if c.id not in known]
    start, done = time.monotonic(), 0
    for (name, _), group in groupby(sorted(wanted, key=_alike), key=_alike):
        a = arm(name)
        own = [(c, made) for case in group for c, made in possible(a, case) if c.id not in known]
        for batch in [own[i : i + _LANES] for i in range(0, len(own), _LANES)]:
            try:
                logs = simulate_cases(a, [c for c, _ in batch], [m for _, m in batch])
            except Exception as error:  # noqa: BLE001 - a fault that makes one batch impossible must not lose the others
                print(f"failed: {', '.join(c.id for c, _ in batch)}: {error}", flush=True)
                continue
            for (case, made), log in zip(batch, logs, strict=True):
                if not np.all(np.isfinite(log["tau"])) or _out_of_hand(a, made, log):
                    print(f"{case.id}: the simulated motion grows without bound", flush=True)
                    continue
                np.savez_compressed(folder / f"{case.id}.npz", **log)
                with index.open("a") as out:
                    out.write(json.dumps(record_of(case, made)) + "\n")
            done += len(batch)
            print(f"{done} of {len(wanted)} cases, {time.monotonic() - start:.0f} s", flush=True)


def record_of(case: Case, made: Sequence[Fault]) -> dict[str, object]:
    """What is in a case, as it is written down beside its log."""
    return {
        "id": case.id,
        "arm": case.arm,
        "kind": case.kind,
        "seed": case.seed,
        "parts": [_record(f) for f in made],
        "case": asdict(case),
    }


def _out_of_hand(a: Arm, made: Sequence[Fault], log: dict[str, Array]) -> bool:
    """Whether a drive with a limit was asked for many times that: the controller has lost the arm, and nobody would keep such a log."""
    tau = a.robot.transmission.torque(log["tau"], a.robot.transmission.measured, Side.MOTOR)
    return any(f.limit is not None and bool(np.any(np.abs(tau) > _LOST * f.limit)) for f in made)


def possible(a: Arm, case: Case) -> list[tuple[Case, list[Fault]]]:
    """The case with its faults; a single fault that cannot be on that joint goes to the next one that can have it; else nothing."""
    turns = a.robot.n if len(case.parts) == 1 else 1
    for turn in range(turns):
        moved = replace(case, parts=tuple((name, (j + turn) % a.robot.n, size) for name, j, size in case.parts))
        made = faults(a, moved)
        if made is not None:
            return [(moved, made)]
    return []


def _alike(case: Case) -> tuple[str, float]:
    """Cases that can be simulated side by side."""
    return case.arm, case.seconds


def _record(f: Fault) -> dict[str, object]:
    return {
        "effect": f.effect,
        "joints": list(f.joints),
        "truth": {k: float(v) for k, v in f.truth.items()},
        "outside": f.outside,
        "undeclared": f.undeclared,
    }


#: Suite → robots, first seed, clean logs a robot. Another first seed gives other motions, joints, noise and random choices.
SUITES = {
    "development": (("puma560", "xarm7", "scara"), 100, 25),
    "final": (("puma560", "xarm7", "scara", "ur5"), 5000, 51),
}


def suite(name: str, first: int | None = None) -> list[Case]:
    """`development`: what the engine is worked on; `final`: other robots, seeds and joints, looked at once; `short`: a handful of
    small ones. `first`: another first seed."""
    if name == "short":
        return _short(7000 if first is None else first)
    arms, usual, clean = SUITES[name]
    first = usual if first is None else first
    rng = np.random.default_rng(first)
    out: list[Case] = []
    seed = first
    for arm_name in arms:
        n = arm(arm_name).robot.n
        for sizes in ((1.0,), (0.5,), (2.0,)):
            for effect in FAULTS:
                seed += 1
                out.append(Case(arm_name, ((effect, int(rng.integers(n)), float(rng.choice(sizes))),), seed, "single"))
        for effect in OUTSIDE:
            for size in (0.7, 1.5):
                seed += 1
                out.append(Case(arm_name, ((effect, int(rng.integers(n)), size),), seed, "outside"))
        for _ in range(20):
            seed += 1
            names = [str(x) for x in rng.choice([x for x in FAULTS if x not in _ABSORBED], 2, replace=False)]
            joints = rng.choice(n, 2, replace=False)
            out.append(Case(arm_name, tuple((x, int(j), 1.5) for x, j in zip(names, joints, strict=True)), seed, "pair"))
        for _ in range(clean):
            seed += 1
            out.append(Case(arm_name, (), seed, "clean"))
    return out


def _short(first: int) -> list[Case]:
    """One of each kind, on the robot with the fewest joints."""
    parts = {
        "clean": (),
        "single": (("asymmetric_viscous", 1, 2.0),),
        "pair": (("linear_spring", 1, 2.0), ("offset", 2, 2.0)),
        "outside": (("bumper", 0, 1.5),),
    }
    return [Case("scara", own, first + i, kind, SHORT_SECONDS) for i, (kind, own) in enumerate(parts.items())]


#: Faults that base parameters mostly take up: there is next to nothing to find.
_ABSORBED = ("gravity_magnitude", "link_length", "encoder_scale", "encoder_offset", "base_tilt", "rotor_inertia")


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--suite", default="development", choices=[*SUITES, "short"])
    parser.add_argument("--first", type=int, help="another first seed")
    parser.add_argument("--arm")
    parser.add_argument("--kind")
    parser.add_argument("--only", help="part of the case's id")
    args = parser.parse_args()
    cases = [c for c in suite(args.suite, args.first) if (not args.arm or c.arm == args.arm) and (not args.kind or c.kind == args.kind)]
    generate(args.folder, [c for c in cases if not args.only or args.only in c.id])


if __name__ == "__main__":
    main()
