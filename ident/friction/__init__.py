"""The drive side of the effect contract: rotor inertia and friction.

>>> import ident
>>> drive = ident.friction.RotorInertia() + ident.friction.Viscous() + ident.friction.Coulomb()
>>> len((ident.load_robot("scara").rigid_body() + drive).effects)
4
"""

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
