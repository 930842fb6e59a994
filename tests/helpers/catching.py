"""A catch, for tests of what becomes of results."""

from functools import cache

import spacearm as sa


@cache
def caught() -> sa.Catch:
    """A box that rests before the hand of chaser7."""
    start = sa.load("chaser7").at([0.0, 0.6, 0.0, 1.2, 0.0, 0.8, 0.0])
    place = start.tip * sa.pose((0.1, 0.0, 0.8))
    box, ring = sa.Bus(60.0, size=(0.6, 0.6, 0.8)), sa.pose((0, 0, -0.45))
    target = sa.Target(box, place, grapples={"ring": ring})
    search = sa.Search(method="straight", timeout=3600.0)  # so many tries on any machine
    return sa.catch(start, target, window=(10, 10), wanted=1, search=search)


@cache
def flown() -> sa.CatchRuns:
    """Three runs of that catch."""
    return sa.fly_many(caught(), runs=3, sampling=sa.Sampling(period=0.2))
