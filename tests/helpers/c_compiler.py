"""The C compiler of the tests, as strict as can be."""

import shutil

import numpy as np
import pytest

COMPILER = shutil.which("gcc")
STRICT = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic")
NUMBERS = np.ctypeslib.ndpointer(np.float64, flags="C_CONTIGUOUS")

compiled_code = pytest.mark.skipif(COMPILER is None, reason="gcc is not installed")
