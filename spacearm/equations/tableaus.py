"""Coefficients of the methods that integrate: DOP853, and Rodas5P for stiff equations.

The numbers are in tableaus.json. DOP853: Hairer, Norsett & Wanner, Solving Ordinary Differential
Equations I, 2nd ed., Springer 1993, section II.10, and their code. Rodas5P: Steinebach, BIT Numer.
Math. 63, 27 (2023), DOI 10.1007/s10543-023-00967-x, transformed as in Hairer & Wanner II (1996),
section IV.7.
"""

from __future__ import annotations

import json
from pathlib import Path

_methods = json.loads(Path(__file__).with_suffix(".json").read_text(encoding="utf-8"))

#: Of DOP853: weights of the stages before each stage, and in the step; times of the stages, as
#: shares of the step (stage 12 is its end, the last three are dense); weights in the errors of
#: order 5 and 3; weights of the stages before each stage of the dense output, and of all 16 in its
#: last four coefficients.
A, B, C, E5, E3, A_DENSE, D = _methods["DOP853"].values()
#: Of Rodas5P: the diagonal of its coefficients; weights of the stages before in the state of each
#: stage (those of the last two follow), and in its right-hand side; times of the stages, as shares
#: of the step; weights of the derivative by time in the right-hand sides, and of the stages in the
#: dense output.
GAMMA, SHARES, COUPLINGS, TIMES, SLOPES, CURVES = _methods["Rodas5P"].values()
