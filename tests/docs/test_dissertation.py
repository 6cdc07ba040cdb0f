"""Every file, test, function and command that docs/dissertation.md and docs/theory/base_parameters.md name exists."""

from __future__ import annotations

import ast
import importlib
import re
import shlex
from pathlib import Path

import pytest

from ident.cli import build_parser
from ident.estimators import estimator_types

ROOT = Path(__file__).parents[2]
PAGES = ("docs/dissertation.md", "docs/theory/base_parameters.md")
NAMED = sorted({name for page in PAGES for name in re.findall(r"`([^`]+)`", (ROOT / page).read_text(encoding="utf-8"))})


def missing(named: str) -> str:
    """What of a reference does not exist, "" if all of it does."""
    if named.startswith("ident "):
        return missing_command(named.removeprefix("ident "))
    if named.startswith("python -m "):
        package, command = named.removeprefix("python -m ").split()[:2]
        return "" if (ROOT / package / command / "run.py").exists() else f"no benchmark {command}"
    if "/" in named:
        path, _, test = named.partition("::")
        if not (ROOT / path).exists():
            return f"no file {path}"
        if not test:
            return ""
        tree = ast.parse((ROOT / path).read_text(encoding="utf-8"))
        tests = {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}
        return "" if test in tests else f"no test {test}"
    return missing_name(named)


def missing_command(arguments: str) -> str:
    try:
        args = build_parser(arguments.split(maxsplit=1)[0]).parse_args(shlex.split(arguments))
    except SystemExit:
        return f"no command ident {arguments}"
    method = getattr(args, "method", None)
    return "" if method is None or method in estimator_types() else f"no method {method}"


def missing_name(dotted: str) -> str:
    parts = dotted.split(".")
    for cut in range(len(parts), 0, -1):
        try:
            found = importlib.import_module(".".join(parts[:cut]))
        except ModuleNotFoundError:
            continue
        for part in parts[cut:]:
            if not hasattr(found, part):
                return f"no name {part} in {'.'.join(parts[:cut])}"
            found = getattr(found, part)
        return ""
    return f"no module {parts[0]}"


@pytest.mark.parametrize("named", NAMED)
def test_a_reference_exists(named: str) -> None:
    assert not missing(named)


@pytest.mark.parametrize(
    "wrong",
    [
        "ident judge --nosuch",
        "ident nosuch",
        "ident fit --method nosuch",
        "python -m benchmarks nosuch",
        "tests/unit/test_nosuch.py",
        "tests/unit/test_plan.py::test_nosuch",
        "ident.physical.nosuch",
        "nosuch.module",
    ],
)
def test_what_does_not_exist_is_found_missing(wrong: str) -> None:
    assert missing(wrong)


def test_every_theorem_and_lemma_names_its_test() -> None:
    text = (ROOT / "docs/theory/base_parameters.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (?!theorem|lemma|equation|robot|-)(.*) \|$", text, re.MULTILINE)
    held = [row for row in rows if "::test_" in row]
    assert len(held) >= 18
    assert all("::test_" in row or "multiplications" in row or re.search(r": \d+ and \d+", row) for row in rows)


def test_every_row_says_where_or_that_it_is_not_here() -> None:
    rows = re.findall(r"^\| (?!source|claim|-)(.*) \|$", (ROOT / "docs/dissertation.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert len(rows) > 25
    assert not [row for row in rows if not re.search(r"`|not here|holds|does not hold|not comparable|not judged", row)]
