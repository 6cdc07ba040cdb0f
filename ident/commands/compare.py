"""`ident compare`: two saved fits on logs that neither was fitted to, joint by joint."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .._utils.json import result
from ..errors import ConfigurationError
from ..estimate.estimate import Estimate
from ..evaluation.comparison import compare
from ..evaluation.doubts import seen_by
from ..logs.reading import read_logs
from ..signals.likewise import like
from ..study.study import Study, read_study
from .common import Output, add_log_argument, add_output_arguments, add_reading_arguments, read_as_asked

if TYPE_CHECKING:
    from ..logs.log import LogSet
    from ..robots.transmission import Transmission


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("before", help="saved fit (fit.json), e.g. of the declared model")
    parser.add_argument("after", help="saved fit, e.g. after.fit.json of `ident diagnose --out`")
    add_log_argument(parser, "held-out logs (CSV, CSV.gz, MAT, Parquet; patterns allowed)", "--validate")
    parser.add_argument(
        "--study", metavar="FILE", help="study file whose [columns] are used, and whose validation logs are read if --log is not given"
    )
    add_reading_arguments(parser)
    parser.add_argument(
        "--strict", action="store_true", help="exit with 1 unless the second fit predicts better by more than its standard error"
    )
    add_output_arguments(parser)


def run(args: argparse.Namespace) -> int:
    out = Output(args)
    before, after = Estimate.load(args.before), Estimate.load(args.after)
    here, there = before.model.robot, after.model.robot
    if here.joint_names != there.joint_names:
        raise ConfigurationError(
            f"the fits are of different robots: {args.before} has the joints {', '.join(here.joint_names)};"
            f" {args.after} has {', '.join(there.joint_names)}."
        )
    if here.transmission.measured != there.transmission.measured:
        raise ConfigurationError(
            f"the fits predict torque on different sides ({here.transmission.measured.value} and {there.transmission.measured.value});"
            " fit both with the same [drive] measured."
        )
    preparation = like(after.signals_config)
    signals = preparation(logs_for(args, after))
    same = _same(here.transmission, there.transmission)
    found = compare(before, after, signals, before_signals=None if same else preparation(logs_for(args, before)))
    warnings = (
        [] if same else ["the fits have different transmissions: each is compared with the torque mapped through its own transmission."]
    )
    warnings += [text for text in dict.fromkeys(seen_by(fit.inputs, signals.inputs) for fit in (before, after)) if text]
    out.say(found)
    for warning in warnings:
        out.say(f"warning: {warning}")
    body = {"joints": list(there.joint_names), "methods": {"before": before.method, "after": after.method}, **found.to_dict()}
    out.result(result("ident.comparison/1", body, inputs=signals.inputs, warnings=warnings), "comparison")
    if args.strict and not found.gain > np.nan_to_num(found.gain_std):
        out.note(f"gate: the later fit does not predict better (gain {found.gain:.4g} ± {found.gain_std:.2g})")
        return 1
    return 0


def logs_for(args: argparse.Namespace, estimate: Estimate) -> LogSet:
    """The logs named by `--log` or by the study, as an estimate's robot reads them. Raises ConfigurationError if there are none."""
    study = read_study(Path(args.study)) if args.study else Study()
    study = read_as_asked(study, args)
    if args.log:
        study = study.with_flags(logs=args.log)
        files = study.fit_files()
    else:
        files = study.validation_files()
    if not files:
        raise ConfigurationError("no log is given; pass one with --log FILE (or --study FILE with [logs] validate).")
    return read_logs([*map(str, files)], estimate.model.robot, study.columns or None, **study.reading())


def _same(a: Transmission, b: Transmission) -> bool:
    return bool(np.array_equal(a.K, b.K) and np.array_equal(a.zero, b.zero))
