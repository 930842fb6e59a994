"""Estimates of the time and the disk space that a sweep takes, before it begins.

Some chunks of each quantity are computed and thrown away, spread over the arms, designs and boxes
of the study. The first chunk of an arm or a design also compiles and loads: this part is counted
once for each worker. The rest is extrapolated, each arm by its own mean.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from spacearm.files import temporary_folder
from spacearm.sweeps.store import Store
from spacearm.sweeps.study import Chunk, Study

#: CPU time after which no further chunk is computed for an estimate [s].
BUDGET = 20.0
#: Chunks of a quantity that are computed even if they take the same time, if the budget allows.
LEAST = 16
#: Relative standard error at which an estimate is good enough.
GOOD = 0.1
#: CPU time up to which a first chunk is repeated to tell compilation apart [s].
QUICK = 5.0
#: Golden ratio: its multiples modulo 1 are evenly spread, however many are taken.
GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)


class Estimate(NamedTuple):
    """Time and disk space that a quantity of a study will take.

    Attributes:
        quantity: Its name.
        chunks: Number of chunks.
        seconds: CPU time of all chunks, compilation by each worker included [s].
        at_least: The same two standard errors lower; of arms of which fewer than two chunks were
            computed, the time of these chunks [s].
        is_known: Whether each arm was tried and `seconds` is at most twice `at_least`.
        longest: CPU time of the longest chunk that was computed [s].
        nbytes: Size of its numbers, uncompressed.
    """

    quantity: str
    chunks: int
    seconds: float
    at_least: float
    is_known: bool
    longest: float
    nbytes: int


@dataclass
class _ArmTimes:
    """CPU times of the chunks of one arm that were computed [s].

    Attributes:
        unused: Chunks to compute, spread over the designs and boxes of the arm.
        total: Number of all chunks of the arm.
        settled: Times of chunks of designs that were compiled and loaded before.
        setups: Times that compilation and loading took in the first chunk of each design.
        seen: Designs that were computed.
    """

    unused: Iterator[Chunk]
    total: int
    settled: list[float] = field(default_factory=list)
    setups: list[float] = field(default_factory=list)
    seen: set[int] = field(default_factory=set)

    @property
    def error(self) -> float:
        """Standard error of the time of all chunks [s]; infinite if it is not known yet."""
        tried = len(self.settled)
        if tried >= self.total:
            return 0.0
        if tried < 2:
            return math.inf
        deviation = float(np.std(self.settled, ddof=1))
        return self.total * deviation * math.sqrt((1.0 - tried / self.total) / tried)

    @property
    def at_least(self) -> float:
        """Time that all chunks of the arm take at least, compilation apart [s]."""
        known = sum(self.settled)
        if not math.isfinite(self.error):
            return known  # zero of an arm that was not tried
        return max(known, self.total * float(np.mean(self.settled)) - 2.0 * self.error)

    def seconds(self, designs: int, workers: int) -> float:
        """Return the time of all chunks of the arm, which has so many designs [s]."""
        if not self.settled:
            return 0.0
        of_arm = self.setups[0] if self.setups else 0.0
        of_design = float(np.mean(self.setups[1:])) if len(self.setups) > 1 else 0.0
        each_design = min(workers, self.total // designs)
        setup = min(workers, self.total) * max(of_arm - of_design, 0.0)
        return self.total * float(np.mean(self.settled)) + setup + designs * each_design * of_design


def estimate(study: Study, workers: int = 1, budget: float = BUDGET) -> list[Estimate]:
    """Estimate what a study will take.

    Args:
        study: The study.
        workers: Number of processes that compute; each compiles for itself.
        budget: CPU time after which no further chunk is computed [s]; one of each quantity is
            computed in any case.
    """
    estimates = []
    with temporary_folder() as folder:
        store = Store.create(folder / "estimate.zarr", study)
        for name in study.quantities:
            share = budget / len(study.quantities)
            estimates.append(_estimate(study, store, name, workers, share))
    return estimates


def _estimate(study: Study, store: Store, name: str, workers: int, budget: float) -> Estimate:
    arms, designs = study.shape[0], math.prod(study.shape[1:])
    chunks = study.count(name)
    each_design = chunks // (arms * designs)
    times = [
        _ArmTimes(_spread_chunks(name, arm, designs, each_design), designs * each_design)
        for arm in range(arms)
    ]
    begun, longest = time.process_time(), 0.0

    def spent() -> float:
        return time.process_time() - begun

    def seconds() -> float:
        return sum(arm.seconds(designs, workers) for arm in times)

    def is_good() -> bool:
        error = math.hypot(*(arm.error for arm in times))
        enough = sum(len(arm.settled) for arm in times) >= min(LEAST, chunks)
        return enough and error <= GOOD * seconds()

    while not longest or (spent() < budget and not is_good()):
        arm = max(times, key=lambda each: (each.error, -len(each.settled)))
        chunk = next(arm.unused)
        design = chunk.number // each_design
        took = _computed(study, store, chunk)
        longest = max(longest, took)
        if design in arm.seen:
            arm.settled.append(took)
            continue
        is_first = not arm.seen
        arm.seen.add(design)
        settled = took
        if took < QUICK and arm.total > 1 and (is_first or each_design > 1):
            settled = min(_computed(study, store, chunk), took)
        arm.settled.append(settled)
        arm.setups.append(took - settled)
    at_least = sum(arm.at_least for arm in times)
    is_known = all(arm.seen for arm in times) and seconds() <= 2.0 * at_least
    size = study.quantities[name].nbytes(math.prod(study.shape))
    return Estimate(name, chunks, seconds(), at_least, is_known, longest, size)


def _spread_chunks(name: str, arm: int, designs: int, each_design: int) -> Iterator[Chunk]:
    """Iterate over all chunks of an arm, any number of the first evenly spread."""
    total = designs * each_design
    used: set[int] = set()
    for i in range(total):
        number = int(((i + 0.5) * GOLDEN % 1.0) * total)
        while number in used:
            number = (number + 1) % total
        used.add(number)
        yield Chunk(name, arm * total + number)


def _computed(study: Study, store: Store, chunk: Chunk) -> float:
    """Return the CPU time in which a chunk is computed, written and read back [s]."""
    begun = time.process_time()
    store.is_done(chunk)
    store.write(chunk, study.compute(chunk))
    store.is_done(chunk)
    return time.process_time() - begun
