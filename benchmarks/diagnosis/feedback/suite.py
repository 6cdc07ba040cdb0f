"""`python -m benchmarks.diagnosis.feedback.suite FOLDER --first SEED --setups N`: cases of arms under feedback, as they come.

A setup is an arm, a style of motion, a controller in the loop (rate, encoder counts, current loop, restless friction) and a way to
record (rate, length, jitter, single precision, with or without the motion wanted), all drawn from its seed. Each setup gives logs with
nothing missing, with one fault of the catalogue, with two, and with one that no catalogue holds; `benchmarks.diagnosis.run_cases`
diagnoses them."""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

from ident.effects.motion import Coordinates
from ident.robots.transmission import Side
from ident.simulation.sensors import Quantisation, Readings

from ..arms import ARMS, Arm, arm
from ..drive import SampledDrive
from ..fault import Fault
from ..faults import FAULTS, OUTSIDE
from ..generate import Case, lane_of, possible, record_of, settings
from ..motions import STYLES
from ..world import Run, simulate

Array = np.ndarray
#: The simulator's own rate (Hz), a multiple of every rate of log and controller.
_HERTZ = 2000.0
#: Faults that base parameters mostly take up: there is next to nothing to find.
_ABSORBED = ("gravity_magnitude", "link_length", "encoder_scale", "encoder_offset", "base_tilt", "rotor_inertia")
#: Flanks that strike need finer steps than a sampled drive is simulated in.
_TOO_STIFF = ("backlash",)


@dataclass(frozen=True)
class Setup:
    """What logs of one kind have in common. `noise`: of the torque reading, a share of its rms, coloured by `pole`."""

    arm: str
    seed: int
    seconds: float
    rate: float
    drive: SampledDrive
    noise: float
    pole: float
    jitter: float
    single_precision: bool
    reference: bool

    @classmethod
    def drawn(cls, seed: int) -> Setup:
        rng = np.random.default_rng([seed, 1])
        robot = str(rng.choice(sorted(ARMS)))
        drive = SampledDrive(
            hertz=float(rng.choice([1000.0, 1000.0, 2000.0, 500.0])),
            counts=float(rng.choice([1000.0, 4096.0, 16384.0])) * (16.0 if robot == "direct_drive" else 1.0),
            current_lag=float(rng.choice([0.0003, 0.0006, 0.0012])),
            restless=float(rng.choice([0.005, 0.015, 0.03])),
            memory=float(rng.uniform(0.03, 0.12)),
            rough=float(rng.choice([0.0, 0.005])),
            seed=seed,
        )
        return cls(
            f"{robot}.{rng.choice(STYLES, p=[0.4, 0.25, 0.15, 0.2])}",
            seed,
            float(rng.choice([30.0, 40.0, 60.0, 90.0])),
            float(rng.choice([100.0, 200.0, 250.0, 500.0, 1000.0])),
            drive,
            float(rng.choice([0.005, 0.01, 0.02])),
            float(rng.choice([0.0, 0.4, 0.7])),
            float(rng.choice([0.0, 0.0, 0.15])),
            bool(rng.random() < 0.3),
            bool(rng.random() < 0.5),
        )


def cases_of(setup: Setup, counts: dict[str, int]) -> list[Case]:
    """Cases by kind, with faults, joints and sizes drawn from the setup's seed."""
    rng = np.random.default_rng([setup.seed, 2])
    n = arm(setup.arm).robot.n
    names = [x for x in FAULTS if x not in _TOO_STIFF]
    seeds = iter(range(1000 * setup.seed, 1000 * setup.seed + 1000))

    def part(name: str, sizes: Sequence[float], j: int | None = None) -> tuple[str, int, float]:
        return name, int(rng.integers(n)) if j is None else j, float(rng.choice(sizes))

    out = [Case(setup.arm, (), next(seeds), "clean", setup.seconds) for _ in range(counts["clean"])]
    for kind, known, sizes in (("single", names, (0.5, 1.0, 2.0)), ("outside", list(OUTSIDE), (0.7, 1.5))):
        chosen = rng.permutation(known)[: counts[kind]]
        out += [Case(setup.arm, (part(str(name), sizes),), next(seeds), kind, setup.seconds) for name in chosen]
    for _ in range(counts["pair"]):
        two = rng.choice([x for x in names if x not in _ABSORBED], 2, replace=False)
        at = rng.choice(n, 2, replace=False)
        parts = tuple(part(str(x), (1.5,), int(j)) for x, j in zip(two, at, strict=True))
        out.append(Case(setup.arm, parts, next(seeds), "pair", setup.seconds))
    return out


def simulate_setup(setup: Setup, cases: Sequence[Case], made: Sequence[list[Fault]]) -> list[dict[str, Array]]:
    """Logs of cases of one setup."""
    a = arm(setup.arm)
    lanes = [lane_of(a, case, own) for case, own in zip(cases, made, strict=True)]
    runs = simulate(a, lanes, setup.seconds, _HERTZ, 1, setup.drive)
    return [_recorded(a, setup, case, own, run) for case, own, run in zip(cases, made, runs, strict=True)]


def _recorded(a: Arm, setup: Setup, case: Case, own: Sequence[Fault], run: Run) -> dict[str, Array]:
    """The log of a run: faults of the sensors, counts, noise, stamps."""
    robot, transmission = a.robot, a.robot.transmission
    rng = np.random.default_rng([case.seed, 99])
    measured = transmission.measured
    tau = transmission.torque(run.torque, Side.MOTOR, measured)
    still = Coordinates(run.phi, np.zeros_like(run.phi), np.zeros_like(run.phi))
    readings = Readings(robot, Side.MOTOR, run.t, still, tau, lambda at: still, lambda at: tau)
    for distortion in (*(d for f in own for d in f.distortions), Quantisation.counts(setup.drive.counts)):
        readings = distortion.apply(readings, rng)
    stride = round(_HERTZ / setup.rate)
    at = np.arange(0, len(run.t), stride)
    at = np.clip(at + np.round(rng.normal(scale=setup.jitter * stride, size=len(at))).astype(int), 0, len(run.t) - 1)
    at = np.unique(at)
    rms = settings(a, case)[1]
    scale = setup.noise * (rms if measured == Side.MOTOR else rms * np.abs(np.diag(transmission.K_inverse)))
    white = rng.normal(size=(len(at) + 200, robot.n))
    noise = lfilter([np.sqrt(1 - setup.pole**2)], [1.0, -setup.pole], white, axis=0)[200:] * scale
    kept = {
        "t": run.t[at],
        "q": transmission.joint_position(readings.motion.q[at]),
        "tau": readings.tau[at] + noise,
        "noise": noise + transmission.torque(run.restless[at], Side.MOTOR, measured),
    }
    if setup.reference:
        kept["q_ref"] = a.motion(case.seed, case.seconds).sample(kept["t"]).q
    if setup.single_precision:
        kept |= {k: kept[k].astype(np.float32).astype(float) for k in kept if k not in ("t", "noise")}
    return kept


def generate(folder: Path, setups: Sequence[Setup], counts: dict[str, int]) -> None:
    """Simulate what the folder does not hold yet."""
    folder.mkdir(parents=True, exist_ok=True)
    index = folder / "cases.jsonl"
    known = {json.loads(line)["setup"]["seed"] for line in index.read_text().splitlines()} if index.exists() else set()
    begin = time.monotonic()
    for k, setup in enumerate(s for s in setups if s.seed not in known):
        a = arm(setup.arm)
        both = [x for case in cases_of(setup, counts) for x in possible(a, case)]
        try:
            logs = simulate_setup(setup, [c for c, _ in both], [m for _, m in both])
        except Exception as error:  # noqa: BLE001 - one setup that cannot be must not lose the others
            print(f"{setup}: failed: {error}", flush=True)
            continue
        with index.open("a") as out:
            for (case, made), log in zip(both, logs, strict=True):
                if not all(np.isfinite(x).all() for x in log.values()):
                    print(f"{case.id}: the simulated motion grows without bound", flush=True)
                    continue
                np.savez_compressed(folder / f"{case.id}.npz", **log)
                out.write(json.dumps(record_of(case, made) | {"setup": asdict(setup)}) + "\n")
        print(f"{k + 1}: {setup.arm}, {len(both)} cases, {time.monotonic() - begin:.0f} s", flush=True)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--first", type=int, default=20000, help="seed of the first setup; the others follow")
    parser.add_argument("--setups", type=int, default=12)
    parser.add_argument("--counts", default="clean=3,single=4,pair=1,outside=2", help="logs of each kind in a setup")
    args = parser.parse_args()
    counts = {kind: int(count) for kind, _, count in (x.partition("=") for x in args.counts.split(","))}
    generate(args.folder, [Setup.drawn(args.first + k) for k in range(args.setups)], counts)


if __name__ == "__main__":
    main()
