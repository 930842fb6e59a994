"""Licences: what the package and all that it needs, directly or not, may be used under.

    python tests/tools/licences.py                          # without the extras
    python tests/tools/licences.py --extra cluster --extra gpu   # with what these bring

Read from the metadata of what is installed here. 1 if a dependency names no licence.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable
from importlib.metadata import PackageNotFoundError, distribution

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

UNSAID = "not said"
NOTES = {
    "jrl-cmakemodules": "CMake files that example-robot-data comes with: nothing links to them",
}
"""What a licence means here that asks for more than to be named."""


def dependencies(name: str, extras: Iterable[str] = ()) -> set[str]:
    """The distributions that one needs with some of its extras, directly or not."""
    found, waiting = set(), [(name, frozenset(extras))]
    while waiting:
        name, extras = waiting.pop()
        for text in distribution(name).requires or ():
            wanted = Requirement(text)
            marker, key = wanted.marker, canonicalize_name(wanted.name)
            needed = not marker or any(marker.evaluate({"extra": e}) for e in ("", *extras))
            if needed and key not in found:
                found.add(key)
                waiting.append((key, frozenset(wanted.extras)))
    return found


def licence(name: str) -> str:
    """The licence that the metadata of a distribution names."""
    metadata = distribution(name).metadata
    if expression := metadata.get("License-Expression"):
        return str(expression)
    classified = [
        text.rpartition(" :: ")[2]
        for text in metadata.get_all("Classifier", [])
        if text.startswith("License ::")
    ]
    said = str(metadata.get("License", "")).strip().partition("\n")[0]
    texts = ", ".join(metadata.get_all("License-File", []))
    return " / ".join(classified) or said or (f"in its {texts}" if texts else UNSAID)


def main() -> int:
    """Prints the table; 0 if every licence is named."""
    parser = argparse.ArgumentParser()
    known = distribution("spacearm").metadata.get_all("Provides-Extra", [])
    parser.add_argument("--extra", action="append", default=[], choices=known)
    try:
        needed = dependencies("spacearm", parser.parse_args().extra)
    except PackageNotFoundError as error:
        parser.error(f"{error.name} is not installed: install the extra first")
    rows = [(name, licence(name)) for name in ("spacearm", *sorted(needed))]
    for name, said in rows:
        note = f" ({NOTES[name]})" if name in NOTES else ""
        print(f"{name:26} {distribution(name).version:16} {said}{note}")
    return 1 if UNSAID in dict(rows).values() else 0


if __name__ == "__main__":
    sys.exit(main())
