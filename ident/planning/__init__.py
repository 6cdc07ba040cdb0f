"""Step-by-step identification as a plan: tests of one or two joints at a time, from the tip to the base."""

from __future__ import annotations

from .choice import Separation
from .logs import Tracking
from .plan import Plan, default_model, make_plan, read_plan, simulate_plan, write_plan
from .trials import Kind, PlannedTest, Segment, Sweep, Swing

__all__ = [
    "Kind",
    "Plan",
    "PlannedTest",
    "Segment",
    "Separation",
    "Sweep",
    "Swing",
    "Tracking",
    "default_model",
    "make_plan",
    "read_plan",
    "simulate_plan",
    "write_plan",
]
