"""Every threshold that decides, in one place, with where it comes from."""

from __future__ import annotations

#: Family-wise level of the largest score over the whole catalogue, for a model that lacks nothing.
LEVEL = 0.01
#: Share of a motor's noise (rms) below which an effect is nothing: laws, masks and grids of shapes are exact to no less.
MATERIAL = 0.05
#: Share by which dry friction varies along the travel, in each of some waves, and nothing is missing: no friction is more constant.
CONSTANT = 0.001
#: Share of the log that may not decide alone: a score counts as what is left without the stretch that speaks for it most.
STRETCH = 0.1
#: Energy of a column that is left beside the model's, below which the model absorbs it.
ABSORBED = 1e-4
#: Share of the best score that a competing model needs to be considered.
COMPETES = 0.4
#: Energy of an effect that is left beside another, below which the other contains it.
CONTAINED = 0.02
#: Times the usual noise (rms of half a second, at like speed) that the loudest twentieth of a log may have: clean logs have up to 2.9.
LOUD = 3.0
#: Effects that are accepted at most.
MOST = 5
#: Standard errors by which the whole of a finding must be missed on data held out for them to contradict it (one-sided, that level).
WORSE = 2.33
#: z of what a whole order may leave beside a better one: the critical value of a usual catalogue (5.2 to 5.5), below which it is not seen.
SEEN = 5.0
#: Times its rms on a fit's own logs that a residual may have on new ones: unchanged arms have up to 1.7 (motions differ).
LOUDER = 2.0
#: Share of an effect between what is there (1) and what is not (0).
HALF = 0.5
#: Rows for each parameter below which a change is not told from chance.
ROWS_EACH = 4
