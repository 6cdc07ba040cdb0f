"""The motion of the next log: what best tells apart two models that this log does not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from .._utils.json import result
from .._utils.threads import with_one_blas_thread
from ..effects.places import on, place_of
from ..errors import ConfigurationError, UnsupportedError
from ..excitation.design import excite
from ..excitation.families import FourierFamily
from ..excitation.noise import sample_noise
from ..excitation.objective import DOptimality, chosen_parameters

if TYPE_CHECKING:
    from ..effects.base import Effect
    from ..excitation.limits import Limits
    from ..excitation.result import Excitation
    from ..excitation.surroundings import Surroundings
    from ..model import Model
    from .diagnosis import Diagnosis

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class NextMotion:
    """A motion that tells two effects apart. `distance`: between the two models after a refit of each, in standard deviations of the noise,
    if the `first` is what is there; `error_rate`: how often the wrong one of the two would then fit better."""

    first: str
    second: str
    excitation: Excitation = field(repr=False)
    distance: float

    @property
    def error_rate(self) -> float:
        from scipy.stats import norm

        return float(norm.sf(self.distance / 2.0))

    def to_dict(self) -> dict[str, Any]:
        """JSON form."""
        body = {"first": self.first, "second": self.second, "distance": self.distance, "error_rate": self.error_rate}
        return result("ident.next_motion/1", {**body, "excitation": self.excitation.to_dict()}, inputs=(), warnings=())

    def __str__(self) -> str:
        rate = f"{self.error_rate:.2g}" if self.error_rate > 1e-6 else "less than 1e-6"
        return (
            f"next motion: distinguishes {self.first} from {self.second}; expected distance {self.distance:.1f} standard deviations of"
            f" the noise, so that the wrong one would win with probability {rate}\n{self.excitation}"
        )


@with_one_blas_thread
def next_motion(
    diagnosis: Diagnosis,
    *,
    seconds: float = 20.0,
    rate: float = 200.0,
    limits: Limits | None = None,
    surroundings: Surroundings | None = None,
    starts: int = 2,
    iterations: int = 40,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> NextMotion:
    """The motion that best tells the first ambiguous finding of a diagnosis from its likeliest competitor.

    Parameters
    ----------
    diagnosis : Diagnosis
        One with a finding that has a competing effect.
    seconds, rate : float
        Length of the motion, s, and samples per second.
    limits, surroundings, starts, iterations, seed, progress
        As in `ident.excite`.

    Returns
    -------
    NextMotion
        The motion, and how surely a log of it decides.

    Raises
    ------
    ConfigurationError
        Nothing is ambiguous.
    UnsupportedError
        No motion tells the two apart.

    Examples
    --------
    >>> import ident
    >>> train, test = ident.demo_logs()
    >>> estimate = ident.fit(train, "puma560", held=0)
    >>> diagnosis = ident.diagnose(estimate)
    >>> ident.next_motion(diagnosis)
    Traceback (most recent call last):
    ...
    ident.errors.ConfigurationError: the verdict is clean: there are no two effects to tell apart.
    """
    pairs = [(x, m) for x in diagnosis.decision.named for m in x.competing if not m.renamed]
    if not pairs:
        raise ConfigurationError(f"the verdict is {diagnosis.verdict}: there are no two effects to tell apart.")
    accepted, member = pairs[0]
    own = next(e for e in diagnosis.after.model.effects if type(e) is type(accepted.effect) and e.joints == accepted.effect.joints)
    noise = sample_noise(diagnosis.after, rate)
    noise = diagnosis.noise_floor if noise is None else noise
    return separating(
        diagnosis.after.model, diagnosis.after.all_values, noise, own, member.effect, seconds=seconds,
        rate=rate, limits=limits, surroundings=surroundings, starts=starts, iterations=iterations, seed=seed, progress=progress,
    )  # fmt: skip


def separating(
    model: Model, values: Array, noise: Array, own: Effect, competing: Effect, *, seconds: float, rate: float, limits: Limits | None = None,
    surroundings: Surroundings | None = None, starts: int = 2, iterations: int = 40, seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> NextMotion:  # fmt: skip
    """The motion that tells an effect `own` of a model, with its values, from a `competing` one that is not in it.

    `noise` (n,): std of a sample's torque."""
    robot = model.robot
    other = replace(competing, label=f"{competing.label}~")
    both = model + other
    names = both.base.names
    theirs = [[p.name for p in e.parameters(robot) if p.name in names] for e in (own, other)]
    if not all(theirs):
        raise UnsupportedError(
            f"no motion distinguishes {own.name}{on(place_of(own, own.joints or ()))} from {competing.name}: they predict the same torque."
        )
    known = np.concatenate([values, np.zeros(len(other.parameters(robot)))])
    found = excite(
        both, limits=limits, values=known, noise=np.asarray(noise).tolist(), family=FourierFamily(seconds),
        measure=DOptimality(tuple(theirs[0] + theirs[1])), surroundings=surroundings, rate=rate, starts=starts, iterations=iterations,
        seed=seed, progress=progress,
    )  # fmt: skip
    at = chosen_parameters(theirs[0], names)
    base = both.base
    theta = np.array([known[base.independent[i]] for i in at])
    distance = float(np.sqrt(theta @ np.linalg.solve(found.covariance[np.ix_(at, at)], theta)))
    first, second = (f"{e.name}{on(place_of(e, e.joints or ()))}" for e in (own, competing))
    return NextMotion(first, second, found, distance)
