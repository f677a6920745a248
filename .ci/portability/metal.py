"""Checks of Metal's language: limits by text; syntax and types by clang as C++ with a library in place of Metal's."""

import pathlib
import re

import clang.cindex

STUB = pathlib.Path(__file__).parent / "metal_stdlib"
MOST_WORKGROUP_VARIABLES = 31
MOST_BUFFERS = 29
VECTOR = r"metal::((?:u?int|float|half|bool)[234])"
REWRITES = [
    (rf"\b{VECTOR}\(", r"metal::make_\1("),
    (rf"\bstatic_cast<{VECTOR}>\(", r"metal::make_\1("),
    # Without a suffix Metal's numbers are floats, C++'s doubles.
    (r"(?<![\w.])(\d+\.\d*(?:e[+-]?\d+)?|\d+e[+-]?\d+)(?![\w.])", r"\1f"),
    (r"(?<![\w.])(\d+\.\d*(?:e[+-]?\d+)?)h\b", r"half(\1f)"),
]


def limits(text):
    """What the text has too much of."""
    found = []
    workgroup = re.findall(r"^[,\s]*threadgroup [^\n]*& \w+\s*$", text[text.index("kernel void"):], re.MULTILINE)
    if len(workgroup) > MOST_WORKGROUP_VARIABLES:
        found.append(f"{len(workgroup)} workgroup variables, {MOST_WORKGROUP_VARIABLES} are the most")
    buffers = len(re.findall(r"\[\[buffer\(\d+\)\]\]", text))
    if buffers > MOST_BUFFERS:
        found.append(f"{buffers} buffers, {MOST_BUFFERS} are the most")
    # Metal's compiler may assume that numbers are finite.
    if calls := sorted(set(re.findall(r"\b(?:isnan|isinf|isfinite)\b", text))):
        found.append(f"calls {', '.join(calls)}")
    return found


def syntax(text):
    """The first errors of clang."""
    for pattern, replacement in REWRITES:
        text = re.sub(pattern, replacement, text)
    files = [("kernel.cpp", text), ("library/metal_stdlib", STUB.read_text()), ("library/simd/simd.h", "")]
    options = ["-std=c++17", "-Ilibrary", "-nostdinc", "-Wno-everything"]
    unit = clang.cindex.Index.create().parse("kernel.cpp", options, files)
    errors = [d for d in unit.diagnostics if d.severity >= clang.cindex.Diagnostic.Error]
    return [f"{d.location.file}:{d.location.line}: {d.spelling}" for d in errors[:3]]


def check(text):
    return limits(text) + syntax(text)
