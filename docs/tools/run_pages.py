"""Runs the code of the documentation's pages, and writes below each piece what it prints: `python docs/tools/run_pages.py [PAGE …]`.

What runs, page by page, in one empty folder and with one set of names:

- a block `toml` or `python` whose first line is `# file: NAME` becomes that file;
- any other block `python` is run; what it prints stands in the block `output` that follows;
- a block `console`: every line that begins with `$ ident` is run, with `| head -N` or `| tail -N` where only a part is shown.

Pictures that the code saves in the folder `pictures` are those that the page shows. A page with `<!-- slow -->` in it is checked only where
slow checks are asked for. `--check` changes nothing and ends with 1 where a page shows something else than its code prints."""

from __future__ import annotations

import argparse
import contextlib
import io
import os
import re
import shlex
import sys
import tempfile
import time
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

DOCS = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(DOCS.parent))

FENCE = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
FILE = re.compile(r"# file: (\S+)\n")
NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?", re.IGNORECASE)
SLOW = "<!-- slow -->"
#: Numbers may differ by this share between machines before a page has to be written again; and what is this small is nothing.
RELATIVE, ABSOLUTE = 0.1, 1e-6


def pages() -> list[Path]:
    """The pages whose code is run here; the others are run by tests of their own (tests/docs/test_pages.py names them)."""
    return sorted([DOCS / "start.md", DOCS / "live.md", *DOCS.glob("tutorials/*.md"), *DOCS.glob("howto/*.md"), *DOCS.glob("theory/*.md")])


def robot_data() -> list[Path]:
    """The logs with and without a load that come with the package."""
    from ident.robots import robot_folder

    return [robot_folder("puma560") / f"demo/{name}.csv.gz" for name in ("unloaded", "loaded")]


def is_slow(page: Path) -> bool:
    """Whether a page is checked only where slow checks are asked for."""
    return SLOW in page.read_text(encoding="utf-8")


@contextlib.contextmanager
def inside(folder: Path) -> Iterator[None]:
    """The working folder meanwhile."""
    before = Path.cwd()
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)


def run_command(line: str) -> str:
    """What a command line of ours prints on standard output; RuntimeError where it fails."""
    from ident.cli import main

    command, *parts = (part.strip() for part in line.split(" | "))
    out, err = io.StringIO(), io.StringIO()
    shown = warnings.showwarning
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main(shlex.split(command)[1:])
    warnings.showwarning = shown
    if code:
        raise RuntimeError(f"{command}: exit code {code}\n{err.getvalue()}")
    lines = out.getvalue().splitlines()
    for part in parts:
        what, _, count = part.partition(" -")
        lines = lines[: int(count)] if what == "head" else lines[-int(count) :]
    return "".join(f"{text.rstrip()}\n" for text in lines)


def run_console(body: str) -> str:
    """A console block with what its commands print; commands of others stand as they are."""
    new = []
    for line in (line for line in body.splitlines() if line.startswith("$ ")):
        new.append(f"{line}\n")
        if line.startswith("$ ident "):
            new.append(run_command(line.removeprefix("$ ")))
    return "".join(new)


def run_python(code: str, names: dict[str, Any], where: str) -> str:
    """What a piece of Python prints."""
    out = io.StringIO()
    with contextlib.redirect_stdout(out), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        exec(compile(code, where, "exec"), names)
    return "".join(f"{line.rstrip()}\n" for line in out.getvalue().splitlines())


def made_of(page: Path, folder: Path) -> str:
    """The page with what its code prints, run in `folder`. Raises what the code raises, with page and block."""
    text = page.read_text(encoding="utf-8")
    names: dict[str, Any] = {"__name__": "__main__"}
    made, at = [], 0
    blocks = list(FENCE.finditer(text))
    (folder / "pictures").mkdir(exist_ok=True)
    for data in (*DOCS.glob("data/*"), *robot_data()):
        (folder / data.name).write_bytes(data.read_bytes())
    with inside(folder):
        for number, block in enumerate(blocks, 1):
            kind, body = block.group(1), block.group(2)
            made.append(text[at : block.start()])
            at = block.end()
            where = f"{page.relative_to(DOCS).as_posix()}, block {number}"
            try:
                if kind == "output":
                    made[-1] = made[-1].rstrip("\n")  # written anew with the code above it
                elif (file := FILE.match(body)) is not None:
                    Path(file.group(1)).write_text(body[file.end() :], encoding="utf-8")
                    made.append(block.group(0))
                elif kind == "python":
                    printed = run_python(body, names, where)
                    made.append(block.group(0) + (f"\n\n```output\n{printed}```" if printed else ""))
                elif kind == "console":
                    made.append(f"```console\n{run_console(body)}```")
                else:
                    made.append(block.group(0))
            except Exception as error:
                raise RuntimeError(f"{where}: {error!r}") from error
    made.append(text[at:])
    return "".join(made)


def differences(shown: str, printed: str) -> list[str]:
    """Lines of a page that are not what its code prints: other words, or numbers that differ by more than a tenth."""
    old, new = shown.splitlines(), printed.splitlines()
    found = [f"shown: {a}\nprinted: {b}" for a, b in zip(old, new, strict=False) if not same_line(a, b)]
    return found + [f"{len(old)} lines shown, {len(new)} printed"] * (len(old) != len(new))


def same_line(shown: str, printed: str) -> bool:
    """Whether two lines have the same words and, within the tolerance, the same numbers."""
    # NumPy gives a sign the blank behind a bracket, that of a zero too.
    words, others = (NUMBER.sub("#", line).replace("[", "[ ").split() for line in (shown, printed))
    if words != others:
        return False
    pairs = zip(map(float, NUMBER.findall(shown)), map(float, NUMBER.findall(printed)), strict=True)
    return all(abs(a - b) <= ABSOLUTE + RELATIVE * max(abs(a), abs(b)) for a, b in pairs)


def keep_pictures(page: Path, folder: Path, *, every: bool) -> list[str]:
    """Pictures that the page shows: those that are missing, or every one, are copied. Returns those that the code does not make."""
    shown = re.findall(r"\]\((?:\.\./)?(pictures/[^)]+)\)", page.read_text(encoding="utf-8"))
    for name in shown:
        if (folder / name).exists() and (every or not (DOCS / name).exists()):
            (DOCS / name).write_bytes(small((folder / name).read_bytes()))
    return [name for name in shown if not (folder / name).exists()]


def small(png: bytes) -> bytes:
    """The same picture with few colours, which takes a third of the room."""
    from PIL import Image

    file = io.BytesIO()
    Image.open(io.BytesIO(png)).convert("RGB").quantize(32).save(file, "PNG", optimize=True)
    return file.getvalue()


def main() -> int:
    """Write the pages anew, or check them."""
    parser = argparse.ArgumentParser(description=__doc__.split(":")[0])
    parser.add_argument("page", nargs="*", type=Path)
    parser.add_argument("--check", action="store_true", help="change nothing; exit with 1 where a page shows something else")
    parser.add_argument("--slow", action="store_true", help="slow pages too")
    parser.add_argument("--pictures", action="store_true", help="write all pictures anew, not only those that are missing")
    args = parser.parse_args()
    import matplotlib.pyplot as plt

    plt.switch_backend("Agg")
    status = 0
    chosen = [p.resolve() for p in args.page] or [p for p in pages() if args.slow or not is_slow(p)]
    for page in chosen:
        started = time.perf_counter()
        with tempfile.TemporaryDirectory() as scratch:
            made = made_of(page, Path(scratch))
            found = differences(page.read_text(encoding="utf-8"), made)
            if not args.check and found:
                page.write_text(made, encoding="utf-8")
            missing = keep_pictures(page, Path(scratch), every=args.pictures)
        plt.close("all")
        status |= bool(missing) | (args.check and bool(found))
        told = [*(f"  {name} is not made by the page's code" for name in missing), *(found if args.check else ())]
        print(f"{page.relative_to(DOCS)}: {time.perf_counter() - started:.1f} s, {len(found)} lines changed", *told, sep="\n")
    return status


if __name__ == "__main__":
    sys.exit(main())
