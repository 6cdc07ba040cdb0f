"""The pages say what the code says: every finding, status, method and effect has its entry, and no entry is of nothing."""

from __future__ import annotations

import ast
import importlib.util
import re
from pathlib import Path

import pytest

from ident.diagnosis.verdict import Verdict
from ident.effects.registry import effect_types
from ident.estimate.status import StatusCode
from ident.estimators import estimator_types

ROOT = Path(__file__).parents[2]
PAGES = sorted([*ROOT.glob("docs/**/*.md"), ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "benchmarks/README.md"])


def audit_codes() -> set[str]:
    """Every code that a finding of the audit can have, read from the source."""
    found = set()
    for path in (ROOT / "ident/auditing").glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in ("add", "AuditFinding") and node.args:
                first = node.args[0]
                if isinstance(first, ast.Constant):
                    found.add(first.value)
    return found


def headings(page: str, level: str) -> list[str]:
    return re.findall(rf"^{level} `([^`]+)`$", (ROOT / "docs" / page).read_text(encoding="utf-8"), re.MULTILINE)


def test_codes_are_found_in_the_source() -> None:
    assert {"jitter", "unit", "torque_missing", "too_short", "no_motion"} <= audit_codes()
    assert len(audit_codes()) > 30


def test_every_finding_status_and_verdict_has_its_entry() -> None:
    entries = headings("troubleshooting.md", "###")
    wanted = audit_codes() | {code.value for code in StatusCode} | {verdict.value for verdict in Verdict} | {"0", "1", "2", "3", "70"}
    assert len(entries) == len(set(entries))
    assert set(entries) == wanted


def test_every_warning_has_cause_and_remedy() -> None:
    text = (ROOT / "docs/troubleshooting.md").read_text(encoding="utf-8")
    for code, body in re.findall(r"^### `(\w+)`\n(.*?)(?=^##)", text, re.MULTILINE | re.DOTALL):
        if code in audit_codes():
            assert "Remedy" in body or "remedy" in body or "othing to do" in body, code


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_links_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8")):
        made = page.name == "index.md" and target.startswith("reference/")  # by docs/tools/make_reference.py, for the site alone
        if not made and not target.startswith(("http://", "https://")):
            assert (page.parent / target).exists(), target


def test_every_method_is_weighed() -> None:
    text = (ROOT / "docs/which-method.md").read_text(encoding="utf-8")
    assert not [name for name in estimator_types() if f"`{name}`" not in text]


def numbers(line: str) -> list[str]:
    return re.findall(r"(?<![\w.])\d+(?:\.\d+)?(?:e[+-]?\d+)?(?![\w.])", line)


def test_numbers_are_those_of_the_benchmark() -> None:
    """Each cell of the table against the tables that the benchmark printed."""
    printed = (ROOT / "benchmarks/README.md").read_text(encoding="utf-8")
    table = re.findall(r"^\| (.+?) \| `.*?\| ?(.*) \|$", (ROOT / "docs/which-method.md").read_text(encoding="utf-8"), re.MULTILINE)
    known = [(name, cells) for name, cells in table if re.search(rf"^{re.escape(name)} ", printed, re.MULTILINE)]
    rows = {name: [c.strip() for c in cells.split("|")] for name, cells in known}
    assert len(rows) == 12
    for name, (quick, slow, closed, coverage, torque, seconds) in rows.items():
        own = [numbers(line.removeprefix(name)) for line in printed.splitlines() if re.match(rf"{re.escape(name)}  ", line)]
        errors = [line[-1] for line in own if len(line) == 7]
        assert quick == errors[0], name
        assert coverage == errors[1], name
        assert [x for x in (slow, closed) if x] == [e for e in errors[2:] if e in (slow, closed)][: bool(slow) + bool(closed)], name
        predicted = next(line for line in own if line not in (own[0], own[1]) and line[0] == torque)
        assert predicted[-1] == seconds, name


def gallery_page() -> str:
    spec = importlib.util.spec_from_file_location("make_gallery", ROOT / "docs/make_gallery.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.gallery()


def shares(page: str) -> list[float]:
    return [float(x) for x in re.findall(r"model takes up (\d+) %", page)]


def test_the_gallery_is_made_from_the_classes() -> None:
    pytest.importorskip("matplotlib")
    page, made = (ROOT / "docs/gallery.md").read_text(encoding="utf-8"), gallery_page()

    def fixed(text: str) -> str:
        return re.sub(r"^- the usual model.*$", "", text, flags=re.MULTILINE)

    assert fixed(page) == fixed(made), "write it again: python docs/make_gallery.py"
    assert shares(page) == pytest.approx(shares(made), abs=1.0)
    usual = {"rigid_body", "rotor_inertia", "viscous", "coulomb"}
    entries = headings("gallery.md", "##")
    causes = {name for name, kind in effect_types().items() if kind.cause and kind.__module__.startswith("ident.")}
    assert set(entries) | usual >= causes
    assert {p.stem for p in (ROOT / "docs/gallery").iterdir()} == set(entries)


@pytest.mark.parametrize("page", ["README.md", "docs/excitation.md"])
def test_python_of_a_page_runs(page: str, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("matplotlib").use("Agg")
    plt = pytest.importorskip("matplotlib.pyplot")
    (code,) = re.findall(r"```python\n(import ident\n.*?)```", (ROOT / page).read_text(encoding="utf-8"), re.DOTALL)
    names: dict[str, object] = {}
    exec(compile(code, page, "exec"), names)
    assert "ident" in names
    plt.close("all")


def test_flags_of_the_page_on_safe_motions_exist() -> None:
    from ident.cli import build_parser

    told = set(re.findall(r"`(--[a-z-]+)", (ROOT / "docs/excitation.md").read_text(encoding="utf-8")))
    for action in build_parser("excite")._subparsers._group_actions[0].choices["excite"]._actions:
        told -= set(action.option_strings)
    assert not told
