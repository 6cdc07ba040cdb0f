"""`ident base`: which combinations of parameters a robot's torques reveal, in symbols, without a log."""

from __future__ import annotations

import argparse

import numpy as np

from .._utils.json import result
from ..logs.reading import read_logs
from ..problem.base_report import base_report
from ..problem.problem import Problem
from ..regressor.base_parameters.principal import principal_parameters
from ..regressor.virtual_parameters import virtual_parameters
from ..signals.preparation import ZeroPhase
from .common import Output, add_output_arguments, add_study_arguments, inputs_of, study_from

#: Operations are counted for parameters of which none is zero.
GENERIC = np.random.default_rng(0)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_study_arguments(parser, logs=False)
    add_output_arguments(parser)
    parser.add_argument("--rotor-inertia", action="store_true", help="include the motors' reflected inertias as parameters")
    parser.add_argument("--floating-base", action="store_true", help="floating base (six more equations)")
    parser.add_argument(
        "--operations",
        action="store_true",
        help="count the operations of recursive inverse dynamics with all link parameters, and with virtual ones",
    )
    parser.add_argument(
        "--principal",
        nargs="+",
        metavar="FILE",
        help="logs: rank orthogonal parameter combinations by their contribution to the torque along this motion",
    )


def run(args: argparse.Namespace) -> int:
    out = Output(args)
    study = study_from(args)
    robot = study.robot()
    if args.floating_base:
        from dataclasses import replace

        study = replace(study, description=replace(study.description, robot=replace(study.description.robot, floating_base=True)))
        robot = study.robot()
    principal = _principal(args.principal, robot) if args.principal else None
    report = base_report(robot, rotor_inertia=args.rotor_inertia, principal=principal)
    out.say(report)
    body = report.to_dict()
    if args.operations:
        base = robot.rigid_body().base
        counted = virtual_parameters(robot, base, base.base_values(GENERIC.uniform(0.1, 0.9, 10 * robot.tree.nb)))
        out.say_wrapped(counted)
        body["operations"] = counted.to_dict()
    out.result(result("ident.base/1", body, inputs=inputs_of(args, robot, *(args.principal or ())), warnings=report.notes), "base")
    return 0 if report.agreement else 1


def _principal(files, robot):  # type: ignore[no-untyped-def]
    problem = Problem(robot.rigid_body(), ZeroPhase()(read_logs(files, robot)))
    information = problem.information
    R, _, _ = information.combined(np.where(information.counts > 0, 1.0, 0.0))
    return principal_parameters(R, information.names, rows=int(information.counts.sum()))
