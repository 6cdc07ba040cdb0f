"""`ident judge`: is an estimate physically possible, is it consistent? And the least repair where it is not, as a fit of its own."""

from __future__ import annotations

import argparse
import json
from typing import TYPE_CHECKING, Any

from .._utils.json import result
from .._utils.text import wrapped
from ..errors import ConfigurationError, unknown_name
from ..estimate.estimate import Estimate
from ..physical import (
    DEFINITIONS,
    Bounds,
    MinorOrder,
    judge,
    judge_by_cone,
    judge_on_grid,
    nominal_prior,
    published_subject,
    repair,
    repair_estimate,
    subject_of,
    with_repair,
)
from ..reporting import report_of
from ..robots.library.load import load_robot
from ..robots.library.published import published_tables
from ..signals.likewise import like
from .common import Output, add_log_argument, add_output_arguments
from .compare import logs_for
from .kept_report import keep_report

if TYPE_CHECKING:
    from ..physical import Prior, Repair, Subject
    from ..signals.signals import Signals


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("fit", nargs="?", help="saved fit (fit.json)")
    parser.add_argument("--robot", help="built-in robot whose published parameters are judged")
    parser.add_argument("--table", metavar="NUMBER", help="which of its published tables")
    parser.add_argument("--limits", action="store_true", help="judge within the joint limits only")
    parser.add_argument("--grid", type=int, metavar="POINTS", help="also judge by leading minors, at this many positions of every joint")
    parser.add_argument(
        "--cone", choices=[o.value for o in MinorOrder], help="also judge by the cones of these minors (revolute chains with few joints)"
    )
    parser.add_argument(
        "--repair",
        metavar="METHOD",
        help="also repair it: fit (constrained fit), consistent, possible, stepwise, or cone (the source's Steps 1 to 4, for a few"
        " joints);"
        " of a saved fit, --out keeps the repaired one",
    )
    add_log_argument(parser, "held-out logs on which the repair is compared with the fit", "--validate")
    parser.add_argument("--study", metavar="FILE", help="study file whose [columns] and validation logs are used for that")
    parser.add_argument("--missing", choices=("refuse", "gap"), help="blocks of missing positions in those logs")
    parser.add_argument(
        "--total-mass",
        nargs=2,
        type=float,
        metavar=("LEAST", "MOST"),
        help="known mass of all moving links together, kg (repair fit or consistent)",
    )
    parser.add_argument("--spread", type=float, help="relative standard deviation about the URDF's links (repair fit or consistent)")
    parser.add_argument("--strict", action="store_true", help="exit with 1 if the set is not possible")
    add_output_arguments(parser)


def run(args: argparse.Namespace) -> int:
    out = Output(args)
    estimate, subject = _subject(args)
    if not args.repair and (args.log or args.study or args.total_mass or args.spread):
        raise ConfigurationError("--validate, --study, --total-mass and --spread are for a repair: add --repair METHOD.")
    held = _held(args, estimate)
    # A request that cannot be met is refused before anything is computed.
    bounds, prior = _knowledge(args, estimate)
    others, lines = _by_the_source(args, subject)
    judgement = judge(subject, limits=args.limits)
    out.say("\n".join([*judgement.verdicts(), *lines, "", *DEFINITIONS]))
    body = judgement.to_dict() | others
    inputs = estimate.inputs if estimate is not None else ()
    if held is not None:
        inputs = (*inputs, *held.inputs)
    repaired: Estimate | None = None
    if args.repair:
        found = _repair(args, estimate, subject, held, bounds, prior)
        out.say()
        for line in found.text().splitlines():
            out.say(wrapped(line))
        body["repair"] = found.to_dict()
        if estimate is not None:
            repaired = with_repair(estimate, found)
            if held is not None:
                repaired = repaired.with_heldout(repaired.torque_error(held))
    data = result("ident.judgement/1", body, inputs=inputs, warnings=body["notes"])
    out.result(data)
    with out.together() as folder:
        if folder is not None:
            (folder / "judgement.json").write_text(json.dumps(data, indent=2) + "\n")
            if repaired is not None:
                repaired.save(folder / "fit.json")
            keep_report(folder, out, report_of(judgement))
    if repaired is not None and out.folder is not None:
        out.note(f"saved the repaired fit as {out.folder / 'fit.json'}")
    return 1 if args.strict and not judgement.possible.possible else 0


def _subject(args: argparse.Namespace) -> tuple[Estimate | None, Subject]:
    if args.fit and not args.robot and not args.table:
        estimate = Estimate.load(args.fit)
        return estimate, subject_of(estimate)
    if args.fit or not (args.robot and args.table):
        raise ConfigurationError("give either a saved fit (fit.json), or --robot NAME with --table NUMBER.")
    tables = published_tables(args.robot)
    if args.table not in tables:
        raise unknown_name(f"published table of {args.robot}", args.table, tables)
    table = tables[args.table]
    return None, published_subject(load_robot(args.robot), table.values, f"{args.robot}, table {table.id}: {table.title}")


def _by_the_source(args: argparse.Namespace, subject: Subject) -> tuple[dict[str, Any], list[str]]:
    """The dissertation's judgements that were asked for, of each inertia matrix, on a grid of positions and by cones: results, lines."""
    if args.cone and args.limits:
        raise ConfigurationError("--cone judges over full turns of every joint; leave out --limits.")
    body: dict[str, Any] = {}
    lines = []
    for name, structure in subject.matrices.items():
        if args.grid is not None:
            on_grid = judge_on_grid(structure, subject.values, points=args.grid, limits=args.limits)
            lines.append(f"{name}: {on_grid.text()}")
            body.setdefault("grid", {})[name] = on_grid.to_dict()
        if args.cone:
            by_cone = judge_by_cone(structure, subject.values, order=args.cone)
            lines.append(f"{name}: {by_cone.text()}")
            body.setdefault("cone", {})[name] = by_cone.to_dict()
    return body, lines


def _held(args: argparse.Namespace, estimate: Estimate | None) -> Signals | None:
    """Held-out logs, prepared as those of the fit were."""
    if not (args.log or args.study):
        return None
    if estimate is None:
        raise ConfigurationError("a published table has no logs; --validate and --study go with a saved fit.")
    return like(estimate.signals_config)(logs_for(args, estimate))


def _knowledge(args: argparse.Namespace, estimate: Estimate | None) -> tuple[Bounds | None, Prior | None]:
    bounds = Bounds(total_mass=(args.total_mass[0], args.total_mass[1])) if args.total_mass else None
    if args.spread is None:
        return bounds, None
    prior = None if estimate is None else nominal_prior(estimate.model.robot, spread=args.spread)[0]
    if prior is None:
        raise ConfigurationError("--spread: the robot has no nominal inertials to stay near to; leave it out.")
    return bounds, prior


def _repair(
    args: argparse.Namespace, estimate: Estimate | None, subject: Subject, held: Signals | None, bounds: Bounds | None, prior: Prior | None
) -> Repair:
    if estimate is None:
        return repair(subject.structure, subject.values, subject.covariance, args.repair, bounds=bounds, prior=prior, limits=args.limits)
    return repair_estimate(estimate, args.repair, held=held, bounds=bounds, prior=prior, limits=args.limits)
