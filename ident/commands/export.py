"""`ident export`: a saved fit as URDF (patched in place), MJCF or JSON."""

from __future__ import annotations

import argparse
from pathlib import Path

from .._utils.json import result
from ..estimate.estimate import Estimate
from ..exporting.export import export
from .common import Output, add_output_arguments


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("fit", help="saved fit (fit.json)")
    parser.add_argument("target", help="file to write; the suffix says the format (.urdf, .xml or .mjcf, .json)")
    parser.add_argument("--urdf", help="URDF to patch; by default the one that was fitted")
    parser.add_argument("--allow-inconsistent", action="store_true", help="write links that are no real bodies, too")
    add_output_arguments(parser)


def run(args: argparse.Namespace) -> int:
    out = Output(args)
    estimate = Estimate.load(args.fit)
    written = export(estimate, Path(args.target), urdf=args.urdf, allow_inconsistent=args.allow_inconsistent, force=args.force)
    out.say(written.text())
    out.result(result("ident.export/1", written.to_dict(), inputs=estimate.inputs, warnings=written.notes), "export")
    return 0
