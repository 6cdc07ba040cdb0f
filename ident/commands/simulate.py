"""`ident simulate`: a realistic log of a robot: closed loop, friction, transmission, encoders, noise."""

from __future__ import annotations

import argparse
from dataclasses import asdict, replace
from typing import TYPE_CHECKING

import numpy as np

from .._utils.json import result
from .._utils.text import counted
from ..effects.motion import Coordinates
from ..errors import ConfigurationError
from ..estimate.estimate import Estimate
from ..logs.reading import read_logs
from ..planning.logs import require_reachable
from ..planning.plan import read_plan, simulate_plan
from ..robots.library.nominal import nominal_values
from ..robots.reach import reach
from ..robots.transmission import Side
from ..robots.urdf import some
from ..simulation.exceeded import exceeded_limits, exceeded_lines
from ..simulation.plant import Plant
from ..simulation.sensors import Quantisation, Sensors, TorqueNoise, TorqueWindow
from ..simulation.simulate import simulate
from ..simulation.trajectory import FourierTrajectory
from .common import Output, add_output_arguments, add_study_arguments, inputs_of, not_negative, positive, refuse_beside_fit, study_from
from .injected import HELP, injected

if TYPE_CHECKING:
    from ..model import Model
    from ..planning.sequence import Plan

Array = np.ndarray
#: Encoder counts a motor turn, where nothing asks for more.
_COUNTS = 4000.0
#: Name of the log, where none is given.
_LOG = "simulated.csv"
#: Longest motion (s) that is simulated at once.
_LONGEST_S = 1e5
#: Times the usual step between the points of a motion from which on (and from 1 s on) a step is a hole.
_HOLE = 50.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_study_arguments(parser, logs=False)
    parser.add_argument("--fit", metavar="FILE", help="saved fit (fit.json) instead of nominal parameters")
    parser.add_argument("--effects", nargs="+", metavar="EFFECT", help="effects besides the rigid body")
    parser.add_argument(
        "--with", dest="injected", action="append", default=[], metavar="EFFECT", help=f"{HELP}; repeat the flag for several"
    )
    parser.add_argument("--log", metavar="FILE", help=f"log to write, .csv or .csv.gz (default: {_LOG}, in --out if it is given)")
    parser.add_argument(
        "--trajectory", metavar="FILE", help="CSV with t, q1 … qn to follow; without it, a random Fourier motion within the limits"
    )
    parser.add_argument(
        "--plan", metavar="FILE", help="manifest of a step-by-step plan (ident plan): its tests are simulated, and their logs go to --out"
    )
    parser.add_argument("--tests", nargs="+", metavar="TEST", help="with --plan: only these tests, by name")
    parser.add_argument(
        "--tracking",
        choices=("controller", "exact"),
        default="controller",
        help="with --plan: a controller tracks the motion, or it is tracked exactly (default: %(default)s)",
    )
    parser.add_argument("--seconds", type=positive, default=20.0, help="length of the random motion (default: %(default)s)")
    parser.add_argument("--rate", type=positive, default=200.0, help="samples per second (default: %(default)s)")
    parser.add_argument(
        "--counts",
        type=float,
        help="encoder counts per motor turn; 0: no quantisation (default: 4000, more where a joint's step would exceed 1e-4 rad or 1e-5 m)",
    )
    parser.add_argument(
        "--noise", type=not_negative, default=0.01, help="torque noise as a share of the joint's rms torque (default: %(default)s)"
    )
    parser.add_argument(
        "--colour", type=float, default=0.0, help="correlation of the noise from one sample to the next (default: %(default)s)"
    )
    parser.add_argument("--seed", type=int, default=0, help="seed of motion and noise (default: %(default)s)")
    add_output_arguments(parser)


def run(args: argparse.Namespace) -> int:
    if args.plan:
        return _planned(args)
    if args.tests:
        raise ConfigurationError("--tests chooses tests of a plan; give the plan's manifest with --plan.")
    out = Output(args)
    target = out.target(args.log, _LOG)
    if target.exists() and not args.force:
        raise ConfigurationError(f"{target} exists; nothing was simulated. Choose another --log, or add --force.")
    declared, nominal = _plant(args)
    model, values, said = injected(declared, nominal, args.injected)
    for line in said:
        out.note(f"with {line}")
    _note_unknown(out, model, values)
    _require_length(args.seconds, "--seconds")
    desired: FourierTrajectory | Coordinates
    if args.trajectory:
        desired = sampled = _followed(args.trajectory, model)
    else:
        wave = random_motion(model, args.seed, args.seconds)
        desired, sampled = wave, wave.sample(np.arange(0.0, args.seconds, 0.01))
    typical = np.sqrt(np.mean(declared.inverse_dynamics(sampled.q, sampled.dq, sampled.ddq, nominal) ** 2, axis=0))
    # A controller holds its torque between instants: averaged over a period it is recorded as it acts, not half a period early.
    window = TorqueWindow(1.0 / _control_rate(args.rate))
    sensors = _sensors(model, args.counts, args.noise * typical, args.colour)
    sensors = replace(sensors, distortions=(window, *sensors.distortions))
    made = simulate(
        Plant(model, values), desired=desired, rate=args.rate, control_rate=_control_rate(args.rate), sensors=sensors, seed=args.seed,
        progress=out.progress("simulating"),
    )  # fmt: skip
    data = {"log": str(target), "samples": len(made.t), "rate": args.rate, "joints": list(model.robot.joint_names), "seed": args.seed}
    beyond = exceeded_limits(made)
    data["parameters"], data["exceeds"] = _named(model, values), [asdict(limit) for limit in beyond]
    with out.together() as folder:
        made.to_csv(target if folder is None or args.log is not None else folder / _LOG, force=args.force)
        out.result(result("ident.simulation/1", data, inputs=inputs_of(args, model.robot, args.trajectory)), "simulation")
    out.say(
        f"wrote {target}: {counted(len(made.t), 'sample')} at {args.rate:g} Hz of {model.robot.name} ({', '.join(model.robot.joint_names)})"
    )
    for line in exceeded_lines(beyond, model.robot):
        out.say(f"  {line}: no real robot could do this")
    return 0


def _planned(args: argparse.Namespace) -> int:
    """The tests of a plan: one log each, and the manifest beside them."""
    if args.trajectory:
        raise ConfigurationError("--plan and --trajectory are different motions; give one of them.")
    if args.log is not None:
        raise ConfigurationError(
            "--log names a single log, but a plan has one for each test, and names them; leave it out, they go to --out."
        )
    if args.out is None:
        raise ConfigurationError("--plan needs --out DIR, the folder for the tests' logs.")
    plan = read_plan(args.plan)
    if not (args.study or args.robot or args.urdf or args.fit):
        args.robot = plan.robot
    declared, nominal = _plant(args)
    model, values, said = injected(declared, nominal, args.injected)
    if model.robot.joint_names != plan.joints:
        names = ", ".join(model.robot.joint_names)
        raise ConfigurationError(
            f"plan {args.plan} is for joints {', '.join(plan.joints)} (robot {plan.robot!r}), but robot {model.robot.name!r} has {names}."
        )
    tests = plan.tests if args.tests is None else tuple(plan.test(name) for name in args.tests)
    for test in tests:
        require_reachable(test, model.robot, f"plan {args.plan}")
        _require_length(plan.trajectory(test)[0].duration, f"plan {args.plan}: test {test.name!r}")
    out = Output(args)
    assert out.folder is not None
    for line in said:
        out.note(f"with {line}")
    _note_unknown(out, model, values)
    sensors = _sensors(model, args.counts, args.noise * _typical(plan, declared, nominal), args.colour)
    # A controller holds its torque between instants: averaged over a sample it is recorded as it acts.
    sensors = replace(sensors, distortions=(TorqueWindow(1.0 / args.rate), *sensors.distortions))
    settings = {"rate": args.rate, "sensors": sensors, "progress": out.progress("simulating")}
    if args.tracking == "controller":
        settings["control_rate"] = _control_rate(args.rate)
    seconds = sum(plan.trajectory(t)[0].duration for t in tests)
    manifest = out.folder / "plan.toml"
    data = {
        "plan": str(manifest), "logs": [str(out.folder / t.log) for t in tests], "seconds": seconds, "rate": args.rate,
        "joints": list(plan.joints), "seed": args.seed, "parameters": _named(model, values),
    }  # fmt: skip
    with out.together() as folder:
        assert folder is not None
        simulate_plan(plan, Plant(model, values), folder, tests=[t.name for t in tests], tracking=args.tracking, seed=args.seed, **settings)
        out.result(result("ident.simulation/1", data, inputs=inputs_of(args, model.robot, args.plan)), "simulation")
    out.say(f"wrote {counted(len(tests), 'log')} ({seconds:.0f} s at {args.rate:g} Hz) of {model.robot.name} and {manifest}")
    return 0


def _typical(plan: Plan, model: Model, values: Array) -> Array:
    """Root mean square torque (n,) over the motion of all tests, measured side."""
    squares, count = np.zeros(model.robot.n), 0
    for test in plan.tests:
        way = plan.trajectory(test)[0]
        motion = way.sample(np.arange(0.0, way.duration, 0.05))
        squares = squares + np.sum(model.inverse_dynamics(motion.q, motion.dq, motion.ddq, values) ** 2, axis=0)
        count += len(motion.q)
    return np.sqrt(squares / max(count, 1))


def _named(model: Model, values: Array) -> dict[str, float]:
    return {p.name: float(v) for p, v in zip(model.parameters, values, strict=True)}


def _sensors(model: Model, counts: float | None, noise: Array, colour: float) -> Sensors:
    """Encoders on the motors, and torque noise (n,). `counts` None: fine enough for every joint, gearless ones included."""
    rounding: tuple[Quantisation, ...] = ()
    if counts is None:
        finest = np.array([1e-5 if j.prismatic else 1e-4 for j in model.robot.joints])
        needed = 2 * np.pi * np.max(np.abs(model.robot.transmission.K) / finest[:, None], axis=0)
        per_turn = _COUNTS * 2.0 ** np.ceil(np.log2(np.maximum(needed / _COUNTS, 1.0)))
        rounding = (Quantisation(tuple(2 * np.pi / per_turn)),)
    elif counts > 0:
        rounding = (Quantisation.counts(counts),)
    return Sensors((*rounding, TorqueNoise(tuple(noise), colour)), Side.MOTOR, columns=("q", "tau"))


def _control_rate(rate: float) -> float:
    return rate * max(1, int(np.ceil(1000.0 / rate)))


def _plant(args: argparse.Namespace) -> tuple[Model, Array]:
    if args.fit:
        refuse_beside_fit(args)
        estimate = Estimate.load(args.fit)
        return estimate.model, estimate.all_values

    study = study_from(args)
    model = study.model()
    if model.robot.nominal is None:
        raise ConfigurationError(f"robot {model.robot.name!r} has no inertials to simulate with; give a saved fit with --fit.")
    if model.robot.faults:
        raise ConfigurationError(
            f"robot {model.robot.name!r} cannot be simulated: {some(model.robot.faults)}. Correct the <inertial> there, or give a"
            f" saved fit"
            " with --fit."
        )
    return model, nominal_values(model)


def _note_unknown(out: Output, model: Model, values: Array) -> None:
    """Say which effects of the model have no nominal values: a log without friction that was asked for is not what its user thinks."""
    absent = [e.name for e, part in zip(model.effects, model.slices, strict=True) if not np.any(values[part])]
    if absent:
        out.note(f"no value is known for {', '.join(absent)} of {model.robot.name}: simulated as zero. A saved fit (--fit) has values.")


def random_motion(model: Model, seed: int, seconds: float, base_hz: float = 0.1, harmonics: int = 5) -> FourierTrajectory:
    """Random Fourier motion over most of the joint ranges (half a turn or half a metre each way at the most) and of the speed limits."""
    robot = model.robot
    rng = np.random.default_rng(seed)
    widest = np.array([0.5 if j.prismatic else np.pi for j in robot.joints])
    low, upper = reach(robot.joints, stroke=0.5)
    lower = np.maximum(low, -widest)
    lower = np.where(upper <= lower, low, lower)
    upper = np.minimum(upper, lower + 2 * widest)
    periods = max(1, round(seconds * base_hz))
    base = periods / seconds
    sine, cosine = rng.normal(size=(2, harmonics, robot.n))
    unit = FourierTrajectory(np.zeros(robot.n), sine, cosine, base, periods).sample(np.linspace(0.0, seconds, 4001))
    speed = np.array([j.velocity for j in robot.joints])
    scale = np.minimum(0.9 * (upper - lower) / np.ptp(unit.q, axis=0), 0.9 * speed / np.abs(unit.dq).max(axis=0))
    centre = (lower + upper) / 2 - scale * (unit.q.max(axis=0) + unit.q.min(axis=0)) / 2
    return FourierTrajectory(centre, scale * sine, scale * cosine, base, periods)


def _require_length(seconds: float, what: str) -> None:
    """Raise ConfigurationError for a motion that nobody means: the wrong unit of time, or a damaged file."""
    if not seconds <= _LONGEST_S:
        raise ConfigurationError(f"{what}: the motion lasts {seconds:.3g} s; more than {_LONGEST_S:.0e} s are not simulated at once.")


def _require_dense(t: Array, file: str) -> None:
    """Raise ConfigurationError for a hole between the points of a motion: nothing says how the robot moves there."""
    steps = np.diff(t)
    usual, k = float(np.median(steps)), int(np.argmax(steps))
    if steps[k] > max(_HOLE * usual, 1.0):
        raise ConfigurationError(
            f"{file}: no point of the motion lies between t = {t[k]:.6g} and {t[k + 1]:.6g} s, where the others are {usual:.3g} s"
            " apart: nothing says how the robot moves there. Correct the times, or cut the file at that gap."
        )


def _followed(file: str, model: Model) -> Coordinates:
    """The motion in a CSV file, resampled to the controller's rate by splines."""
    from scipy.interpolate import CubicSpline

    log = read_logs(file, model.robot)[0]
    _require_length(log.duration, file)
    _require_dense(log.t, file)
    spline = CubicSpline(log.t, log.position(model.robot.transmission))
    t = np.arange(log.t[0], log.t[-1], 1e-3)
    return Coordinates(spline(t), spline(t, 1), spline(t, 2))
