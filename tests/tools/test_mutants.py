"""The mutants (run on demand, see there) still fit the formulas."""

import mutants
import pytest


def test_each_formula_is_there_once():
    for mutant in mutants.MUTANTS:
        source = (mutants.ROOT / "spacearm" / mutant.file).read_text(encoding="utf-8")
        assert mutants.broken(source, mutant) != source, mutant.formula
        for name in mutant.tests.split():
            assert (mutants.ROOT / "tests" / f"{name}.py").is_file(), mutant.formula


def test_a_formula_that_is_gone_is_an_error():
    with pytest.raises(SystemExit, match="say anew which text"):
        mutants.broken("nothing", mutants.MUTANTS[0])
