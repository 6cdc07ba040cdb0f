"""Builds the documentation's site: `pip install -e '.[docs]' && python docs/tools/make_site.py [FOLDER]`; warnings are errors.

The pages are copied beside those that are made: the reference, from the classes, and the pages of the repository that stand elsewhere.
No code is run here; `docs/tools/run_pages.py` does that and keeps in the pages what it prints."""

from __future__ import annotations

import argparse
import re
import shutil
import sys
import tempfile
from pathlib import Path

DOCS = Path(__file__).resolve().parents[1]
ROOT = DOCS.parent
sys.path[:0] = [str(ROOT), str(DOCS / "tools")]

from make_reference import reference_pages  # noqa: E402

#: Pages of the repository that stand outside `docs`, by their names in the site.
ELSEWHERE = {"benchmarks": "benchmarks/README.md", "changelog": "CHANGELOG.md", "contributing": "CONTRIBUTING.md"}
LINK = re.compile(r"\]\(([^)#\s]+)((?:#[^)]*)?)\)")


def sources(folder: Path) -> None:
    """All that the site is made of, in `folder`."""
    shutil.copytree(DOCS, folder, ignore=shutil.ignore_patterns("__pycache__"), dirs_exist_ok=True)
    for page in folder.rglob("*.md"):
        at = DOCS / page.relative_to(folder)
        page.write_text(with_links(at.read_text(encoding="utf-8"), at), encoding="utf-8")
    for name, path in ELSEWHERE.items():
        (folder / f"{name}.md").write_text(with_links((ROOT / path).read_text(encoding="utf-8"), ROOT / path), encoding="utf-8")
    (folder / "reference").mkdir(parents=True, exist_ok=True)
    for name, text in reference_pages().items():
        (folder / "reference" / f"{name}.md").write_text(text, encoding="utf-8")


def with_links(text: str, page: Path) -> str:
    """The text of a page whose links lead to pages of the site; a link to what is no page becomes the name of it."""
    moved = {ROOT / path: name for name, path in ELSEWHERE.items()}

    def changed(match: re.Match[str]) -> str:
        target, anchor = match.groups()
        if "://" in target:
            return match.group(0)
        where = (page.parent / target).resolve()
        if where in moved:
            return f"](/{moved[where]}.md{anchor})"
        if where.is_relative_to(DOCS):
            return f"](/{where.relative_to(DOCS).as_posix()}{anchor})" if where.exists() else match.group(0)
        return f"](https://example.invalid/{where.relative_to(ROOT).as_posix()})"

    text = LINK.sub(changed, text)
    return re.sub(r"\[([^\]]*)\]\(https://example\.invalid/([^)]*)\)", lambda m: f"{m.group(1)} (`{m.group(2)}`)", text)


def build(folder: Path, *, quiet: bool = True) -> int:
    """Build the site into `folder`; the exit code of Sphinx, warnings being errors."""
    from sphinx.cmd.build import build_main

    with tempfile.TemporaryDirectory() as scratch:
        source = Path(scratch) / "source"
        sources(source)
        options = ["-b", "html", "-W", "--keep-going", *(["-q"] if quiet else []), "-d", str(Path(scratch) / "trees")]
        return int(build_main([*options, str(source), str(folder)]))


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.split(":")[0])
    parser.add_argument("folder", nargs="?", type=Path, default=ROOT / "build" / "site", help="where to (default: %(default)s)")
    args = parser.parse_args()
    code = build(args.folder)
    print(f"{sum(1 for _ in args.folder.rglob('*.html'))} pages in {args.folder}" if code == 0 else "the site has warnings: see above")
    return code


if __name__ == "__main__":
    sys.exit(main())
