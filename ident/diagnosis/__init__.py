"""What a declared model lacks: the search over the catalogue, the verdict, and the model that has it."""

from .diagnosis import Diagnosis, diagnose
from .next_motion import NextMotion, next_motion
from .result import CompetingModel, Finding, FoundParameter, Hidden, Unexplained
from .verdict import Verdict

__all__ = [
    "CompetingModel",
    "Diagnosis",
    "Finding",
    "FoundParameter",
    "Hidden",
    "NextMotion",
    "Unexplained",
    "Verdict",
    "diagnose",
    "next_motion",
]  # fmt: skip
