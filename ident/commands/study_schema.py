"""`ident study-schema`: the JSON schema of study files, for editors and checkers."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from .._utils.files import write_atomic
from ..study.schema import study_schema


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("-o", "--output", metavar="FILE", help="file to write (default: standard output)")
    parser.add_argument("--force", action="store_true", help="overwrite an existing file")


def run(args: argparse.Namespace) -> int:
    text = json.dumps(study_schema(), indent=2, ensure_ascii=False) + "\n"
    if args.output is None:
        sys.stdout.write(text)
    else:
        write_atomic(Path(args.output), text, force=args.force)
    return 0
