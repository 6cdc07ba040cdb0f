"""Progress tells about how long is left, once enough is done to tell."""

from __future__ import annotations

import pytest

from ident.commands.common import time_left


@pytest.mark.parametrize(
    ("passed", "share", "said"),
    [
        (10.0, 0.5, ", about 10 s left"),
        (30.0, 0.25, ", about 90 s left"),
        (600.0, 0.25, ", about 30 min left"),
        (1.0, 0.5, ""),
        (60.0, 0.01, ""),
        (60.0, 1.0, ""),
    ],
)
def test_what_is_left(passed: float, share: float, said: str) -> None:
    assert time_left(passed, share) == said
