"""Names of array types; shapes, units and frames stand where each is used."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
"""Reals in double precision."""

IntArray = NDArray[np.int64]
"""Whole numbers: drones, pairs, steps."""

BoolArray = NDArray[np.bool_]
"""Truth by element: masks."""

ByteArray = NDArray[np.uint8]
"""Bytes: colours, mostly."""
