"""The drive side of the effect contract: rotor inertia and friction."""

from .asymmetric import AsymmetricCoulomb, AsymmetricViscous
from .drive import Coulomb, RotorInertia, Viscous
from .load import LoadDependentFriction
from .position import JointSideFriction, PositionDependentFriction
from .presliding import Presliding
from .speed import NonlinearViscous, Stribeck
from .temperature import TemperatureDriftCoulomb, TemperatureDriftViscous

__all__ = [
    "AsymmetricCoulomb",
    "AsymmetricViscous",
    "Coulomb",
    "JointSideFriction",
    "LoadDependentFriction",
    "NonlinearViscous",
    "PositionDependentFriction",
    "Presliding",
    "RotorInertia",
    "Stribeck",
    "TemperatureDriftCoulomb",
    "TemperatureDriftViscous",
    "Viscous",
]
