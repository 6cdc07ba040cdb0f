"""`ident export`: a saved fit as URDF (patched in place), MJCF, MJCF with actuators, or JSON."""

from __future__ import annotations

import argparse
from pathlib import Path

from .._utils.json import result
from .._utils.structured import read_json
from ..drives import DriveFit
from ..drives.result import is_drive_fit
from ..errors import ConfigurationError
from ..estimate.estimate import Estimate
from ..exporting.actuators import FORMAT, export_actuators
from ..exporting.export import export
from .common import Output, add_output_arguments


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("fit", help="saved fit (fit.json)")
    parser.add_argument("target", help="file to write; the suffix says the format (.urdf, .xml or .mjcf, .json)")
    parser.add_argument(
        "--to",
        choices=("urdf", "mjcf", "json", FORMAT),
        help="format, where the suffix does not say it (mujoco_actuator: a fit with [drive] law)",
    )
    parser.add_argument("--urdf", help="URDF to patch; by default the one that was fitted")
    parser.add_argument("--allow-inconsistent", action="store_true", help="write links that are no real bodies, too")
    add_output_arguments(parser)


def run(args: argparse.Namespace) -> int:
    out = Output(args)
    target, found = Path(args.target), read_json(Path(args.fit), "fit")
    if is_drive_fit(found) or args.to == FORMAT:
        if args.to not in (None, FORMAT):
            raise ConfigurationError(f"fit {args.fit} is one under a drive law; it is exported as {FORMAT} only, so far.")
        fit = DriveFit.load(args.fit)
        written, inputs = export_actuators(fit, target, force=args.force), fit.inputs
    else:
        estimate = Estimate.load(args.fit)
        kind = {"kind": args.to, "urdf": args.urdf, "allow_inconsistent": args.allow_inconsistent, "force": args.force}
        written, inputs = export(estimate, target, **kind), estimate.inputs
    out.say(written.text())
    out.result(result("ident.export/1", written.to_dict(), inputs=inputs, warnings=written.notes), "export")
    return 0
