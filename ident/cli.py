"""Command line of ident. Exit codes: 0 done; 1 done, but a gate failed; 2 usage or configuration; 3 the data cannot be used, or not in
this memory; 70 a fault of ours, with a report to send."""

from __future__ import annotations

import argparse
import importlib
import logging
import os
import sys
import textwrap
import traceback
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ._utils.fault_report import fault_report
from ._utils.plugins import from_plugin, load_modules
from ._utils.threads import one_blas_thread
from ._utils.version import __version__
from .commands import COMMANDS
from .commands.examples import EXAMPLES
from .commands.names import nearest_flags, take_names
from .errors import IdentError

#: Commands that know no effect, estimator or reader.
_WITHOUT_PLUGINS = ("demo", "completion")


class _Given(argparse.Action):
    """What an option stores: of a value that is given again the last, as is usual; names that are given again add to those before."""

    def __call__(
        self, parser: argparse.ArgumentParser, namespace: argparse.Namespace, values: Any, option_string: str | None = None
    ) -> None:
        seen: frozenset[str] = getattr(namespace, "options_seen", frozenset())
        again = self.dest in seen and self.nargs == "+" and self.type is None
        namespace.options_seen = seen | {self.dest}
        setattr(namespace, self.dest, [*getattr(namespace, self.dest), *values] if again else values)


def build_parser(only: str | None = None) -> argparse.ArgumentParser:
    """The parser. `only`: load the arguments of this command alone (none for a name that is no command), so that start-up stays fast."""
    parser = argparse.ArgumentParser(
        prog="ident",
        description="Identify a robot's dynamics from logs, and find what its model lacks.",
        epilog="Run ident COMMAND --help for details.",
    )
    parser.add_argument("-v", dest="verbose_steps", action="store_true", help="print each step to standard error (the Python logger ident)")
    parser.add_argument("--version", action="version", version=f"ident {__version__}")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for name, what in COMMANDS.items():
        sub = commands.add_parser(name, help=what, description=what)
        sub.register("action", None, _Given)
        if only in (None, name):
            module = importlib.import_module(f"ident.commands.{name.replace('-', '_')}")
            module.add_arguments(sub)
            if name not in _WITHOUT_PLUGINS:
                sub.add_argument(
                    "--plugin",
                    action="append",
                    metavar="FILE",
                    help="Python file with your own effects, estimators, readers or targets; repeat the flag for several (docs/extend.md)",
                )
            sub.set_defaults(run=module.run, parsers=parsers)
            sub.description, sub.formatter_class = textwrap.fill(what, 100), argparse.RawDescriptionHelpFormatter
            examples = "\n".join(("example:", *(f"  {line}" for line in EXAMPLES[name])))
            sub.epilog = examples if sub.epilog is None else f"{examples}\n\n{sub.epilog}"
    return parser


def parsers() -> dict[str, argparse.ArgumentParser]:
    """The parser of each command, with all its arguments."""
    (commands,) = (a for a in build_parser()._actions if isinstance(a, argparse._SubParsersAction))
    return dict(commands.choices)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; every error of the user's is one clear text on standard error."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    command = next((a for a in given if not a.startswith("-")), "")
    parser = build_parser(command)
    if any("\x00" in a for a in given):
        parser.error("an argument contains a NUL character, which no name may")
    args, more = parser.parse_known_args(given)
    if not take_names(args, more):
        parser.error(f"unrecognized arguments: {' '.join(more)}{nearest_flags(parsers()[args.command], more)}")
    warnings.showwarning = _show_warning
    try:
        with _told(args.verbose_steps), one_blas_thread():
            load_modules(getattr(args, "plugin", None) or (), Path.cwd(), "--plugin")
            return int(args.run(args))
    except IdentError as error:
        print(f"ident {args.command}: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        print(f"ident {args.command}: interrupted; no partial files were left behind.", file=sys.stderr)
        return 130
    except OSError as error:
        if isinstance(error, BrokenPipeError):
            # The reader of our output went away (`| head`): not an error of ours.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return 0
        what = f"{error.filename}: " if error.filename else ""
        print(f"ident {args.command}: {what}{error.strerror or error}; no partial files were left behind.", file=sys.stderr)
        return 2
    except MemoryError as error:
        what = str(error).strip().rstrip(".")
        print(
            f"ident {args.command}: there is not enough memory for these inputs{f' ({what})' if what else ''}; no partial files"
            f" were left behind. Use fewer or shorter logs, or read them in chunks (--stream).",
            file=sys.stderr,
        )
        return 3
    except Exception as error:  # noqa: BLE001 - whatever is left is a fault of ours, and is said to be one
        return _fault(args.command, given, error)


@contextmanager
def _told(wanted: bool) -> Iterator[None]:
    """Whether the log named ident is shown on standard error meanwhile."""
    if not wanted:
        yield
        return
    log, handler = logging.getLogger("ident"), logging.StreamHandler(sys.stderr)
    handler.setFormatter(logging.Formatter("%(relativeCreated)7.0f ms  %(name)s: %(message)s"))
    before = log.level
    log.addHandler(handler)
    log.setLevel(logging.INFO)
    try:
        yield
    finally:
        log.removeHandler(handler)
        log.setLevel(before)


def _fault(command: str, given: Sequence[str], error: Exception) -> int:
    """Report a fault of ours: what to send, in one file that reproduces it. Exit code 70; 2 where it arose in or below a plugin."""
    if frames := from_plugin(error):
        print("".join(traceback.format_list(frames)), end="", file=sys.stderr)
        print(
            f"ident {command}: {type(error).__name__}: {error}. It was raised in the plugin {Path(frames[0].filename).name}, or in"
            f" code that it called; docs/extend.md describes what plugins receive and return.",
            file=sys.stderr,
        )
        return 2
    archive, text = fault_report(given, error)
    if archive is None:
        print(text, file=sys.stderr)
    where = (
        "The traceback is above; please send it"
        if archive is None
        else f"The report and the command's files are in {archive}: check what is in it, and send it"
    )
    print(f"ident {command}: internal error (a bug in ident), please report it: {type(error).__name__}: {error}. {where}.", file=sys.stderr)
    return 70


def _show_warning(
    message: Warning | str, category: type[Warning], filename: str, lineno: int, file: object = None, line: str | None = None
) -> None:
    print(f"warning: {message}", file=sys.stderr)


if __name__ == "__main__":
    sys.exit(main())
