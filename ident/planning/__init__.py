"""Step-by-step identification as a plan: tests of one or two joints at a time, from the tip to the base."""

from __future__ import annotations

from .choice import Separation
from .logs import TrackingMode
from .plan import default_model, make_plan, read_plan, simulate_plan, write_plan
from .sequence import Plan
from .trials import MotionKind, PlannedTest, Segment, Sweep, Swing

__all__ = [
    "MotionKind",
    "Plan",
    "PlannedTest",
    "Segment",
    "Separation",
    "Sweep",
    "Swing",
    "TrackingMode",
    "default_model",
    "make_plan",
    "read_plan",
    "simulate_plan",
    "write_plan",
]
