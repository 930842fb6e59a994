"""Labels: joint names without what all of them have in common."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import takewhile

ENDS = r"_\-./: "
"""What words end at, as it stands in a set of a regular expression."""


def short_names(names: Sequence[str]) -> list[str]:
    """Return names without the words that all begin and end with, as long as words remain.

    A word ends at `_`, `-`, `.`, `/`, `:` or a space. What remains is never a number alone: of
    `vispa_joint_1` and `vispa_joint_2` it is `joint_1` and `joint_2`.

    Args:
        names: The names.
    """
    words = [re.findall(rf"[^{ENDS}]+|[{ENDS}]+", name) for name in names]
    if len(names) < 2 or any(len(parts) < 2 for parts in words):
        return list(names)
    first = _shared(words)
    rest = [parts[first:] for parts in words]
    last = _shared([parts[::-1] for parts in rest])
    rest = [parts[: len(parts) - last] for parts in rest]
    while first and any(not any(c.isalpha() for c in "".join(parts)) for parts in rest):
        first -= 1
        rest = [[whole[first], *parts] for whole, parts in zip(words, rest, strict=True)]
    short = ["".join(parts).strip("_-./: ") for parts in rest]
    return short if all(short) and len(set(short)) == len(set(names)) else list(names)


def _shared(words: Sequence[Sequence[str]]) -> int:
    """Return how many words all lists begin with; one at least is left of each."""
    most = min(len(parts) for parts in words) - 1
    columns = list(zip(*words, strict=False))[: max(most, 0)]
    return sum(1 for _ in takewhile(lambda column: len(set(column)) == 1, columns))
