"""The folders are the architecture: imports point downwards, wherever they stand, and make no
circle.
"""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[2] / "varint"
SOURCES = sorted(PACKAGE.rglob("*.py"))

# From the ground up, one folder a floor (or one file that lies loose). A module imports from lower
# floors and from its own, without a circle. CONTRIBUTING.md says in a line what each is for.
FLOORS = (
    "errors",
    "numerics",
    "notation",
    "rules",
    "scene",
    "discrete",
    "symmetry",
    "typeset",
    "results",
    "drawing",
    "nlp",
    "codegen",
    "integration",
    "boundary",
    "control",
    "standalone",
    "ensembles",
    "diagnostics",
    "sensitivities",
    "estimation",
    "orbits",
    "multibody",
    "models",
    "explorer",
    "course",
    "load",
    "__init__",
    "command_line",
    "__main__",
)
# A scene and a trajectory are data; what these methods of theirs do stands in modules above them.
# Nothing else may import upwards.
BEHIND = {
    "varint.scene.system": {"varint.typeset.equations"},
    "varint.results.trajectory": {
        "varint.results.dense_output",
        "varint.results.fictitious_action",
        "varint.results.leaning",
        "varint.results.save",
        "varint.drawing.sketch",
        "varint.drawing.figures",
        "varint.drawing.animation",
        "varint.drawing.notebook",
        "varint.diagnostics.momentum",
        "varint.diagnostics.second_variation",
        "varint.sensitivities.tangents",
    },
}
LONGEST = 250  # lines of code: without blank lines, comments and docstrings


def dotted(source: Path) -> str:
    """`varint.integration.plan` of `integration/plan.py`; a package's `__init__` is the package."""
    parts = ["varint", *source.relative_to(PACKAGE).with_suffix("").parts]
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def floor(module: str) -> int:
    """The floor of `varint.integration.plan`: that of its folder."""
    _, *rest = module.split(".")
    return FLOORS.index(rest[0] if rest else "__init__")


def imports(source: Path, *, types: bool = True, functions: bool = True) -> list[tuple[str, int]]:
    """(absolute name imported, line) of every import in a file.

    `types`: those for type checkers alone, too; `functions`: those in functions, too.
    """
    found: list[tuple[str, int]] = []

    def visit(node: ast.AST):
        if isinstance(node, ast.Import):
            found.extend((alias.name, node.lineno) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            parent = dotted(source).split(".")
            keep = len(parent) - node.level + (source.name == "__init__.py")
            base = (
                ".".join([*parent[:keep], *([node.module] if node.module else [])])
                if node.level
                else node.module
            )
            found.extend((f"{base}.{alias.name}", node.lineno) for alias in node.names)
        for child in ast.iter_child_nodes(node):
            is_function = isinstance(child, (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda))
            is_type_checking = isinstance(child, ast.If) and "TYPE_CHECKING" in ast.unparse(
                child.test
            )
            if (types or not is_type_checking) and (functions or not is_function):
                visit(child)

    visit(ast.parse(source.read_text(encoding="utf-8")))
    return found


def targets(source: Path, modules: set[str]) -> dict[str, int]:
    """The modules of varint that a file imports, and a line where it does; those behind a façade
    excepted.
    """
    here, found = dotted(source), {}
    for name, line in imports(source):
        if name.split(".")[0] == "varint":
            module = name if name in modules else name.rpartition(".")[0]
            if module not in BEHIND.get(here, ()):
                found[module] = line
    return found


def upwards(sources: list[Path]) -> list[str]:
    """Imports of higher floors, in functions and for type checkers included."""
    modules = {dotted(source) for source in sources}
    return [
        f"{dotted(source)}:{line} imports {module} from above itself"
        for source in sources
        for module, line in targets(source, modules).items()
        if floor(module) > floor(dotted(source))
    ]


def circles(sources: list[Path]) -> list[str]:
    """Circles of imports between files, in functions and for type checkers included."""
    modules = {dotted(source) for source in sources}
    graph = {dotted(source): set(targets(source, modules)) & modules for source in sources}
    done: set[str] = set()
    found: list[str] = []

    def walk(name: str, path: tuple[str, ...]):
        if name in path:
            found.append(" -> ".join([*path[path.index(name) :], name]))
        elif name not in done:
            for target in sorted(graph[name] - {name}):
                walk(target, (*path, name))
            done.add(name)

    for name in graph:
        walk(name, ())
    return found


def lines_of_code(text: str) -> int:
    """Lines with code on them; the strings that stand alone as statements are documentation."""
    documentation = {
        line
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
        for line in range(node.lineno, node.end_lineno + 1)
    }
    lines = (
        line.strip()
        for number, line in enumerate(text.splitlines(), 1)
        if number not in documentation
    )
    return sum(1 for line in lines if line and not line.startswith("#"))


def test_every_folder_is_a_floor_and_few_files_lie_loose():
    folders = {
        path.name for path in PACKAGE.iterdir() if path.is_dir() and path.name != "__pycache__"
    }
    loose = {path.name for path in PACKAGE.iterdir() if path.is_file()}
    assert folders | {name.removesuffix(".py") for name in loose} - {"py.typed"} == set(FLOORS)
    assert loose == {"__init__.py", "__main__.py", "errors.py", "load.py", "py.typed"}


def test_imports_point_downwards():
    assert not upwards(SOURCES)


def test_there_is_no_circle_of_imports():
    assert not circles(SOURCES)


@pytest.mark.parametrize("name", BEHIND)
def test_a_facade_hides_nothing_that_it_does_not_use(name):
    """A whitelist that is longer than what it allows would let new imports slip through."""
    modules = {dotted(source) for source in SOURCES}
    [facade] = [source for source in SOURCES if dotted(source) == name]
    used = {name if name in modules else name.rpartition(".")[0] for name, _ in imports(facade)}
    assert used >= BEHIND[name]


@pytest.mark.parametrize("source", SOURCES, ids=dotted)
def test_only_drawing_imports_matplotlib_and_only_when_a_figure_is_wanted(source):
    at_once = [
        name
        for name, _ in imports(source, types=False, functions=False)
        if name.startswith("matplotlib")
    ]
    ever = [name for name, _ in imports(source, types=False) if name.startswith("matplotlib")]
    assert not at_once and (not ever or dotted(source).startswith("varint.drawing."))


@pytest.mark.parametrize("source", SOURCES, ids=dotted)
def test_modules_stay_short(source):
    lines = lines_of_code(source.read_text(encoding="utf-8"))
    assert lines <= LONGEST, f"{lines} lines of code: split it by reason to exist"


def test_documentation_does_not_count_as_code():
    text = '"""One\nmore."""\n\nx = 1  # why\n# alone\ndef f():\n    """Doc."""\n    return 1\n'
    assert lines_of_code(text) == 3


def house(folder: Path, monkeypatch, **files: str) -> list[Path]:
    """A small package, files named like `scene__system`."""
    package = folder / "varint"
    monkeypatch.setitem(globals(), "PACKAGE", package)
    for name, text in files.items():
        path = package / f"{name.replace('__', '/')}.py"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return sorted(package.rglob("*.py"))


@pytest.mark.parametrize(
    "text",
    [
        "from varint.integration.plan import plan\n",
        "def late():\n    from varint.integration.plan import plan\n",
        "class A:\n    def late(self):\n        from ..integration import plan\n",
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from varint.integration.plan "
        "import Plan\n",
        "late = lambda: __import__('x')\ndef f():\n    def g():\n        import "
        "varint.integration.plan\n",
    ],
)
def test_an_import_that_goes_up_is_found_wherever_it_stands(tmp_path, monkeypatch, text):
    files = dict(scene__system=text, integration__plan="plan = 1\n")
    [complaint] = upwards(house(tmp_path, monkeypatch, **files))
    assert complaint.startswith("varint.scene.system:") and "varint.integration.plan" in complaint
    down = dict(
        scene__system="x = 1\n",
        integration__plan="def f():\n    from varint.scene.system import x\n",
    )
    assert not upwards(house(tmp_path / "down", monkeypatch, **down))


def test_a_circle_through_functions_is_found(tmp_path, monkeypatch):
    files = dict(
        scene__a="from varint.scene.b import y\n",
        scene__b="def f():\n    from varint.scene.c import z\n",
        scene__c=(
            "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from varint.scene.a import "
            "x\n"
        ),
    )
    [circle] = circles(house(tmp_path, monkeypatch, **files))
    assert circle == "varint.scene.a -> varint.scene.b -> varint.scene.c -> varint.scene.a"


def test_the_facade_alone_may_look_up_and_only_where_the_list_says(tmp_path, monkeypatch):
    text = "class Trajectory:\n    def plot(self):\n        from varint.{} import draw\n"
    files = dict(drawing__figures="draw = 1\n", drawing__other="draw = 1\n")
    allowed = files | dict(results__trajectory=text.format("drawing.figures"))
    assert not upwards(house(tmp_path / "allowed", monkeypatch, **allowed))
    other = files | dict(results__trajectory=text.format("drawing.other"))
    assert upwards(house(tmp_path / "other", monkeypatch, **other))
    elsewhere = files | dict(results__records=text.format("drawing.figures"))
    assert upwards(house(tmp_path / "elsewhere", monkeypatch, **elsewhere))
