"""The four verdicts, as the set of models that nothing is left beside defines them."""

from __future__ import annotations

from enum import StrEnum


class Verdict(StrEnum):
    """What a diagnosis ends with.

    CLEAN: the declared model leaves nothing beyond chance. EXPLAINED: with the findings nothing is left, and no other effect would do in
    the place of one. AMBIGUOUS: others would do, or data held out do not show what is named. UNEXPLAINED: something is left that no effect
    of the catalogue accounts for."""

    CLEAN = "clean"
    EXPLAINED = "explained"
    AMBIGUOUS = "ambiguous"
    UNEXPLAINED = "unexplained"
