"""The effect contract, and what a joint, drive, sensor or load can do beside friction; one module for each family.

>>> import ident
>>> model = ident.load_robot("scara").rigid_body() + ident.effects.LinearSpring(joints=("joint2",))
>>> [effect.name for effect in model.effects]
['rigid_body', 'linear_spring']
"""

from __future__ import annotations

from ..robots.parameters import Parameter, ShapeParameter
from .base import Effect
from .compliance import Backlash, JointElasticity
from .drift import OffsetDrift, OffsetStep
from .encoders import EncoderEccentricity, EncoderOffset, EncoderScale
from .geometry import GearCoupling, LinkLength
from .gravity import BaseTilt, GravityMagnitude
from .joint_effect import JointEffect
from .kinds import Axis, Factor, Nature, Need
from .load import ExternalForce, Payload, PayloadStep
from .motion import Coordinates, Motion
from .offset import Offset
from .periodic import Cogging, TorqueRipple
from .registry import effect_names, effect_types, make_effect, register
from .rigid_body import RigidBody
from .springs import Counterbalance, LinearSpring, NonlinearSpring
from .sums import EffectSum
from .timing import Delay, FilterLag
from .torque_reading import Saturation, TorqueConstant, TorqueNonlinearity

__all__ = [
    "Axis",
    "Backlash",
    "BaseTilt",
    "Cogging",
    "Coordinates",
    "Counterbalance",
    "Delay",
    "Effect",
    "EffectSum",
    "EncoderEccentricity",
    "EncoderOffset",
    "EncoderScale",
    "ExternalForce",
    "Factor",
    "FilterLag",
    "GearCoupling",
    "GravityMagnitude",
    "JointEffect",
    "JointElasticity",
    "LinearSpring",
    "LinkLength",
    "Motion",
    "Nature",
    "Need",
    "NonlinearSpring",
    "Offset",
    "OffsetDrift",
    "OffsetStep",
    "Parameter",
    "Payload",
    "PayloadStep",
    "RigidBody",
    "Saturation",
    "ShapeParameter",
    "TorqueConstant",
    "TorqueNonlinearity",
    "TorqueRipple",
    "effect_names",
    "effect_types",
    "make_effect",
    "register",
]
