"""Many inputs of one class, each from a seed of its own, so that one alone can be made again."""

from __future__ import annotations

import importlib
import os
import pickle
import signal
import time
import traceback
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from .kinds import Kind
from .mutations import of
from .outcomes import HANG_S, WAITS, Count, Outcome, tried

#: Inputs for which one process is made, and seconds without an end of any after which it is taken to hang where no signal reaches it.
_BATCH, _STUCK = 250, 2 * WAITS * HANG_S
#: What those processes would else load each for itself.
_LOADED = ("scipy.signal", "scipy.io", "scipy.linalg", "scipy.stats", "scipy.optimize", "pandas", "pyarrow.csv", "pyarrow.parquet", "h5py",
           "lxml.etree", "pinocchio", "yourdfpy", "rosbags.highlevel")  # fmt: skip


def made(kind: Kind, seed: int) -> tuple[str, bytes]:
    """The input of a seed: name of the file and bytes."""
    rng = np.random.default_rng([seed, len(kind.name), *kind.name.encode()])
    sources: Any = kind.sources()
    name = str(of(rng, sorted(sources)))
    return name, kind.change(rng, name, sources[name])


def fuzz(kind: Kind, folder: Path, seed: int, count: int | None, until: float | None = None, progress: Path | None = None) -> Count:
    """`count` inputs from `seed` on, or as many as there is time for. `progress`: a file that tells which seed is tried."""
    found = Count(kind.name)
    while (count is None or found.total < count) and (until is None or time.monotonic() < until):
        if progress is not None:
            progress.write_text(str(seed))
        name, data = made(kind, seed)
        path = folder / name
        path.write_bytes(data)
        found.add(tried(kind.use, path), data, seed, name)
        seed += 1
    return found


def fuzz_apart(kind: Kind, folder: Path, seed: int, count: int | None, until: float | None = None) -> Count:
    """The same in processes of their own: one that dies, or hangs where no signal is heard, is a fault of the input it had."""
    kind.sources()  # made once, before there are several
    for module in _LOADED:
        with suppress(ImportError):
            importlib.import_module(module)
    found = Count(kind.name)
    while (count is None or found.total < count) and (until is None or time.monotonic() < until):
        wanted = _BATCH if count is None else min(_BATCH, count - found.total)
        part, fatal = _child(kind, folder, seed, wanted, until)
        if fatal is not None:
            at, outcome = fatal
            if at > seed:
                part, again = _child(kind, folder, seed, at - seed, None)
                assert again is None, again
                found.join(part)
            name, data = made(kind, at)
            found.add(outcome, data, at, name)
            seed = at + 1
            continue
        found.join(part)
        seed += wanted
    return found


def _child(kind: Kind, folder: Path, seed: int, count: int, until: float | None) -> tuple[Count, tuple[int, Outcome] | None]:
    """What a process of its own counts, or the seed with which it ended and how."""
    progress, result = folder / "progress", folder / "result"
    progress.write_text(str(seed))
    result.unlink(missing_ok=True)
    child = os.fork()
    if child == 0:
        code = 1
        try:
            inputs = folder / "inputs"
            inputs.mkdir(exist_ok=True)
            result.write_bytes(pickle.dumps(fuzz(kind, inputs, seed, count, until, progress)))
            code = 0
        except BaseException:
            traceback.print_exc()
            raise
        finally:
            os._exit(code)
    stuck = False
    while (ended := os.waitpid(child, os.WNOHANG))[0] == 0:
        if time.time() - progress.stat().st_mtime > _STUCK:
            stuck = True
            os.kill(child, signal.SIGKILL)
        time.sleep(0.02)
    if ended[1] == 0 and result.exists():
        return pickle.loads(result.read_bytes()), None
    at = int(progress.read_text())
    how = f"ended by signal {os.WTERMSIG(ended[1])}" if os.WIFSIGNALED(ended[1]) else f"ended with {ended[1] >> 8}"
    return Count(kind.name), (at, Outcome("hang", "native", f"more than {_STUCK} s") if stuck else Outcome("crash", "native", how))
