"""What must hold before any test module is imported."""

from __future__ import annotations

import os

# One BLAS thread (two make small fits erratic), read when numpy is first imported; no window for plots.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"):
    os.environ.setdefault(_variable, "1")
os.environ.setdefault("MPLBACKEND", "Agg")
