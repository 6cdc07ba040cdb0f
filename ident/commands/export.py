"""`ident export`: a saved fit as a file for simulators and other programs; the formats are the targets of `ident.exporting`."""

from __future__ import annotations

import argparse
from pathlib import Path

from .._utils.json import result
from ..exporting.export import export
from ..exporting.target import target_types
from ..logs.reading import read_logs
from .common import Output, add_output_arguments
from .saved_fit import saved_fit


def add_arguments(parser: argparse.ArgumentParser) -> None:
    known = target_types()
    parser.add_argument("fit", help="saved fit (fit.json), from measured torque or under a drive law")
    parser.add_argument("target", help="file to write; its suffix selects the format (.urdf, .xml, .mjcf, .json, .usda, .c)")
    parser.add_argument(
        "--to",
        metavar="TARGET",
        help="format, if the suffix does not determine it: " + "; ".join(f"{name}: {kind.title}" for name, kind in known.items()),
    )
    parser.add_argument("--urdf", help="URDF to patch (default: the one that was fitted)")
    parser.add_argument("--allow-inconsistent", action="store_true", help="also write links that are not physically consistent")
    parser.add_argument(
        "--log", nargs="+", metavar="FILE", help="logs of the motion on which the errors of what the format leaves out are computed"
    )
    parser.add_argument("--supply", type=float, metavar="V", help="supply voltage for which the gains of a pwm law are written")
    parser.add_argument("--units", nargs="+", metavar="FIT", help="ranges: saved fits of further units of the same robot")
    parser.add_argument("--samples", type=int, default=500, help="ranges: sets of parameters to draw (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="ranges: seed of the draw")
    add_output_arguments(parser)


def run(args: argparse.Namespace) -> int:
    out = Output(args)
    fit = saved_fit(args.fit)
    logs = None if args.log is None else read_logs(args.log, fit.model.robot)
    written = export(
        fit,
        Path(args.target),
        kind=args.to,
        urdf=args.urdf,
        allow_inconsistent=args.allow_inconsistent,
        logs=logs,
        units=[saved_fit(unit) for unit in args.units or ()],
        samples=args.samples,
        seed=args.seed,
        supply=args.supply,
        force=args.force,
    )
    out.say(written.text())
    out.result(result("ident.export/1", written.to_dict(), inputs=fit.inputs, warnings=written.notes), "export")
    return 0
