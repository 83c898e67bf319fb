"""``make bench``, or ``python -m benchmarks [NAME ..] [--quick] [-o FILE.json]``."""

from __future__ import annotations

import os

# One BLAS thread: said before NumPy is loaded, as afterwards it is too late for some libraries.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"):
    os.environ[_variable] = "1"

import sys  # noqa: E402

from benchmarks._run import main  # noqa: E402

if __name__ == "__main__":
    sys.exit(main())
