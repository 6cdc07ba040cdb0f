"""The documentation's site: built without a warning where its generator is installed, and complete."""

from __future__ import annotations

import html
import re
from pathlib import Path

import pytest
from test_run_pages import ROOT, tool

import ident
from ident.commands import COMMANDS
from ident.effects.registry import effect_types
from ident.estimators import estimator_types

TUTORIALS = ("puma", "ur5", "missing_effect", "payload", "step_by_step", "servo", "consistency", "ten_million")
LINK = re.compile(r'(?:href|src)="([^"#?:]+)(?:[#?][^"]*)?"')
HOW_TO = ("filters", "friction", "essential", "report", "simulators", "monitoring")


@pytest.fixture(scope="module")
def reference() -> dict[str, str]:
    return tool("make_reference").reference_pages()


@pytest.mark.parametrize("name", [*(f"tutorials/{t}" for t in TUTORIALS), *(f"howto/{h}" for h in HOW_TO), "start"])
def test_a_page_is_there_and_in_the_contents(name: str) -> None:
    assert (ROOT / f"docs/{name}.md").exists()
    assert re.search(rf"^{name}$", (ROOT / "docs/index.md").read_text(encoding="utf-8"), re.MULTILINE)


def test_the_reference_names_every_command_flag_effect_method_and_name(reference: dict[str, str]) -> None:
    assert set(re.findall(r"^## `ident ([\w-]+)`", reference["command-line"], re.MULTILINE)) == set(COMMANDS)
    assert "`--sharpen`" in reference["command-line"]
    own = {n for n, c in effect_types().items() if c.__module__.startswith("ident.")}
    assert set(re.findall(r"^## `(\w+)`", reference["effects"], re.MULTILINE)) == own
    known = {n for n, c in estimator_types().items() if c.__module__.startswith("ident.")}
    assert set(re.findall(r"^## `(\w+)`", reference["methods"], re.MULTILINE)) == known
    for name, cls in estimator_types().items():
        for field in cls.__dataclass_fields__.values():
            if name in known and field.name in cls.__annotations__ and not str(field.type).startswith("ClassVar"):
                assert f"| `{field.name}` |" in reference["methods"]
    public = {n for n in ident.__all__ if n != "__version__" and not hasattr(getattr(ident, n), "__path__")}
    assert set(re.findall(r"^## `(\w+)`", reference["python"], re.MULTILINE)) == public
    tables = set(re.findall(r"^## `\[(\w+)\]`", reference["study-keys"], re.MULTILINE))
    assert tables == {"plugins", "robot", "drive", "loop", "logs", "signals", "estimator", "columns"}
    assert "`torque_constants`" in reference["study-keys"]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    for module in ("sphinx", "myst_parser", "furo", "latex2mathml"):
        pytest.importorskip(module, reason="the documentation's generator is not installed: pip install -e '.[docs]'")
    folder = tmp_path_factory.mktemp("site")
    assert tool("make_site").build(folder) == 0, "warnings: python docs/tools/make_site.py shows them"
    return folder


def test_the_site_is_built_without_a_warning_and_its_links_lead_somewhere(site: Path) -> None:
    pages = {p.relative_to(site).as_posix(): p.read_text(encoding="utf-8") for p in site.rglob("*.html")}
    assert {"index.html", "start.html", "gallery.html", "troubleshooting.html", "reference/python.html"} <= set(pages)
    links = [(name, html.unescape(t)) for name, text in pages.items() for t in LINK.findall(text)]
    assert not [(name, target) for name, target in links if not (site / name).parent.joinpath(target).exists()]
    assert "<math" in pages["theory/drive_train.html"]
    assert "https://cdn" not in "".join(pages.values())  # readable without a network
