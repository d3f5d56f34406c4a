"""Guards: when a learned selector may leave the nominal candidate. Pure numpy, evaluated from predictions alone.

The paper's guard, a global margin, is in `path`. The selection-path conformal guard is `risk` (learned risk), `path`
(selections from nominal to unguarded) and `calibration` (which of them is taken, and what that promises). `assessment`
carries out either on the partitions of `data`, and `figure` reports it; `redraw` counts what they do over further
divisions of the clusters.
"""
