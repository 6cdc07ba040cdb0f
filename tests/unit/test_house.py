"""The house keeps its order: what import-linter cannot see of it."""

from __future__ import annotations

import ast
import re
import tomllib
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SOURCE = ROOT / "ident"
ALONE = {"errors.py", "model.py", "cli.py", "__init__.py", "__main__.py"}

#: Imports of our own modules inside functions, each with its reason.
LAZY = {
    ("robots/robot.py", "ident.model"): "`robot.rigid_body()`, where everybody looks for it: a convenience above its layer",
    ("regressor/kernel_choice.py", "ident.regressor"): "the compiled kernel may not be built",
    ("commands/check.py", "ident.commands.diagnose"): "a check loads the diagnosis only when it is strict",
}


def modules() -> Iterator[tuple[Path, ast.Module]]:
    for path in sorted(SOURCE.rglob("*.py")):
        yield path, ast.parse(path.read_text())


def target(path: Path, node: ast.ImportFrom) -> str:
    if not node.level:
        return node.module or ""
    parts = ["ident", *path.relative_to(SOURCE).parts[:-1]]
    parts = parts[: len(parts) - node.level + 1]
    return ".".join([*parts, *([node.module] if node.module else [])])


def test_no_module_stands_outside_a_package() -> None:
    assert {p.name for p in SOURCE.glob("*.py")} <= ALONE


def test_our_own_modules_are_imported_at_the_top() -> None:
    found = set()
    for path, tree in modules():
        for function in ast.walk(tree):
            if isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef):
                for node in ast.walk(function):
                    if isinstance(node, ast.ImportFrom) and target(path, node).split(".")[0] == "ident":
                        found.add((str(path.relative_to(SOURCE)), target(path, node)))
    assert len(LAZY) <= 10
    assert found == set(LAZY)


def test_no_private_name_crosses_a_package() -> None:
    found = []
    for path, tree in modules():
        own = path.relative_to(SOURCE).parts[0]
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom):
                where = target(path, node).split(".")
                if where[0] == "ident" and where[1:2] not in ([own], ["_native"]):
                    found += [f"{path}: {a.name}" for a in node.names if re.match(r"_[a-z]", a.name, re.IGNORECASE) and a.name != "_native"]
    assert not found


def test_no_class_name_stands_twice() -> None:
    where = defaultdict(list)
    for path, tree in modules():
        for node in tree.body:
            if isinstance(node, ast.ClassDef):
                where[node.name].append(str(path.relative_to(SOURCE)))
    assert not {name: files for name, files in where.items() if len(files) > 1}


def test_no_function_is_longer_than_a_screen() -> None:
    """60 lines in all. The sections of an entry point (parameters, returns, raises, an example) are its manual, and do not count;
    what stands around them, signature included, has 45 lines."""
    long = []
    for path, tree in modules():
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                text = ast.get_docstring(node, clean=False) or ""
                manual = "----" in text
                first = node.body[0]
                documented = (first.end_lineno or first.lineno) - first.lineno + 1 if manual else 0
                lines = (node.end_lineno or node.lineno) - node.lineno + 1 - documented
                if lines > (45 if manual else 60):
                    long.append(f"{path.relative_to(SOURCE)}: {node.name} has {lines} lines")
    assert not long


def test_no_module_is_longer_than_a_few_screens() -> None:
    lines = {path.relative_to(SOURCE): len(path.read_text().splitlines()) for path, _ in modules()}
    assert not {str(path): count for path, count in lines.items() if count > 350 and path.parts[0] != "diagnosis"}


@pytest.fixture(scope="module")
def layers() -> list[str]:
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    (contract,) = [c for c in contracts if c["type"] == "layers"]
    return list(reversed(contract["layers"]))


def test_the_layers_name_every_package(layers: list[str]) -> None:
    packages = {p.parent.name for p in SOURCE.glob("*/__init__.py")} | {"errors", "model", "cli"}
    named = [name.strip() for layer in layers for name in layer.split("|")]
    assert set(named) == packages
    assert len(named) == len(packages)


def test_the_architecture_page_names_every_package_in_the_order_of_the_layers(layers: list[str]) -> None:
    text = (ROOT / "docs/architecture.md").read_text()
    table = re.findall(r"^\| `([\w.]+?)/?(?:\.py)?` \|", text, re.MULTILINE)
    assert table == [name.strip() for layer in layers for name in layer.split("|")]


def test_no_citation_of_what_is_not_in_the_repository() -> None:
    cited = re.compile(r"\b(SCIENCE|DESIGN|HOUSE)\b")
    found = [
        f"{path.relative_to(ROOT)}: {match.group(0)}"
        for folder in ("ident", "docs", "benchmarks")
        for path in sorted((ROOT / folder).rglob("*"))
        if path.suffix in (".py", ".md", ".cpp", ".h", ".toml")
        for match in cited.finditer(path.read_text())
    ]
    assert not found
