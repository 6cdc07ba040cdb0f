"""Forward simulation: rigid body, forces with dry friction, integration with events, controllers, actuators and sensors."""

from __future__ import annotations

from .actuators import Actuator, CurrentLoop, Gain, TorqueLimit
from .command import Feedback
from .controller import CascadedPPI, ComputedTorque, Controller, PDFeedforward
from .exceeded import ExceededLimit, exceeded_limits
from .flexible import FlexibleJoints
from .plant import Plant, Schedule
from .result import Simulation
from .sensors import (
    Distortion,
    EncoderError,
    Jitter,
    Lag,
    MeasurementDelay,
    PositionNoise,
    Quantisation,
    Sensors,
    TorqueNoise,
    TorqueScale,
    TorqueWindow,
)
from .simulate import Hold, simulate, simulate_batch
from .trajectory import BSplineTrajectory, Chained, Dwell, FourierTrajectory, PointToPoint, Trajectory, Trapezoid

__all__ = [
    "Actuator",
    "BSplineTrajectory",
    "CascadedPPI",
    "Chained",
    "ComputedTorque",
    "Controller",
    "CurrentLoop",
    "Distortion",
    "Dwell",
    "EncoderError",
    "ExceededLimit",
    "Feedback",
    "FlexibleJoints",
    "FourierTrajectory",
    "Gain",
    "Hold",
    "Jitter",
    "Lag",
    "MeasurementDelay",
    "PDFeedforward",
    "Plant",
    "PointToPoint",
    "PositionNoise",
    "Quantisation",
    "Schedule",
    "Sensors",
    "Simulation",
    "TorqueLimit",
    "TorqueNoise",
    "TorqueScale",
    "TorqueWindow",
    "Trajectory",
    "Trapezoid",
    "exceeded_limits",
    "simulate",
    "simulate_batch",
]
