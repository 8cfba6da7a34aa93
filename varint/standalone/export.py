"""The verb: a step or a controller as C99 that stands alone, with its own test."""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path
from typing import IO, Any

from varint.control.controller import Controller
from varint.errors import InputError, parsed_or_refused
from varint.numerics.files import write_atomically
from varint.numerics.limits import STEP_ITERATIONS
from varint.results.trajectory import Trajectory
from varint.scene.inputs import positive_integer
from varint.standalone.controller import controller_files
from varint.standalone.step import step_files

PLANS = 10  # quadratic programs of one call of a controller, at most
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9]*(_[A-Za-z0-9]+)*")  # what CasADi, too, calls functions by


def export(
    what: Trajectory | Controller,
    folder: Any,
    name: str,
    *,
    along: Trajectory | None = None,
    iterations: int | None = None,
) -> tuple[Path, Path, Path]:
    """The step that made a motion, or a predictive controller, as C99 that needs nothing but
    ``<math.h>``.

    (q0, p0) → (q1, p1) by p0 = −D1 L_d, p1 = D2 L_d, as `simulate` steps; or (q, v) → u, the first
    controls of the plan that `Controller` makes. The header says how the functions are called, and
    how many iterations a call takes at worst. Nothing is allocated.

    Parameters
    ----------
    what : Trajectory or Controller
        A motion of equal steps, as `simulate` gives it with `h` or `steps`: scene, rule, parameter
        values and controls are its own. Or what `mpc` gives.
    folder : str or Path
        Where the files go; made if it is not there.
    name : str
        What the files and all that they define begin with, such as ``"pendulum"``.
    along : Trajectory, optional
        For a controller, and needed there: the motion whose states its test is made with, such as
        that of `closed_loop`.
    iterations : int, optional
        How many iterations a call takes at worst: of Newton's method in a step (30), of quadratic
        programs in a controller (10). The header's ``#define`` may be set by the compiler instead.

    Returns
    -------
    tuple of Path
        ``<name>.h``, ``<name>.c``, and ``<name>_test.c``: a program that compares the C with
        Python, along the motion, and returns 0 if they agree to round-off.

    Raises
    ------
    InputError
        If the motion has contacts or steps that differ, the scene of a controller constraints, or
        the name is none in C.

    Notes
    -----
    ``cc -std=c99 -O2 pendulum.c pendulum_test.c -lm`` compiles the test; strict compilers have
    nothing to warn of. A step is the same sequence of operations as that of
    ``simulate(..., backend="interpreted")``: explicit, linear, Newton's method, SHAKE and RATTLE,
    or Newton's method with multipliers, whatever `plan` says. For a controller see
    `Controller.source`.

    Examples
    --------
    >>> import tempfile
    >>> import casadi as ca
    >>> import varint as vi
    >>> q, v = vi.coordinates("theta")
    >>> pendulum = vi.System(q, v, v**2 / 2 + 9.81 * ca.cos(q))
    >>> motion = vi.simulate(pendulum, vi.gauss(2), q0=1.0, v0=0.0, h=0.01, steps=100)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     files = vi.export(motion, folder, "pendulum")
    ...     [path.name for path in files]
    ['pendulum.h', 'pendulum.c', 'pendulum_test.c']
    """
    if not isinstance(name, str) or not _NAME.fullmatch(name):
        raise InputError(
            f"name must begin what is defined in C, letters and digits with single underscores "
            f"between them such as 'two_link_arm', got {name!r}"
        )
    most = None if iterations is None else positive_integer("iterations", iterations)
    target = parsed_or_refused(
        lambda: Path(folder), lambda: f"export takes the path of a folder, got {folder!r}"
    )
    if target.exists() and not target.is_dir():
        raise InputError(f"export takes a folder, and {str(folder)!r} is a file")
    if isinstance(what, Controller):
        if not isinstance(along, Trajectory):
            raise InputError(
                "export of a controller takes along=, a motion whose states its test is made with; "
                "closed_loop(controller, q0, v0, steps) gives one"
            )
        files = controller_files(what, name, along, most or PLANS)
    elif isinstance(what, Trajectory):
        if along is not None:
            raise InputError(
                "along= is for controllers; a step is tested with the motion that it made"
            )
        files = step_files(what, name, most or STEP_ITERATIONS)
    else:
        raise InputError(
            f"export takes a motion or a controller, got {type(what).__name__}; a motion says "
            "which step: simulate(system, rule, q0=…, v0=…, h=…, steps=…)"
        )
    try:
        target.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot make the folder {target}: {error.strerror or error}") from None
    paths = (target / f"{name}.h", target / f"{name}.c", target / f"{name}_test.c")
    for path, text in zip(paths, files, strict=True):
        write_atomically(path, partial(_write, text))
    return paths


def _write(text: str, file: IO[bytes]) -> None:
    file.write(text.encode())
