"""Many inputs of one class, each from a seed of its own, so that one alone can be made again."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np

from .kinds import Kind
from .mutations import of
from .outcomes import Count, tried


def made(kind: Kind, seed: int) -> tuple[str, bytes]:
    """The input of a seed: name of the file and bytes."""
    rng = np.random.default_rng([seed, len(kind.name), *kind.name.encode()])
    sources: Any = kind.sources()
    name = str(of(rng, sorted(sources)))
    return name, kind.change(rng, name, sources[name])


def fuzz(kind: Kind, folder: Path, seed: int, count: int | None, until: float | None = None) -> Count:
    """`count` inputs from `seed` on, or as many as there is time for."""
    found = Count(kind.name)
    while (count is None or found.total < count) and (until is None or time.monotonic() < until):
        name, data = made(kind, seed)
        path = folder / name
        path.write_bytes(data)
        found.add(tried(kind.use, path), data, seed)
        seed += 1
    return found
