"""Least squares against instruments: which parameters differ by more than chance, as feedback makes them do."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from .._utils.short_repr import ShortRepr
from .._utils.singular_values import pinv
from .._utils.text import wrapped
from .._utils.threads import with_one_blas_thread
from ..drawing.document import uncertain
from ..drawing.shown import Shown
from ..errors import ConfigurationError, UnsupportedError
from ..estimators import BandInstruments
from ..estimators.band_instruments import BandFit
from ..instruments.prepared import Instrument

if TYPE_CHECKING:
    import pandas as pd

    from ..estimate.estimate import Estimate

Array = np.ndarray
#: Methods whose estimate is a sum over rows with one weight for each joint.
_PLAIN = ("ls", "wls")
#: Probability that anything is said to be moved where nothing is, over all parameters.
_LEVEL = 0.01
#: Share of a value to which derivatives by filters are exact (a log without noise: `tests/contract/test_estimator_contract.py`).
_EXACT = 3e-3
#: Blocks of time in which both estimates' errors are compared, and seconds that each has at least: longer than errors remember.
_BLOCKS, _SHORTEST_S = 40, 0.5
#: So many parameters are printed, the most moved first.
_LISTED = 8


@dataclass(frozen=True, eq=False, repr=False)
class AgainstInstruments(Shown, ShortRepr):
    """What least squares and instruments differ by.

    `estimate`: by least squares; `instrumental`: the same model by instruments (method `iv_band`), an estimate like any other;
    `moved` (b,): least squares less instruments, with its standard deviation `moved_std` (b,) by chance, from `blocks` of time.

    See `ident.against_instruments`.

    Examples
    --------
    >>> import ident
    >>> ident.AgainstInstruments.__name__
    'AgainstInstruments'
    """

    estimate: Estimate
    instrumental: Estimate
    moved: Array
    moved_std: Array
    blocks: int

    @property
    def significant(self) -> tuple[str, ...]:
        """Parameters that differ by more than chance, and by more than a standard deviation of the estimate; the most moved first."""
        from scipy.special import stdtrit

        critical = float(-stdtrit(self.blocks - 1, _LEVEL / (2 * max(1, len(self.moved)))))
        share = np.abs(self.moved) / self.estimate.std
        found = np.flatnonzero((np.abs(self.moved) > critical * self.moved_std) & (share > 1.0))
        return tuple(self.estimate.names[i] for i in found[np.argsort(-share[found])])

    @property
    def instrument(self) -> str:
        """What the instrument is, in words."""
        trace = self.instrumental.trace
        return Instrument(trace["instrument"], trace["band_hz"], trace["narrower_hz"]).motion

    def warning(self) -> str:
        """A sentence for an estimate's warnings; "" where nothing is moved."""
        names = self.significant
        if not names:
            return ""
        share = dict(zip(self.estimate.names, (self.moved / self.estimate.std).tolist(), strict=True))
        listed = ", ".join(f"{n} by {share[n]:+.1f} std" for n in names[:_LISTED]) + (" …" if len(names) > _LISTED else "")
        return (
            f"instruments give other values than least squares ({listed}): feedback, noise of the positions, or an effect"
            " that the model lacks, which both weigh differently (ident diagnose; where it finds nothing, use method iv_band)."
        )

    def __str__(self) -> str:
        names = self.significant
        if not names:
            return wrapped(f"by instruments ({self.instrument}) no parameter differs by more than chance and its std")
        frame = self.to_frame().set_index("name").loc[list(names[:_LISTED])]
        width = max(map(len, frame.index))
        lines = [
            f"  {name:<{width}}  {uncertain(row.value, row['std'])} → {uncertain(row.by_instruments, row.by_instruments_std)}"
            f"  ({row.moved / row['std']:+.1f} std)"
            for name, row in frame.iterrows()
        ]
        more = [f"  … and {len(names) - _LISTED} more"] if len(names) > _LISTED else []
        head = wrapped(
            f"instruments ({self.instrument}) give other values than least squares: feedback, noise of the positions, or an effect that the"
            " model lacks, which both weigh differently (ident diagnose); where it finds nothing, use --method iv_band:"
        )
        return "\n".join([head, *lines, *more])

    def to_frame(self) -> pd.DataFrame:
        """One row for each parameter: by least squares, by instruments, and what it is moved by."""
        import pandas as pd

        names, other = self.estimate.names, self.instrumental
        place = [other.names.index(name) for name in names]
        return pd.DataFrame(
            {
                "name": names,
                "value": self.estimate.values,
                "std": self.estimate.std,
                "by_instruments": other.values[place],
                "by_instruments_std": other.std[place],
                "moved": self.moved,
                "moved_std": self.moved_std,
                "significant": [n in self.significant for n in names],
            }
        )

    def to_dict(self) -> dict[str, Any]:
        """JSON form."""
        trace = self.instrumental.trace
        told = {key: trace[key] for key in ("instrument", "band_hz", "narrower_hz")}
        return {**told, "parameters": self.to_frame().to_dict("records")}


@with_one_blas_thread
def against_instruments(estimate: Estimate) -> AgainstInstruments:
    """Compare a least-squares estimate with one by instruments, which feedback cannot bias.

    Where the model is complete, both differ by chance alone unless feedback or noise of the positions biases least squares. Where it lacks
    something, they weigh that differently, and neither is right: `ident.diagnose` finds it.

    Parameters
    ----------
    estimate : Estimate
        From `ident.fit`, within the session that made it (a saved one has no signals).

    Returns
    -------
    AgainstInstruments
        What each parameter is moved by, and the estimate by instruments.

    Raises
    ------
    ConfigurationError
        A saved estimate without signals.
    UnsupportedError
        A method that is not least squares, or signals whose logs are not at hand.
    DataError
        Logs too short, or instruments that do not determine the parameters.

    References
    ----------
    J. Hausman, "Specification tests in econometrics", Econometrica 46(6), 1978. A. Janot, P.-O. Vandanjon and M. Gautier, "A generic
    instrumental variable approach for industrial robot identification", IEEE Transactions on Control Systems Technology 22(1), 2014.

    Examples
    --------
    >>> import ident
    >>> train, _ = ident.demo_logs()
    >>> bias = ident.against_instruments(ident.fit(train, "puma560", held=0))
    >>> len(bias.moved) == len(bias.estimate.values)
    True
    """
    if estimate.problem is None:
        raise ConfigurationError(
            "a saved estimate does not contain the signals it was fitted to: fit again, and compare within that session."
        )
    if estimate.method not in _PLAIN:
        raise UnsupportedError(f"method {estimate.method!r} is not plain least squares; compare an estimate by 'wls' with instruments.")
    BandInstruments().check(estimate.problem)
    found = BandFit.of(estimate.problem)
    instrumental = found.estimate(BandInstruments.name)
    if estimate.names != instrumental.names:
        raise UnsupportedError(f"method {estimate.method!r} estimates other parameters than instruments do; compare an estimate by 'wls'.")
    moved = estimate.values - instrumental.values
    std, blocks = _by_chance(estimate, found)
    return AgainstInstruments(estimate, instrumental, moved, np.hypot(std, _EXACT * np.abs(instrumental.values)), blocks)


def _by_chance(estimate: Estimate, found: BandFit) -> tuple[Array, int]:
    """Standard deviation (b,) of the difference of both estimates if neither is biased, and the blocks of time that it comes from: both are
    sums over the same time, and what a block adds to one goes with what it adds to the other."""
    t, own = _influences(estimate)
    other_t, other = found.influences()
    problem = found.problem
    seconds = sum(float(problem.row_time[run.stop - 1] - problem.row_time[run.start]) for run in problem.row_runs)
    # As many rows in each, so that days between two logs are no empty blocks.
    edges = np.quantile(t, np.linspace(0.0, 1.0, int(np.clip(seconds / _SHORTEST_S, 2, _BLOCKS)) + 1)[1:-1])
    sums = np.zeros((len(edges) + 1, own.shape[1]))
    np.add.at(sums, np.searchsorted(edges, t, side="right"), own)
    np.subtract.at(sums, np.searchsorted(edges, other_t, side="right"), other)
    kept = sums[np.any(sums != 0.0, axis=1)]
    count = len(kept)
    return np.sqrt(np.sum((kept - kept.mean(axis=0)) ** 2, axis=0) * count / max(1, count - 1)), count


def _influences(estimate: Estimate) -> tuple[Array, Array]:
    """Time (M,) of each row of a least-squares estimate, and what its error adds to the estimate (M, b)."""
    problem = estimate.problem
    assert problem is not None
    if estimate.reversals_left_out:
        problem = replace(problem, signals=problem.signals.without_reversals(x.joint for x in estimate.reversals_left_out))
    columns = np.concatenate([np.where(rows.valid[:, :, None], rows.columns, 0.0) for rows in problem.rows()])
    chosen = [problem.base.names.index(name) for name in estimate.names]
    columns = columns[:, :, chosen]
    full = np.zeros(problem.base.count)
    full[chosen] = estimate.values
    error = np.nan_to_num(problem.residual(full)) * estimate.weights
    scores = np.matmul(error[:, None], columns)[:, 0]
    gram = np.einsum("mnb,n,mnc->bc", columns, estimate.weights, columns, optimize=True)
    return problem.row_time, scores @ pinv(gram, hermitian=True)
