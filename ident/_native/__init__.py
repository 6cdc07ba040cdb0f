"""The compiled kernels: C++ sources and, where it was built, the extension module `_kernel`.

In a checkout that was not built, the kernels of an installed `ident` are taken, if they were built from the very same sources."""

from __future__ import annotations

import site
import sysconfig
from collections.abc import Iterator
from pathlib import Path

_HERE = Path(__file__).resolve().parent
_SOURCES = ("*.cpp", "*.h")


def _built(folder: Path) -> bool:
    """Extension modules lie in a folder."""
    return any(folder.glob("_kernel.*.so")) or any(folder.glob("_kernel*.pyd"))


def _same_sources(folder: Path) -> bool:
    """A folder holds the same C++ sources as this one."""
    mine = {p.name: p.read_bytes() for pattern in _SOURCES for p in _HERE.glob(pattern)}
    theirs = {p.name: p.read_bytes() for pattern in _SOURCES for p in folder.glob(pattern)}
    return bool(mine) and mine == theirs


def _installed() -> Iterator[Path]:
    """Where an installed `ident` keeps its kernels."""
    paths = [sysconfig.get_path("platlib"), sysconfig.get_path("purelib"), *site.getsitepackages(), site.getusersitepackages()]
    for path in dict.fromkeys(paths):
        folder = Path(path) / "ident" / "_native"
        if folder.resolve() != _HERE and folder.is_dir():
            yield folder


if not _built(_HERE):
    __path__ += [str(folder) for folder in _installed() if _built(folder) and _same_sources(folder)]
