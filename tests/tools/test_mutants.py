"""The mutants (run on demand, see there) still fit the formulas."""

import mutants
import pytest


@pytest.mark.parametrize("mutant", mutants.MUTANTS, ids=lambda m: m.formula)
def test_the_formula_is_there_once(mutant):
    source = (mutants.ROOT / "spacearm" / mutant.file).read_text(encoding="utf-8")
    assert mutants.broken(source, mutant) != source
    for name in mutant.tests.split():
        assert (mutants.ROOT / "tests" / f"{name}.py").is_file()


def test_a_formula_that_is_gone_is_an_error():
    with pytest.raises(SystemExit, match="say anew which text"):
        mutants.broken("nothing", mutants.MUTANTS[0])
