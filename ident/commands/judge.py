"""`ident judge`: is an estimate physically possible, is it consistent? And the least repair where it is not."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

import numpy as np

from ..errors import ConfigurationError, unknown_name
from ..estimate import Estimate
from ..results import result
from .common import Output, add_output_arguments

if TYPE_CHECKING:
    from ..physical import Repair, Subject

HELP = "judge whether an estimate is physically possible and consistent; repair it"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("fit", nargs="?", help="saved fit (fit.json)")
    parser.add_argument("--robot", help="built-in robot whose published parameters are judged")
    parser.add_argument("--table", metavar="NUMBER", help="which of its published tables")
    parser.add_argument("--limits", action="store_true", help="only within the joint limits")
    parser.add_argument("--repair", metavar="METHOD", help="repair it too: fit (constrained fit), consistent, possible or stepwise")
    parser.add_argument("--strict", action="store_true", help="exit with 1 if the set is not possible")
    add_output_arguments(parser)


def run(args: argparse.Namespace) -> int:
    from ..physical import judge

    out = Output(args)
    estimate, subject = _subject(args)
    judgement = judge(subject, limits=args.limits)
    out.say(judgement.text())
    body = judgement.to_dict()
    if args.repair:
        repaired = _repair(args, estimate, subject)
        out.say()
        out.say(repaired.text())
        body["repair"] = repaired.to_dict()
    inputs = estimate.inputs if estimate is not None else ()
    out.result(result("ident.judgement/1", body, inputs=inputs, warnings=body["notes"]), "judgement")
    return 1 if args.strict and not judgement.possible.possible else 0


def _subject(args: argparse.Namespace) -> tuple[Estimate | None, Subject]:
    from ..physical import published_subject, subject_of
    from ..robots import load_robot, published_tables

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


def _repair(args: argparse.Namespace, estimate: Estimate | None, subject: Subject) -> Repair:
    from ..physical import repair

    triangle, data = None, None
    if estimate is not None and estimate.information is not None and len(estimate.values) == estimate.information.k:
        R, z, _ = estimate.information.combined(np.asarray(estimate.weights))
        triangle, data = (R, z), {"fitted": estimate.information}
    return repair(
        subject.structure,
        subject.values,
        subject.covariance,
        args.repair,
        unseen=subject.unseen,
        triangle=triangle,
        limits=args.limits,
        data=data,
    )
