"""The code of the pages runs, and prints what the pages show."""

from __future__ import annotations

import importlib.util
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[2]


def tool(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, ROOT / f"docs/tools/{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    before = list(sys.path)
    spec.loader.exec_module(module)
    sys.path[:] = before
    return module


runner = tool("run_pages")
PAGES = [
    pytest.param(p, id=p.relative_to(runner.DOCS).as_posix(), marks=[pytest.mark.slow] if runner.is_slow(p) else []) for p in runner.pages()
]
#: Pages whose code other tests run, or that show files and programs of others.
ELSEWHERE = {
    "extend.md": "tests/docs/test_extend.py",
    "excitation.md": "tests/docs/test_pages.py",
    "logs.md": "tests/unit/test_recordings.py",
    "study.md": "tests/unit/test_study_file.py",
    "actuators.md": "tests/unit/test_actuator_export.py",
    "simulators.md": "tests/unit/test_actuator_export.py",
    "architecture.md": "contracts in short, which are no code",
    "index.md": "one line of installation",
    "reliability.md": "what a run of the fuzzer printed",
}


@pytest.mark.parametrize("page", PAGES)
def test_a_page_shows_what_its_code_prints(page: Path, tmp_path: Path) -> None:
    pytest.importorskip("clarabel")
    plt = pytest.importorskip("matplotlib.pyplot")
    if 'load_robot("ur5")' in page.read_text(encoding="utf-8"):
        pytest.importorskip("cmeel")
    plt.switch_backend("Agg")
    text = page.read_text(encoding="utf-8")
    made = runner.made_of(page, tmp_path)
    plt.close("all")
    again = f"write it again: python docs/tools/run_pages.py {page.relative_to(ROOT)}"
    assert not runner.differences(text, made), again
    for name in re.findall(r"\]\((?:\.\./)?(pictures/[^)]+)\)", text):
        assert (tmp_path / name).exists(), f"no code of the page makes {name}"
        assert (ROOT / "docs" / name).exists(), again


def test_every_page_with_code_is_run_somewhere() -> None:
    run = {p.relative_to(runner.DOCS).as_posix() for p in runner.pages()}
    with_code = {
        p.relative_to(runner.DOCS).as_posix()
        for p in runner.DOCS.rglob("*.md")
        if re.search(r"^```(?!\{)\w*$", p.read_text(encoding="utf-8"), re.MULTILINE)
    }
    assert with_code - run == set(ELSEWHERE)
    assert not [test for test in ELSEWHERE.values() if test.startswith("tests/") and not (ROOT / test).exists()]


def test_a_page_that_shows_something_else_is_found(tmp_path: Path) -> None:
    page = runner.DOCS / "no.md"
    shown = "```python\nprint(2 * 21.0, 'N m')\n```\n\n```output\n{}\n```\n"

    class Page(type(page)):
        def read_text(self, encoding: str | None = None, errors: str | None = None, newline: str | None = None) -> str:
            return shown.format("42.0 N m")

    made = runner.made_of(Page(page), tmp_path)
    assert made == shown.format("42.0 N m")
    assert not runner.differences(shown.format("42.3 N m"), made)
    assert runner.differences(shown.format("48.0 N m"), made)
    assert runner.differences(shown.format("42.0 kg"), made)
    assert runner.differences(shown.format("42.0 N m\nmore"), made)


@pytest.mark.parametrize("code", ["1 / 0", "import nosuch"])
def test_code_that_fails_is_named_with_its_page(code: str, tmp_path: Path) -> None:
    class Page(type(runner.DOCS)):
        def read_text(self, encoding: str | None = None, errors: str | None = None, newline: str | None = None) -> str:
            return f"```python\n{code}\n```\n"

    with pytest.raises(RuntimeError, match=r"no\.md, block 1"):
        runner.made_of(Page(runner.DOCS / "no.md"), tmp_path)


def test_a_command_that_fails_is_named(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError, match="exit code 2"):
        runner.run_command("ident fit --robot nosuch --log no.csv")


def test_the_readme_shows_what_the_demo_prints() -> None:
    """Every line of its first block, in order; numbers to two per cent and the last digit shown."""
    done = subprocess.run([sys.executable, "-m", "ident", "demo"], cwd=ROOT, capture_output=True, text=True, check=True)
    told = (ROOT / "README.md").read_text(encoding="utf-8").split("Part of what `ident demo` prints")[1]
    printed = [line.split() for line in done.stdout.splitlines()]
    for line in told.split("```text\n")[1].split("\n```")[0].replace("…\n", "").splitlines():
        assert any(_alike(words, line.split()) for words in printed), line


def _alike(printed: list[str], shown: list[str]) -> bool:
    if len(printed) != len(shown):
        return False
    for a, b in zip(printed, shown, strict=True):
        try:
            if abs(float(a) - float(b)) > 0.01 + 0.02 * abs(float(b)):
                return False
        except ValueError:
            if a != b:
                return False
    return True
