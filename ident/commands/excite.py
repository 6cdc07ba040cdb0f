"""`ident excite`: a trajectory within the robot's limits that reveals its parameters best, with the accuracy to expect."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from .._utils.json import result
from ..effects.registry import make_effect
from ..errors import ConfigurationError, unknown_name
from ..estimate.estimate import Estimate
from ..excitation.design import excite, tell_apart
from ..excitation.families import BSplineFamily, FourierFamily
from ..excitation.limits import Limits
from ..excitation.noise import sample_noise
from ..excitation.objective import Both, ConditionNumber, DOptimality
from ..excitation.surroundings import Surroundings
from ..reporting import report
from .common import (
    Output,
    add_output_arguments,
    add_study_arguments,
    inputs_of,
    not_negative,
    positive,
    refuse_beside_fit,
    study_from,
    whole,
)

if TYPE_CHECKING:
    from ..excitation.families import Family
    from ..excitation.objective import Measure
    from ..excitation.result import Excitation
    from ..model import Model
    from ..robots.robot import Robot

_FAMILIES = ("fourier", "bspline")
_MEASURES = ("both", "volume", "condition")
#: Names of the files, where none is given.
_TRAJECTORY, _ROS = "excitation.csv", "excitation.yaml"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_study_arguments(parser, logs=False)
    parser.add_argument("--fit", metavar="FILE", help="saved fit (fit.json) instead of a study: its model, values and noise")
    parser.add_argument("--effects", nargs="+", metavar="EFFECT", help="effects besides the rigid body")
    parser.add_argument(
        "--trajectory",
        metavar="FILE",
        help=f"file to write: t, q, dq, ddq (default: {_TRAJECTORY}, in --out if it is given)",
    )
    parser.add_argument("--seconds", type=positive, default=10.0, help="length (default: %(default)s)")
    parser.add_argument("--rate", type=positive, default=200.0, help="samples per second (default: %(default)s)")
    parser.add_argument("--family", choices=_FAMILIES, default=_FAMILIES[0], help="kind of trajectory (default: %(default)s)")
    parser.add_argument("--measure", choices=_MEASURES, default=_MEASURES[0], help="cost function (default: %(default)s)")
    parser.add_argument(
        "--sharpen", nargs="+", metavar="PARAMETER", help="base parameters of interest; the others count as nuisance parameters"
    )
    parser.add_argument("--separate", nargs=2, metavar="EFFECT", help="two effects to distinguish")
    parser.add_argument("--noise", type=float, nargs="+", help="torque noise (std), one value or one per joint, measured side")
    room = parser.add_argument_group("surroundings: what the motion stays clear of at every moment; self-collision is always checked")
    where = "height of the ground in the base frame, m, or none (default: the height of the frame itself)"
    room.add_argument("--ground", default="base", metavar="HEIGHT", help=where)
    room.add_argument(
        "--workspace", nargs=6, type=float, metavar=("X", "X", "Y", "Y", "Z", "Z"), help="box that everything moving stays inside, m"
    )
    room.add_argument("--workspace-mesh", metavar="FILE", help="the same given as a closed convex mesh (STL, OBJ, PLY, DAE; base frame)")
    room.add_argument("--obstacle", nargs="+", action="extend", default=[], metavar="FILE", help="meshes to keep clear of (base frame)")
    room.add_argument("--mesh-scale", type=positive, default=1.0, metavar="S", help="metres per unit of those meshes (default: 1)")
    room.add_argument("--clearance", type=not_negative, default=0.02, metavar="M", help="distance to keep, m (default: %(default)s)")
    room.add_argument("--link-radius", type=positive, metavar="M", help="radius of links without a collision shape (default: up to 0.05)")
    room.add_argument("--no-collision-check", action="store_true", help="do not check collisions at all")
    limits = parser.add_argument_group("limits, joint side: one value, or one per joint (default: a share of the robot's own)")
    limits.add_argument("--limit-share", type=positive, default=0.9, metavar="S", help="share of its own limits (default: %(default)s)")
    limits.add_argument("--position-share", type=positive, metavar="S", help="share of the position range, about its centre")
    kinds = (("velocity", "rad/s, m/s"), ("acceleration", "rad/s^2, m/s^2"), ("jerk", "rad/s^3, m/s^3"), ("torque", "N m, N"))
    for name, unit in kinds:
        limits.add_argument(f"--max-{name}", type=positive, nargs="+", metavar="X", help=f"largest {name}, {unit}")
    place = parser.add_argument_group("postures, joint side, one value per joint (rad, m)")
    place.add_argument("--start-posture", nargs="+", type=float, metavar="Q", help="where the motion starts and ends (default: the best)")
    place.add_argument(
        "--from-posture",
        nargs="+",
        type=float,
        metavar="Q",
        help="present posture of the robot: a slow approach from it is added before the motion",
    )
    parser.add_argument("--view", metavar="FILE", help="write an interactive 3-D page of the swept motion (HTML; also in --out)")
    parser.add_argument(
        "--ros",
        nargs="?",
        const="",
        metavar="FILE",
        help=f"also write the motion as a ROS 2 JointTrajectory (YAML; default: {_ROS}; always in --out if it is given)",
    )
    parser.add_argument("--starts", type=whole, default=3, help="independent searches (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="seed (default: %(default)s)")
    add_output_arguments(parser)


def run(args: argparse.Namespace) -> int:
    out = Output(args)
    target = out.target(args.trajectory, _TRAJECTORY)
    if target.exists() and not args.force:
        raise ConfigurationError(f"{target} exists; nothing was designed. Choose another --trajectory, or add --force.")
    if args.fit:
        refuse_beside_fit(args)
    estimate = Estimate.load(args.fit) if args.fit else None
    model = study_from(args).model() if estimate is None else estimate.model
    model, measure = _measure(args, model)
    if args.seconds * args.rate * model.robot.n < model.base.count:
        raise ConfigurationError(
            f"{args.seconds:g} s at {args.rate:g} Hz are {int(args.seconds * args.rate)} samples: fewer equations than the"
            f" {model.base.count} base parameters; give a longer trajectory (--seconds)."
        )
    kept = None if args.ros is None or out.folder is None else out.folder / _ROS
    ros = args.ros or (_ROS if args.ros is not None and kept is None else None)
    for flag, file in (("--ros", ros), ("--view", args.view)):
        if file and Path(file).exists() and not args.force:
            raise ConfigurationError(f"{file} exists; nothing was designed. Choose another {flag}, or add --force.")
    noise = args.noise[0] if args.noise and len(args.noise) == 1 else args.noise
    if noise is None and estimate is not None:
        noise = sample_noise(estimate, args.rate)
    found = excite(
        model,
        values=estimate.all_values if estimate is not None and model is estimate.model else None,
        noise=noise,
        family=_family(args),
        measure=measure,
        limits=_limits(args, model.robot),
        surroundings=_surroundings(args),
        posture=args.start_posture,
        present=args.from_posture,
        rate=args.rate,
        starts=args.starts,
        seed=args.seed,
        progress=out.progress("searching"),
    )
    out.say(found)
    with out.together() as folder:
        found.to_csv(target if folder is None or args.trajectory is not None else folder / _TRAJECTORY, force=args.force)
        if ros:
            found.to_ros(ros, force=args.force)
        if args.view:
            found.to_view(args.view, force=args.force)
        data = {"trajectory": str(target), **found.to_dict()}
        if folder is not None:
            if kept is not None:
                found.to_ros(folder / _ROS, force=args.force)
            _keep_report(found, folder, args, out)
            found.to_view(folder / "swept.html", force=args.force)
        out.result(
            result("ident.excitation/1", data, inputs=inputs_of(args, model.robot, *args.obstacle, args.workspace_mesh)), "excitation"
        )
    out.say("wrote " + ", ".join(str(file) for file in (target, ros, kept, args.view) if file))
    return 0


def _keep_report(found: Excitation, folder: Path, args: argparse.Namespace, out: Output) -> None:
    try:
        report(found, folder / "report.html", force=args.force)
    except ConfigurationError as error:  # without the drawing library everything else is still of use
        out.note(f"no report: {error}")


def _surroundings(args: argparse.Namespace) -> Surroundings | None:
    if args.no_collision_check:
        return None
    try:
        words: dict[str, Literal["base"] | None] = {"none": None, "base": "base"}
        ground = words[args.ground] if args.ground in words else float(args.ground)
    except ValueError:
        raise ConfigurationError(f"--ground must be a height in m or none, not {args.ground!r}.") from None
    room: dict[str, Any] = {"ground": ground, "clearance": args.clearance, "link_radius": args.link_radius}
    room |= {"obstacles": args.obstacle, "workspace": args.workspace_mesh, "mesh_scale": args.mesh_scale}
    return Surroundings(**room) if args.workspace is None else Surroundings.within(args.workspace, **room)


def _limits(args: argparse.Namespace, robot: Robot) -> Limits:
    if args.limit_share > 1 or (args.position_share or 0) > 1:
        raise ConfigurationError("--limit-share and --position-share are shares of the robot's own limits: at most 1.")
    given = {name: getattr(args, f"max_{name}") for name in ("velocity", "acceleration", "torque", "jerk")}
    values = {name: x[0] if x is not None and len(x) == 1 else x for name, x in given.items()}
    ends = {}
    if args.position_share is not None:
        whole = Limits.of(robot, share=args.position_share)
        ends = {"lower": whole.lower.tolist(), "upper": whole.upper.tolist()}
    return Limits.of(robot, share=args.limit_share, **values, **ends)


def _family(args: argparse.Namespace) -> Family:
    return FourierFamily(args.seconds) if args.family == "fourier" else BSplineFamily(args.seconds)


def _measure(args: argparse.Namespace, model: Model) -> tuple[Model, Measure]:
    if args.separate and args.sharpen:
        raise ConfigurationError("--separate and --sharpen ask for different trajectories; give one of them.")
    if args.separate:
        first, second = (make_effect(name) for name in args.separate)
        return tell_apart(model, first, second)
    if args.sharpen:
        for name in args.sharpen:
            if name not in model.base.names:
                raise unknown_name("base parameter", name, model.base.names)
        return model, DOptimality(tuple(args.sharpen))
    return model, {"both": Both, "volume": DOptimality, "condition": ConditionNumber}[args.measure]()
