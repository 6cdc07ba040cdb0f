"""`ident fit`: base parameters and drive parameters with their uncertainty, and the error on data held out."""

from __future__ import annotations

import argparse
import textwrap
from dataclasses import replace

from .._utils.json import jsonable
from .._utils.text import wrapped
from ..effects.registry import effect_names
from ..errors import ConfigurationError, DataError, UnsupportedError
from ..estimate.estimate import Estimate
from ..estimate.status import StatusCode
from ..estimators import estimator_types
from ..evaluation import AgainstInstruments, Essential, against_instruments, essential
from ..evaluation.doubts import all_turned
from ..streaming.session import StreamedSession
from ..study.session import Session
from .commanded import asks_for_simulation
from .commanded_fit import fit_under_law
from .common import Output, add_output_arguments, add_study_arguments, not_negative, say_split, study_from
from .streaming import add_streaming_arguments, session_from

#: Samples beyond which least squares are not compared with instruments unasked.
_LONG = 100_000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_study_arguments(parser)
    add_output_arguments(parser)
    add_streaming_arguments(parser)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = f"methods (--method, or [estimator] method in a study file):\n{_methods()}\n\neffects: {_effects()}"
    parser.add_argument(
        "--max-error", type=not_negative, metavar="SHARE", help="exit with 1 if the relative held-out error over all joints exceeds this"
    )
    parser.add_argument(
        "--essential",
        action="store_true",
        help="also fit the essential model: without parameters that are statistically zero, unless the held-out error grows",
    )


def run(args: argparse.Namespace) -> int:
    out = Output(args)
    study = study_from(args)
    if asks_for_simulation(study):
        if args.essential:
            raise UnsupportedError("--essential needs logs with torque, not a drive law ([drive] law).")
        return fit_under_law(study, args, out)
    with session_from(args, study, out, "fitting") as session:
        return _fitted(session, args, out)


def _fitted(session: Session, args: argparse.Namespace, out: Output) -> int:
    # First, so that it is read even where the data cannot be used.
    for finding in session.audit.warnings:
        out.say(wrapped(f"audit: {finding}"))
    estimate = session.estimate
    if first := all_turned(estimate) if isinstance(session, StreamedSession) else session.turned:
        out.say(wrapped(f"warning: {first}"))
    for note in session.robot.notes:
        out.say(wrapped(f"note: {note}"))
    out.say(estimate.summary())
    if session.held_by_split and estimate.heldout_error is not None:
        say_split(out)
    # What the audit warns of goes with the result, wherever that is read.
    findings = [str(finding) for finding in session.audit.warnings]
    news = [f"audit: {finding}" for finding in findings if not any(warning in finding for warning in estimate.warnings)]
    estimate = replace(estimate, warnings=(*news, *estimate.warnings))
    bias = None if isinstance(session, StreamedSession) else _against_instruments(estimate, out)
    if bias is not None and (moved := bias.warning()):
        estimate = replace(estimate, warnings=(*estimate.warnings, moved))
    smaller = _essential(session, estimate, out) if args.essential else None
    if out.json:
        parts = {"essential": smaller, "instruments": bias}
        out.result(estimate.to_dict() | {k: jsonable(x.to_dict()) for k, x in parts.items() if x is not None})
    with out.together() as folder:
        if folder is not None:
            estimate.save(folder / "fit.json")
            out.keep("fit.txt", "\n".join([estimate.summary(), *([] if bias is None else ["", str(bias)])]) + "\n")
            if smaller is not None:
                smaller.reduced.save(folder / "essential.fit.json")
                out.keep("essential.txt", f"{smaller}\n")
    if out.folder is not None:
        out.note(f"saved {out.folder / 'fit.json'}")
    if args.max_error is not None:
        if estimate.heldout_error is None:
            out.note("gate: --max-error needs an error on held-out data, and there is none (see the warning)")
            return 1
        heldout = estimate.heldout_error.relative_all
        if not heldout <= args.max_error:
            out.note(f"gate: relative held-out error {heldout:.4g} exceeds {args.max_error:g}")
            return 1
    return 1 if estimate.status.code == StatusCode.NOT_CONVERGED else 0


def _against_instruments(estimate: Estimate, out: Output) -> AgainstInstruments | None:
    """Least squares against instruments, printed; None where that cannot be, or would take longer than the fit is worth."""
    rows = 0 if estimate.problem is None else len(estimate.problem.signals.t)
    if rows > _LONG:
        out.note(f"least squares were not compared with instruments: {rows} samples; --method iv_band does")
        return None
    try:
        bias = against_instruments(estimate)
    except (ConfigurationError, DataError, UnsupportedError):
        return None
    out.say(f"\n{bias}")
    return bias


def _essential(session: Session, estimate: Estimate, out: Output) -> Essential:
    """The essential model, printed; kept by held-out data where there are any (a warning of the fit says where there are none)."""
    try:
        held = session.held_signals
    except DataError:
        held = None
    found = essential(estimate, held)
    out.say(f"\n{found}")
    return found


def _methods() -> str:
    """One line a method: its name and the first sentence of what it says of itself."""
    kinds = estimator_types()
    width = max(map(len, kinds))
    return "\n".join(f"  {name:<{width}}  {_sentence(kind.__doc__ or '')}" for name, kind in kinds.items())


def _sentence(text: str) -> str:
    first = " ".join(text.split("\n\n", maxsplit=1)[0].split())
    return first if len(first) <= 110 else textwrap.shorten(first, 110, placeholder=" …")


def _effects() -> str:
    return textwrap.fill(", ".join(n for n in effect_names() if n != "rigid_body"), 110, subsequent_indent="  ")
