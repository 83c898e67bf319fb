"""The arrays of annotations by their names: one alias each, wherever they are used."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: Numbers of double precision; the docstring of what has them says shape, unit and frame.
Array = NDArray[np.float64]
#: What is chosen, or true, among samples.
Mask = NDArray[np.bool_]
#: Whole numbers, mostly of rows.
Rows = NDArray[np.intp]
