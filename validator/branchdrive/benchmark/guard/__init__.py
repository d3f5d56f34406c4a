"""Guards: when a learned selector may leave the nominal candidate. Pure numpy, evaluated from predictions alone.

`global_margin` is the paper's guard. The selection-path conformal guard is `risk_features` and `risk_fit` (learned
risk), `path` (selections from nominal to unguarded), `calibration` (which of them is taken) and `guarantee` (what
that promises). `figure` reports either, with intervals of rates by `rate`; `outcome_noise` says which differences
replays could explain.
"""
