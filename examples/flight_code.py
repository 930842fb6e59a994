"""C code of an arm: S, its gradient, J* and bounds of sigma_min, without dependencies."""

from tempfile import TemporaryDirectory

import spacearm as sa

with TemporaryDirectory() as folder:
    header, source = sa.to_c(sa.load("planar2"), folder)
    print(header.read_text())
    print(len(source.read_text().splitlines()), "lines of C")
