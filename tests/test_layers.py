"""Imports point downwards only, read from the source by `ast`; matplotlib stays behind `plot` and `animate`."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parent.parent / "varint"
SOURCES = sorted(PACKAGE.rglob("*.py"))

# Lowest first. A module may import from lower layers and, within its own layer, as long as no circle arises.
LAYERS = [
    {"errors", "polynomials", "arrays", "progress", "files"},
    {"compositions", "structure", "parameters", "grid", "declaration"},
    {"rules", "system", "sketch"},
    {"manifold", "legendre", "description", "expressions"},
    {"between", "discrete", "symmetry", "assembly", "horizon", "geodesics"},
    {"trajectory"},
    {"consistency", "stepping", "compiled", "projection", "boundary", "control"},
    {"ensembles", "diagnostics", "models", "archive"},
    {"plot", "plot_diagnostics", "animate"},
    {"__init__"},
    {"__main__"},
]
RANK = {module: rank for rank, layer in enumerate(LAYERS) for module in layer}
DRAWING = {"plot", "plot_diagnostics", "animate"}
LONGEST = 250  # lines of code: without blank lines, comments and docstrings


def module_of(source: Path) -> str:
    """The layer's name for a file: `stepping/plan.py` belongs to `stepping`."""
    return source.relative_to(PACKAGE).parts[0].removesuffix(".py")


def dotted(source: Path) -> str:
    """`varint.stepping.plan` of `stepping/plan.py`; a package's `__init__` is the package."""
    parts = ["varint", *source.relative_to(PACKAGE).with_suffix("").parts]
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imports(source: Path, *, lazy: bool = False) -> list[tuple[str, int]]:
    """(absolute name imported, line) of the imports that run with the module; with `lazy` also those in functions.

    What is imported for type checkers alone never runs.
    """
    found: list[tuple[str, int]] = []

    def visit(node: ast.AST):
        if isinstance(node, ast.Import):
            found.extend((alias.name, node.lineno) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            parent = dotted(source).split(".")
            keep = len(parent) - node.level + (source.name == "__init__.py")
            base = ".".join([*parent[:keep], *([node.module] if node.module else [])]) if node.level else node.module
            found.extend((f"{base}.{alias.name}", node.lineno) for alias in node.names)
        for child in ast.iter_child_nodes(node):
            is_function = isinstance(child, (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda))
            is_type_checking = isinstance(child, ast.If) and "TYPE_CHECKING" in ast.unparse(child.test)
            if not is_type_checking and (lazy or not is_function):
                visit(child)

    visit(ast.parse(source.read_text(encoding="utf-8")))
    return found


def lines_of_code(text: str) -> int:
    """Lines with code on them; the strings that stand alone as statements are documentation."""
    documentation = {
        line
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
        for line in range(node.lineno, node.end_lineno + 1)
    }
    lines = (line.strip() for number, line in enumerate(text.splitlines(), 1) if number not in documentation)
    return sum(1 for line in lines if line and not line.startswith("#"))


def own(name: str) -> str | None:
    """The layer's name of an imported `varint.…`, None for other packages; `from varint import x` is `__init__`."""
    first, *rest = name.split(".")
    if first != "varint":
        return None
    return rest[0] if rest and rest[0] in RANK else "__init__"


def test_every_module_has_its_layer():
    assert {module_of(s) for s in SOURCES} <= set(RANK), "name the new module in LAYERS"


@pytest.mark.parametrize("source", SOURCES, ids=dotted)
def test_imports_point_downwards(source):
    here = module_of(source)
    upwards = [(name, line) for name, line in imports(source) if own(name) and RANK[own(name)] > RANK[here]]
    assert not upwards, f"{source.name} imports from above itself: {upwards}"


def test_no_module_imports_itself_in_a_circle():
    modules = {dotted(s): s for s in SOURCES}

    def targets(source: Path) -> set[str]:
        names = {n for n, _ in imports(source)}
        return {n if n in modules else n.rpartition(".")[0] for n in names} & set(modules)

    graph = {name: targets(source) - {"varint"} for name, source in modules.items()}
    done: set[str] = set()

    def walk(name: str, path: tuple[str, ...]):
        assert name not in path, f"circle of imports: {' -> '.join([*path[path.index(name) :], name])}"
        if name not in done:
            for target in sorted(graph[name]):
                walk(target, (*path, name))
            done.add(name)

    for name in graph:
        walk(name, ())


@pytest.mark.parametrize("source", SOURCES, ids=dotted)
def test_only_plot_and_animate_import_matplotlib(source):
    if module_of(source) not in DRAWING:
        assert not [line for name, line in imports(source, lazy=True) if name.startswith("matplotlib")]


@pytest.mark.parametrize("source", SOURCES, ids=dotted)
def test_drawing_is_imported_lazily(source):
    if module_of(source) not in DRAWING:
        assert not [(name, line) for name, line in imports(source) if own(name) in DRAWING]


@pytest.mark.parametrize("source", SOURCES, ids=dotted)
def test_modules_stay_short(source):
    lines = lines_of_code(source.read_text(encoding="utf-8"))
    assert lines <= LONGEST, f"{lines} lines of code: split it by reason to exist"


def test_documentation_does_not_count_as_code():
    assert (
        lines_of_code('"""One\nmore."""\n\nx = 1  # why\n# alone\ndef f():\n    """Doc."""\n    return "text"\n') == 3
    )


def test_what_runs_on_import_is_told_from_what_is_lazy(tmp_path, monkeypatch):
    package = tmp_path / "varint"
    (package / "stepping").mkdir(parents=True)
    source = package / "stepping" / "plan.py"
    source.write_text(
        "import casadi as ca\n"
        "from typing import TYPE_CHECKING\n"
        "from ..errors import InputError\n"
        "from .explicit import step\n"
        "if TYPE_CHECKING:\n    from varint.plot import draw\n"
        "try:\n    import scipy.linalg\nexcept ImportError:\n    pass\n"
        "def lazy():\n    from varint.plot import draw\n    import matplotlib.pyplot\n"
    )
    monkeypatch.setitem(globals(), "PACKAGE", package)
    top = [name for name, _ in imports(source)]
    assert top == [
        "casadi",
        "typing.TYPE_CHECKING",
        "varint.errors.InputError",
        "varint.stepping.explicit.step",
        "scipy.linalg",
    ]
    every = [name for name, _ in imports(source, lazy=True)]
    assert "matplotlib.pyplot" in every and every.count("varint.plot.draw") == 1
    assert [own(name) for name in top] == [None, None, "errors", "stepping", None]
    assert own("varint.simulate") == "__init__" and own("varint.plot.draw") == "plot"
