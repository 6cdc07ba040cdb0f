"""Messages, help texts and pages use the terms of the field, and none of the words that stood for them once."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = sorted([*ROOT.glob("docs/**/*.md"), ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "benchmarks/README.md"])

#: Instead of these, say what stands behind them.
INSTEAD = {
    r"\b(?:can(?:not)? be|be|is|are|were|was) told (?:apart )?from\b|\btold apart\b": "estimated, distinguishable, distinguished",
    r"\bforetells?\b|\bforetold\b|\bforetelling\b": "predicts",
    r"\bborne out\b|\btaken back\b|\bwithdrawn\b": "confirmed, rejected, retracted on held-out data",
    r"\brivals?\b|(?<!`)\bimitators?\b(?!`)|\bstand-ins?\b": "alternative explanation, competing model",
    r"\bwhat is left\b(?! out)": "residual, lack of fit",
    r"\bnegative light\b|\bis light\b": "negative apparent inertia",
    r"\bturning rows\b|\brows near turning\b": "velocity reversals",
    r"\bcarried by the filter\b": "filter memory",
    r"(?<!`)\bknocks\b(?!`)": "impacts",
    r"\bhidden: |\bhidden effect\b": "minimum detectable effect",
    r"\bsteady estimat": "robust",
    r"\bthe floor\b(?! of)": "noise floor",
    r"\bin plain sight\b": "data quality, distribution shift",
    r"\bone row a sample\b|\bone number a joint\b|\bone value a joint\b|\bone a joint\b": "one row per sample, one value per joint",
    r"\bno such thing has that sign\b": "physically impossible sign",
    r"\bborder of possible sets\b": "distance to the feasibility boundary",
    r"\bwhat is made small\b": "cost function",
    r"\bas of a joint that sticks\b": "stiction",
}


def said(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """Every text of a module that is neither a docstring nor a name (of a field, a key of a file)."""
    documentation = {
        id(node.body[0].value)
        for node in ast.walk(tree)
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and node.body and isinstance(node.body[0], ast.Expr)
    }
    for node in ast.walk(tree):
        if (
            isinstance(node, ast.Constant)
            and isinstance(node.value, str)
            and id(node) not in documentation
            and not node.value.isidentifier()
        ):
            yield node.lineno, node.value


def found(text: str) -> list[str]:
    return [
        f"{m.group(0)!r}: say {say}" for pattern, say in INSTEAD.items() for m in re.finditer(pattern, text, re.IGNORECASE | re.MULTILINE)
    ]


def test_messages_and_help() -> None:
    wrong = []
    for path in sorted((ROOT / "ident").rglob("*.py")):
        for line, text in said(ast.parse(path.read_text(encoding="utf-8"))):
            wrong += [f"{path.relative_to(ROOT)}:{line}: {w}" for w in found(text)]
    assert not wrong


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_pages(page: Path) -> None:
    assert not found(page.read_text(encoding="utf-8"))


def test_entries_of_the_changelog_are_short() -> None:
    """At most 25 words; what is code counts as one."""
    entries = re.findall(r"^- (.+)$", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert len(entries) > 100
    assert not [entry for entry in entries if len(re.sub(r"`[^`]*`", "x", entry).split()) > 25]


@pytest.mark.parametrize("text", ["3 standard deviations inside the border of possible sets", "a rival of it", "hidden: delay on joint1"])
def test_old_words_are_found(text: str) -> None:
    assert found(text)
