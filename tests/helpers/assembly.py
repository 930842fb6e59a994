"""The stack that machine code uses, read from the assembly of x86-64 and AArch64."""

import re
from functools import cache

import llvmlite.binding as llvm

LABEL = re.compile(r'^_?"?([A-Za-z_][\w.$]*)"?:')
COMMENT = re.compile("# |//|;")
WORD = re.compile(r"[\w.]+")
#: What takes stack: bytes, or the alignment that a frame is moved to.
PUSHED = re.compile(r"\s+pushq?\s")
TAKEN = re.compile(r"\s+subq?\s+\$(\d+), %rsp")
ALIGNED = re.compile(r"\s+andq?\s+\$-(\d+), %rsp")
TAKEN_ARM = re.compile(r"\s+sub\s+sp, (?:sp|x\d+), #(\d+)(?:, lsl #(\d+))?")
PUSHED_ARM = re.compile(r"\s+(?:stp|str)\s.*\[sp, #-(\d+)\]!")
ALIGNED_ARM = re.compile(r"\s+and\s+sp, x\d+, #0x([0-9a-f]+)")


def stacks(text, target):
    """Return the stack [bytes] that each function of a module uses, with those that it calls."""
    frames, named, name = {}, {}, None
    for line in target.emit_assembly(llvm.parse_assembly(text)).splitlines():
        if (found := LABEL.match(line)) and not found[1].startswith((".L", "LBB", "Lfunc", "lCPI")):
            name = found[1]
            frames[name], named[name] = 8, set()
        if name is None or line.startswith("\t."):
            continue
        if PUSHED.match(line):
            frames[name] += 8
        elif found := TAKEN.match(line) or PUSHED_ARM.match(line):
            frames[name] += int(found[1])
        elif found := TAKEN_ARM.match(line):
            frames[name] += int(found[1]) << int(found[2] or 0)
        elif found := ALIGNED.match(line):
            frames[name] += int(found[1]) - 1
        elif found := ALIGNED_ARM.match(line):
            frames[name] += 2**64 - int(found[1], 16)
        else:
            code = COMMENT.split(line)[0]
            named[name].update(word.removeprefix("_") for word in WORD.findall(code))

    @cache
    def whole(name):
        called = (each for each in named[name] if each in frames and each != name)
        return frames[name] + max(map(whole, called), default=0)

    return {name: whole(name) for name in frames}
