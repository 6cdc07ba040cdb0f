"""What is left: structure that the model with all its findings still does not explain, joint by joint."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from .acceptance import COMPANION, LARGE, Found
from .evidence import FALSE_ALARM, WEAK, acts_on
from .irregular import irregular
from .signatures import signatures, tones
from .stage import Stage

if TYPE_CHECKING:
    from .frame import Score

Array = np.ndarray
#: Tones that are tried at a time.
_TONES = (1, 3)
#: Independent frequencies among which a tone is the strongest.
_TRIED = 500.0


@dataclass(frozen=True, eq=False)
class Leftover:
    """Structure on one joint, which counts where a further finding would. `signature` says against what it shows, `evidence` its
    held-out gain, `share` of what the findings there explain (inf without any), `rms` of it over the noise's."""

    joint: int
    signature: str
    evidence: float
    standard_error: float
    share: float
    rms: float

    @property
    def weight(self) -> float:
        """From 1 on, something is left that counts."""
        return max(self.share / COMPANION, self.rms / LARGE)

    @property
    def counts(self) -> bool:
        """Whether it is too much for the model to be called whole."""
        return self.weight >= 1.0 and self.evidence >= WEAK

    def text(self, joint_name: str) -> str:
        """For people."""
        return (
            f"{joint_name}: the residual follows {self.signature}: {self.rms:.2g} times the noise (rms),"
            f" held-out gain {self.evidence:.0f} ± {self.standard_error:.0f}"
        )


def leftovers(stage: Stage, found: tuple[Found, ...]) -> list[Leftover]:
    """Significant structure beside a stage's model, the strongest signature of each joint, the strongest joint first."""
    from scipy.stats import chi2

    n = stage.problem.model.robot.n
    families = signatures(stage.motions)
    for j in range(n):
        residual = np.asarray(stage.white.back(stage.frame.residual[j], j))
        found_tones = (tones(stage.motions, residual, j, count) for count in _TONES)
        families += [tone for tone in found_tones if tone is not None]
    best: dict[int, Leftover] = {}
    explained = np.zeros(n)
    for f in found:
        explained += acts_on(f.judged) * f.judged.evidence
    for family in families:
        Z = stage.frame.whitened(family.placed(n))
        k = Z.shape[2]
        # Each tone is the strongest of many.
        trials = _TRIED ** (k // 2) if family.name.startswith("time-periodic") else 1.0
        least = float(chi2.isf(FALSE_ALARM / (len(families) * trials), k))
        if stage.frame.fit_gain(Z) < least:
            continue
        score = stage.frame.score(Z)
        evidence = min(score.heldout, score.fit_gain)
        if score.fit_gain < least or evidence < least - k or score.heldout < 1.5 * score.standard_error:
            continue
        share = evidence / explained[family.joint] if explained[family.joint] > 0 else np.inf
        rows = max(1, int(stage.problem.signals.valid[:, family.joint].sum()))
        new = Leftover(family.joint, family.name, evidence, score.standard_error, float(share), _rms(score, rows))
        if family.joint not in best or per_parameter(new, k) > per_parameter(best[family.joint], k):
            best[family.joint] = new
    for j in range(n):
        # A quantity that it hardly follows says less than that it comes in bursts.
        if (j not in best or best[j].evidence < WEAK) and (more := irregular(stage, j)) is not None:
            share = more.evidence / explained[j] if explained[j] > 0 else np.inf
            best[j] = Leftover(j, more.name, more.evidence, more.standard_error, float(share), more.rms)
    return sorted(best.values(), key=lambda x: -x.evidence)


def per_parameter(leftover: Leftover, k: int) -> float:
    """Evidence less what its parameters would gain by chance."""
    return leftover.evidence - 2.0 * k


def _rms(score: Score, rows: int) -> float:
    return float(np.sqrt(max(score.fit_gain, 0.0) / rows))
