"""`ident plan`: the tests of a step-by-step identification, as a manifest for programs and a text for people."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

import numpy as np

from .._utils.json import result
from ..errors import ConfigurationError
from ..excitation.limits import Limits
from ..planning.plan import make_plan, write_plan
from ..planning.text import plan_text
from ..robots.library.published import plan_names
from ..simulation.result import write_log_csv
from .common import Output, add_output_arguments, add_study_arguments, inputs_of, study_from

if TYPE_CHECKING:
    from ..planning.sequence import Plan


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_study_arguments(parser, logs=False)
    parser.add_argument(
        "--effects", nargs="+", metavar="EFFECT", help="effects besides the rigid body (default: rotor_inertia viscous coulomb)"
    )
    parser.add_argument("--postures", type=int, default=3, help="least number of postures of an accelerated test (default: %(default)s)")
    parser.add_argument(
        "--separation",
        choices=("safe", "coupled"),
        default="safe",
        help="how to separate rotor and link inertia: safe, as if every motor moved its joint alone (more tests, less sensitive to"
        " noise), or by coupled gears where possible (fewest tests, sensitive to noise) (default: %(default)s)",
    )
    parser.add_argument(
        "--published",
        choices=plan_names(),
        help="use a published plan of the robot instead of a search: yoshida1995, the 13 accelerated tests for the PUMA 560",
    )
    parser.add_argument("--share", type=float, default=0.9, help="share of the joints' ranges and speeds to use (default: %(default)s)")
    parser.add_argument("--motion", type=float, metavar="HZ", help="with --out: also write the motion of every test as CSV at this rate")
    parser.add_argument("--seed", type=int, default=0, help="seed of the postures (default: %(default)s)")
    add_output_arguments(parser)


def run(args: argparse.Namespace) -> int:
    if args.motion is not None and (args.out is None or not args.motion > 0):
        raise ConfigurationError("--motion HZ needs a positive rate, and --out DIR for the files.")
    if not 0 < args.share <= 1:
        raise ConfigurationError(f"--share must lie in (0, 1], not {args.share:g}.")
    out = Output(args)
    study = study_from(args)
    robot = study.robot()
    plan = make_plan(
        study.model(robot),
        limits=Limits.of(robot, share=args.share),
        postures=args.postures,
        separation=args.separation,
        published=args.published,
        seed=args.seed,
    )
    out.say(plan_text(plan, robot))
    manifest = None if out.folder is None else out.folder / "plan.toml"
    data = {"manifest": None if manifest is None else str(manifest), "duration": plan.duration, **plan.to_dict()}
    data.pop("schema")
    with out.together() as folder:
        if folder is not None:
            write_plan(plan, folder / "plan.toml")
            out.keep("plan.txt", plan_text(plan, robot) + "\n")
            if args.motion is not None:
                _write_motion(plan, out, args.motion)
        out.result(result("ident.plan/1", data, inputs=inputs_of(args, robot)), "plan")
    if manifest is not None:
        out.note(f"wrote {manifest}")
    return 0 if plan.rank == len(plan.base) else 1


def _write_motion(plan: Plan, out: Output, rate: float) -> None:
    for test in plan.tests:
        way = plan.trajectory(test)[0]
        t = np.arange(int(way.duration * rate + 1e-9) + 1) / rate
        motion = way.sample(t)
        path = out.path("motion_" + test.log.removesuffix(".gz"))
        assert path is not None
        write_log_csv(path, t, {"q": motion.q, "dq": motion.dq, "ddq": motion.ddq}, force=out.force)
