"""What makes a row or a frequency one that counts: thresholds, with where they come from."""

from __future__ import annotations

#: Share of a motor's usual top speed below which its friction is no function of the motion (three widths of the smoothed sign).
SLOW = 0.012
#: Seconds around such samples that a closed loop needs to settle.
SETTLE = 0.04
#: Seconds at both ends of a run that filters reach into.
ENDS = 0.1
#: Share of the acceleration's power that disturbances may drive where the motion still serves as instrument.
DISTURBED = 0.03
#: Share of the rows that a motor needs unmasked to be looked at.
FEW = 0.03
#: Standard deviations by which a value may miss a physical bound, and beyond which the direction of a speed is known.
BOUND = 3.0
