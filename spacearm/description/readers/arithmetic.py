"""Arithmetic: numbers, pi, + - * / and parentheses, as SPART's files write their numbers."""

from __future__ import annotations

import math
import re

TOKEN = re.compile(
    r"\s*((?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|pi(?![a-z])|[-+*/()])", re.ASCII | re.IGNORECASE
)
DEEPEST = 50
"""Largest number of parentheses and signs inside one another."""


def split(text: str, count: int) -> list[str]:
    """Return the `count` words of a vector, with spaces or commas or both between them."""
    if count == 1:
        return [text]
    words = text.replace(",", " ").split()
    return text.split(",") if len(words) != count and "," in text else words


def evaluate(text: str) -> float | None:
    """Compute the number that a text stands for; None if it stands for none."""
    tokens: list[str] = []
    end = 0
    text = text.strip()
    while end < len(text):
        token = TOKEN.match(text, end)
        if token is None:
            return None
        tokens.append(token[1].lower())
        end = token.end()
    try:
        value = _sum(tokens, 0)
    except (IndexError, ValueError, ZeroDivisionError):
        return None
    return None if tokens else value


def _sum(tokens: list[str], depth: int) -> float:
    value = _product(tokens, depth)
    while tokens and tokens[0] in "+-":
        sign = 1.0 if tokens.pop(0) == "+" else -1.0
        value += sign * _product(tokens, depth)
    return value


def _product(tokens: list[str], depth: int) -> float:
    value = _factor(tokens, depth)
    while tokens and tokens[0] in "*/":
        if tokens.pop(0) == "*":
            value *= _factor(tokens, depth)
        else:
            value /= _factor(tokens, depth)
    return value


def _factor(tokens: list[str], depth: int) -> float:
    if depth > DEEPEST:
        raise ValueError("too deep")
    token = tokens.pop(0)
    if token in "+-":
        value = _factor(tokens, depth + 1)
        return -value if token == "-" else value
    if token == "(":
        value = _sum(tokens, depth + 1)
        if tokens.pop(0) != ")":
            raise ValueError("no )")
        return value
    return math.pi if token == "pi" else float(token)
