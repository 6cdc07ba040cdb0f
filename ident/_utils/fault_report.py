"""What is sent when `ident` itself is at fault: what happened, and the files that make it happen again, in one archive."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from .version import __version__

#: Bytes of files that are put in; further ones are named only.
_MOST = 50_000_000
#: Bytes of a description in which names of further files are looked for.
_DESCRIPTION = 1 << 20
_QUOTED = re.compile(r"""["']([^"'\n]{1,400})["']""")


def fault_report(given: Sequence[str], error: Exception) -> tuple[Path | None, str]:
    """An archive with `report.txt`, the files that a command line names, and those that its study names; None where none can be written.

    Beside it the report as text."""
    import platform
    import tempfile
    import traceback
    import zipfile

    files = list(dict.fromkeys(_files(given)))
    kept: list[Path] = []
    left: list[Path] = []
    size = 0
    for path in files:
        size += path.stat().st_size
        (kept if size <= _MOST else left).append(path)
    text = "\n".join(
        [
            f"ident {__version__}, Python {platform.python_version()}, {platform.platform()}",
            f"command: ident {' '.join(map(repr, given))}",
            *(f"file {i}: {path}" for i, path in enumerate(kept)),
            *(f"too large to be here: {path}" for path in left),
            "".join(traceback.format_exception(error)),
        ]
    )
    try:
        with (
            tempfile.NamedTemporaryFile(prefix="ident-fault-", suffix=".zip", delete=False) as target,
            zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive,
        ):
            archive.writestr("report.txt", text)
            for i, path in enumerate(kept):
                archive.write(path, f"files/{i}/{path.name}")
    except (OSError, ValueError):  # a full disk; a file that dates from before 1980
        return None, text
    return Path(target.name), text


def _files(given: Sequence[str]) -> Iterator[Path]:
    """Files that arguments name, and those that are named in a study or another description among them."""
    for argument in given:
        path = Path(argument)
        if not _is_file(path):
            continue
        yield path
        if path.suffix.lower() == ".toml" and path.stat().st_size <= _DESCRIPTION:
            for name in _QUOTED.findall(path.read_text(errors="replace")):
                if _is_file(named := path.parent / name):
                    yield named


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False
