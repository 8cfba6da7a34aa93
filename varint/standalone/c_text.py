"""CasADi functions as C99 text that stands alone: without the interface that CasADi's own loader
asks for, and without a warning of strict compilers.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca

INTERFACE = "CASADI_SYMBOL_EXPORT"
# CasADi's functions hand addresses of local numbers on in the caller's array of pointers, which
# nobody reads after the call; in its qrqp a sign is set wherever there is an index to go with it.
# gcc does not see either.
HEAD = """#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#if __GNUC__ >= 12
#pragma GCC diagnostic ignored "-Wdangling-pointer"
#endif
#endif

/* Prefix of internal symbols */
"""
_VISIBILITY = re.compile(r"/\* Symbol visibility in DLLs \*/\n#ifndef.*?\n#endif\n\n", re.DOTALL)
_PREFIX = re.compile(r"/\* How to prefix internal symbols \*/\n.*?\n#endif\n", re.DOTALL)
_HEAD = re.compile(r"^(?:static )?(?:\w+\*? )+\*?casadi_\w+\(([^{};]*)\) ?\{$", re.MULTILINE)
_ARRAY = re.compile(r"^static const casadi_\w+ (casadi_[sc]\d+)\[.*?;\n", re.MULTILINE | re.DOTALL)
_PRINTING = re.compile(r"#ifdef CASADI_SNPRINTF\n.*?#else\n(.*?)#endif\n", re.DOTALL)
_COPY_OF_NOTHING = re.compile(r"^ *casadi_copy\([^,()]*, 0, [^;]*\);\n", re.MULTILINE)
_COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)
_SIZE = re.compile(r"\*sz_(?:arg|res|iw|w) = (\d+);")
_CALLED = re.compile(r"return (casadi_f\d+)\(")


@dataclass(frozen=True)
class CFunction:
    """A function of the text: ``int <called>(arg, res, iw, w, mem)``, as CasADi calls it.

    Attributes
    ----------
    name, called : str
        Of the CasADi function, and of the C function.
    arguments, results, integers, numbers : int
        Lengths of the arrays `arg`, `res`, `iw` and `w`.
    """

    name: str
    called: str
    arguments: int
    results: int
    integers: int
    numbers: int


@dataclass(frozen=True)
class CText:
    """C99 text of functions, by their names."""

    text: str
    functions: dict[str, CFunction]


def c_text(name: str, functions: Sequence[ca.Function]) -> CText:
    """The functions and all that they call as one piece of C99.

    All symbols begin with ``<name>_casadi_``, integers are `int`, and only ``<math.h>`` is
    included.
    """
    generator = ca.CodeGenerator(f"{name}_casadi.c", {"casadi_int": "int"})
    for f in functions:
        generator.add(f)
    text, removed = _without_interface(generator.dump())
    called: dict[str, CFunction] = {}
    for f in functions:
        entry = _CALLED.search(removed[f"{f.name()}("])
        assert entry is not None, f.name()
        sizes = [int(x) for x in _SIZE.findall(removed[f"{f.name()}_work("])]
        called[f.name()] = CFunction(f.name(), entry.group(1), *sizes)
    text = _PREFIX.sub(lambda _: HEAD + f"#define CASADI_PREFIX(ID) {name}_casadi_##ID\n", text)
    text = _COPY_OF_NOTHING.sub("", _PRINTING.sub(r"\1", _VISIBILITY.sub("", text)))
    return CText(_with_unused_named(_without_unused_arrays(text)), called)


def _without_interface(text: str) -> tuple[str, dict[str, str]]:
    """The text without the functions that are exported to CasADi's loader, and those by what
    follows their type: ``name(``.
    """
    kept, removed, inside = [], {}, ""
    for line in text.splitlines():
        if line.startswith(INTERFACE):
            inside = line.split("(", 1)[0].split()[-1].lstrip("*") + "("
            removed[inside] = ""
        if not inside:
            kept.append(line)
            continue
        removed[inside] += f"{line}\n"
        if line == "}" or (line.startswith(INTERFACE) and line.endswith("}")):
            inside = ""
    squeezed = re.sub(r"\n{3,}", "\n\n", "\n".join(kept))
    c_only = re.sub(r"#ifdef __cplusplus\n.*?#endif\n", "", squeezed, flags=re.DOTALL)
    return f"{c_only}\n", removed


def _without_unused_arrays(text: str) -> str:
    """The text without constant arrays that only the interface had a use for."""
    for array in _ARRAY.findall(text):
        if len(re.findall(rf"\b{array}\b", text)) == 2:  # its prefix, and the array itself
            text = re.sub(rf"^#define {array} .*\n", "", text, flags=re.MULTILINE)
            text = re.sub(rf"^static const \w+ {array}\[[^;]*;\n", "", text, flags=re.MULTILINE)
    return text


def _with_unused_named(text: str) -> str:
    """Arguments that a function does not use, said to be so."""
    parts, last = [], 0
    for head in _HEAD.finditer(text):
        body = _COMMENT.sub("", text[head.end() : text.index("\n}", head.end())])
        names = [x.replace("*", " ").split()[-1] for x in head.group(1).split(",")]
        unused = [x for x in names if x != "void" and not re.search(rf"\b{x}\b", body)]
        parts.append(text[last : head.end()])
        parts += [f"\n  (void){x};" for x in unused]
        last = head.end()
    return "".join([*parts, text[last:]])
