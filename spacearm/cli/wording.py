"""Wording of the command line: numbers in arguments, names of options in messages."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from decimal import Decimal

#: Exit code after Ctrl-C, as shells have it.
INTERRUPTED = 130
#: What messages name in the words of Python, and the options that do the same.
OPTIONS: dict[str, str | Callable[[re.Match[str]], str]] = {
    r"\bsa\.mount\('[^']*', sa\.Bus\(mass=\.\.\., size=\.\.\.\)\)": "--bus KG",
    r"xacro_args=\{(.*?)\}": lambda found: " ".join(
        f"--arg {name}:={value}" for name, value in re.findall(r'"([^"]*)": "([^"]*)"', found[1])
    ),
    r"packages=\[FOLDER\]": "the variable ROS_PACKAGE_PATH",
    r"\b(?:arm\.replace\()?tip='([^']+)'\)?": r"--tip \1",
    r"\btip=\('([^']+)', '([^']+)'\)": r"--tip \1,\2",
    r"\bdensity=(\d+) \[kg/m\^3\]": r"--density \1",
    r"locked=\{'([^']*)': ([^}]*)\}": r"--lock \1=\2",
    r"locked=\{\.\.\.\}": "--lock JOINT=VALUE",
    r"\b(lock|wheel|tip|joints)(?:ed|s)?: (?=unknown|joint)": r"--\1: ",
    r"\bgive motions or tip_speed\b": "give --motion or --tip-speed",
    r"\b(limits|collisions)=False": r"--with constraints.\1=false",
    r'check="(\w+)"': r"--check \1",
    r'joints="all"': "--joints all",
    r"\bnp\.radians\(\.\.\.\) turns degrees into them": "--deg takes degrees",
    r"\bup_axes=True\b": "spacearm convert --up-axes, or up_axes = true in the table of a target "
    "or obstacle,",
    r"give True or False": "give true or false, as TOML and JSON write them",
    r"wheels=\[\.\.\.\]": "--wheel JOINT",
    r"tip=LINK": "--tip LINK",
    r"\btask='([^']+)'": r"--task '\1'",
    r"task=Task\('(\w+)', length=\.\.\.\)": r"--task \1/METRES",
    r"\btip=\{NEW: '([^']*)'\}": r"--tip NEW=\1",
    r"\bsa\.hold\(arm\.at\(q\)\)": "spacearm hold",
    r"\bfixed=False": "no --fixed",
    r"grasps=\{tip: frame\}": "--grasp TIP=FRAME for each tip",
    r"grapple=\{tip: frame\}": "--grapple TIP=FRAME for each tip",
    r"\bdensity=(?!\w)": "--density RHO",
    r"boxes=sa\.free_boxes\(arm\)(, or those of a file)?": "--with search.boxes=FILE, as spacearm "
    "boxes --keep FILE has written it",
    r"\ball_branches=True\b": "no joint values",
    r"\bsa\.risk_profile\b": "spacearm risk",
    r"\bsa\.(workspace|plan|detumble|simulate|query|capture|mount)\b": r"spacearm \1",
    r" \(sa\.Joints\)": "",
    r"write its quantities for other programs by to_xarray\(\)\.to_netcdf\(path\)": "print its "
    "quantities for other programs by --json",
}
#: Options that take several numbers, as many as the arm needs or two.
VECTORS = ("--target", "--goal", "--corner", "--window")
#: Most digits of a whole number that is written with an exponent.
LONGEST_NUMBER = 400
NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")


def join_numbers(words: Sequence[str]) -> list[str]:
    """Join the numbers after each option of `VECTORS` to one word."""
    joined: list[str] = []
    vector = False
    for word in words:
        if vector and NUMBER.fullmatch(word):
            if joined[-1] in VECTORS:
                joined.append(word)
            else:
                joined[-1] += f" {word}"
        else:
            joined.append(word)
            vector = word in VECTORS
    return joined


def whole_number(word: str) -> str:
    """Return a whole number that is written as 1e6 or 2.0 in digits; other words as they are."""
    if not NUMBER.fullmatch(word):
        return word
    number = Decimal(word)
    short = number.adjusted() <= LONGEST_NUMBER and number == number.to_integral_value()
    return str(int(number)) if short else word


def in_own_words(text: str) -> str:
    """Return a text with the remedies that it names as options of the command line."""
    for python, option in OPTIONS.items():
        text = re.sub(python, option, text)
    return text
