"""Code of the user's own: effects, estimators and log readers that register themselves when their module is imported.

An installed package names its modules under the entry point `ident.plugins`; a study file under `[plugins] modules`."""

from __future__ import annotations

import importlib
import sys
import traceback
from collections.abc import Iterable
from functools import cache
from pathlib import Path

from ..errors import ConfigurationError, IdentError

GROUP = "ident.plugins"
#: Files of the modules that were imported as plugins.
_FILES: set[str] = set()


@cache
def load_installed() -> tuple[str, ...]:
    """Import the modules of installed packages, once a process.

    Returns
    -------
    tuple of str
        Names of the entry points.

    Raises
    ------
    ConfigurationError
        A module that cannot be imported.
    """
    from importlib.metadata import entry_points  # a quarter of the time of `ident --help`

    found = []
    for point in entry_points(group=GROUP):
        try:
            point.load()
            _FILES.add(str(getattr(sys.modules.get(point.module), "__file__", "")))
        except IdentError:
            raise
        except Exception as error:
            raise ConfigurationError(_failed(f"plugin {point.name!r} ({point.value})", error)) from error
        found.append(point.name)
    return tuple(found)


def load_modules(names: Iterable[str], folder: Path, where: str) -> None:
    """Import modules by name or by file.

    Parameters
    ----------
    names : iterable of str
        A file (`laws.py`, relative to `folder`), or the name of a module that is installed or stands in `folder`.
    folder : Path
        Where files are looked for first.
    where : str
        Who asks; goes into the message of an error.

    Raises
    ------
    ConfigurationError
        A module that does not exist, or whose import fails, with the line that failed.
    """
    for name in names:
        file = folder / (name if name.endswith(".py") else f"{name.replace('.', '/')}.py")
        try:
            if file.is_file():
                _import_file(file)
            elif name.endswith(".py"):
                raise ConfigurationError(f"{where}: there is no file {file}.")
            else:
                _FILES.add(str(importlib.import_module(name).__file__))
        except IdentError:
            raise
        except ModuleNotFoundError as error:
            if error.name != name.split(".")[0]:
                raise ConfigurationError(_failed(f"{where}: module {name!r}", error)) from error
            raise ConfigurationError(f"{where}: there is no module {name!r}, neither in {folder} nor installed.") from None
        except Exception as error:
            raise ConfigurationError(_failed(f"{where}: module {name!r}", error)) from error


def _import_file(file: Path) -> None:
    """Import a file as a module of its own; once, however often it is named."""
    file = file.resolve()
    _FILES.add(str(file))
    if any(getattr(module, "__file__", None) == str(file) for module in list(sys.modules.values())):
        return
    name = f"ident_plugin_{file.stem}_{abs(hash(file)):x}"
    from importlib.util import module_from_spec, spec_from_file_location

    spec = spec_from_file_location(name, file)
    if spec is None or spec.loader is None:
        raise ConfigurationError(f"{file} cannot be imported as a module.")
    module = module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise


def from_plugin(error: Exception) -> list[traceback.FrameSummary]:
    """The calls that led to an error, from the first in code of the user's own; empty where none is involved."""
    frames = traceback.extract_tb(error.__traceback__)
    first = next((i for i, frame in enumerate(frames) if frame.filename in _FILES), len(frames))
    return list(frames[first:])


def _failed(what: str, error: Exception) -> str:
    """What failed on import, and in which line of whose file."""
    last = traceback.extract_tb(error.__traceback__)[-1]
    return f"{what} cannot be imported: {type(error).__name__}: {error} ({last.filename}, line {last.lineno})."
