"""Mutations: URDF text with a few things wrong."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from spacearm.description.model_catalogue import arms, models_folder

HOSTILE = (
    "1e30", "1" + 400 * "0", "-0.0", "1e-308",
    "", " ", "0", "-1", "1e-300", "1e308", "-1e400", "nan", "inf", "0x10", "1,5", "1 2", "1 2 3",
    "1 2 3 4", "0 0 0", "nan 0 0", "1e200 1e200 1e200", "\u0661", "\u2028", "\U0001f916", "%s%n",
    "../../etc/passwd", "/dev/zero", "file:///etc/passwd", "http://127.0.0.1:9/x", "package://a/b",
    "${1/0}", "$(find x)", "[red]", "'; import os", "a" * 5000, "9" * 5000, "revolute", "prismatic",
    "fixed", "floating", "continuous", "true", "/tmp/absolute", "..", "$a$", "$\\frac{$",
    "a\x9b31m", "\x85\u202e\x7f", "-o",
)  # fmt: skip


def urdf_sources() -> list[Path]:
    """All models, and all of example-robot-data."""
    above = {p for arm in arms() for p in arm.path.parents if p.name == "robots"}
    robots = min(above, key=lambda p: len(p.parts))
    return [*sorted(models_folder().glob("*.urdf")), *sorted(robots.rglob("*.urdf"))]


def mutated(text: str, rng: np.random.Generator) -> bytes:
    """URDF text with a few things wrong, in its elements or in its letters."""
    for _ in range(rng.choice([0, 1, 2, 3], p=[0.05, 0.65, 0.2, 0.1])):
        text = rng.choice(MUTATIONS)(text, rng)
    data = text.encode("utf-8", "surrogatepass")
    if rng.random() < 0.03:
        at = rng.integers(0, len(data) + 1)
        data = data[:at] + rng.bytes(rng.integers(0, 8)) + data[at:]
    return data


def renamed(text: str, rng: np.random.Generator, names: Sequence[str] = HOSTILE) -> str:
    """URDF text with a hostile name of the robot, of a link or of a joint, wherever it stands."""
    given = re.findall(r'name="([^"]+)"', text)
    if not given:
        return text
    old = given[0 if rng.random() < 0.5 else rng.integers(len(given))]
    return text.replace(f'"{old}"', f'"{names[rng.integers(len(names))]}"')


def other_numbers(text: str, rng: np.random.Generator) -> str:
    """URDF text with up to three other numbers."""
    for _ in range(rng.integers(0, 4)):
        text = _number(text, rng)
    return text


def altered(data: bytes, rng: np.random.Generator) -> bytes:
    """A file with a few other bytes, or cut off."""
    changed = bytearray(data)
    for _ in range(rng.integers(1, 20) if changed else 0):
        changed[rng.integers(len(changed))] = rng.integers(256)
    kept = len(changed) if rng.random() < 0.7 else int(rng.integers(len(changed) + 1))
    return bytes(changed[:kept])


def changed_text(text: str, rng: np.random.Generator) -> bytes:
    """A text with a few words, lines or letters that are wrong."""
    for _ in range(rng.integers(1, 4)):
        words = list(re.finditer(r"[^\s,:\"<>]+", text))
        if not words:
            break
        match, other = (words[i] for i in rng.integers(0, len(words), 2))
        value = str(rng.choice(HOSTILE)) if rng.random() < 0.7 else other[0]
        text = text[: match.start()] + value + text[match.end() :]
    return altered(text.encode(), rng) if rng.random() < 0.2 else text.encode()


def _value(text: str, rng: np.random.Generator) -> str:
    """Another value of an attribute: hostile, or that of another attribute."""
    found = list(re.finditer(r'"[^"<>]*"', text))
    if not found:
        return text
    match, other = (found[i] for i in rng.integers(0, len(found), 2))
    value = rng.choice(HOSTILE) if rng.random() < 0.7 else other[0][1:-1]
    return text[: match.start() + 1] + str(value) + text[match.end() - 1 :]


def _number(text: str, rng: np.random.Generator) -> str:
    """Another number, of any size."""
    found = list(re.finditer(r'(?<=[" ])-?\d+\.?\d*(?=[" ])', text))
    if not found:
        return text
    match = found[rng.integers(len(found))]
    value = float(float(match[0]) * 10.0 ** rng.uniform(-12, 12) * rng.choice([-1, 1, 0]))
    return f"{text[: match.start()]}{value!r}{text[match.end() :]}"


def _element(text: str, rng: np.random.Generator) -> str:
    """A piece between two tags left out, doubled, or put elsewhere."""
    tags = [match.start() for match in re.finditer("<", text)]
    if len(tags) < 2:
        return text
    first, last = sorted(rng.choice(tags, 2))
    last = min(last, first + int(rng.integers(1, 2000)))
    piece, kind = text[first:last], rng.integers(3)
    if kind == 0:
        return text[:first] + text[last:]
    at = first if kind == 1 else int(rng.choice(tags))
    return text[:at] + piece + text[at:]


def _letters(text: str, rng: np.random.Generator) -> str:
    """A few letters gone, or others in their place."""
    first = int(rng.integers(0, len(text) + 1))
    last = first + int(rng.integers(0, 12))
    new = rng.choice(["", "<", ">", '"', "&", "&a;", "\x00", "<!--", "]]>", "<?p?>", "\ufeff"])
    return text[:first] + str(new) + text[last:]


def _whole(text: str, rng: np.random.Generator) -> str:
    """Something about the whole file."""
    bomb = '<!DOCTYPE robot [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;">]>'
    xacro = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'
    return [
        text[: int(rng.integers(0, len(text) + 1))],
        bomb + text,
        text + text,
        "<robot>" * int(rng.integers(1, 2000)) + text,
        text.replace("<robot", f"<robot {xacro}", 1).replace("<link", "<xacro:link", 1),
        re.sub(r"<robot[^>]*>", f'<robot name="r" {xacro}><xacro:property name="a" '
               f'value="{rng.choice(HOSTILE)}"/>', text, count=1).replace('"0"', '"${a}"'),
        text.replace("utf-8", "utf-16", 1),
        "",
    ][rng.integers(8)]  # fmt: skip


MUTATIONS = (_number, _number, _value, _value, _element, _element, _letters, _whole)
