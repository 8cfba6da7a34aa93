"""Nothing but time depends on the gear: when a run shifts up, what was compiled, what was run."""

import os
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor

import casadi as ca
import numpy as np
import pytest
from scenes import double_pendulum, henon_heiles

import varint as vi
from varint.codegen import cache
from varint.codegen.cache import compiler
from varint.codegen.gauss import gauss_source
from varint.codegen.kernel import run_loop
from varint.codegen.native import native_gauss
from varint.codegen.native_newton import native_newton
from varint.codegen.newton import newton_source
from varint.codegen.source import compiled
from varint.integration import compiled_loop, gears
from varint.integration.gears import BY_STAGES, gears_of, high_gear

pytestmark = pytest.mark.skipif(compiler() is None, reason="no C compiler")
RUN = {"h": 0.05, "steps": 6000, "save_every": 20}


def rods() -> vi.System:
    return vi.models.chain_rods(2).system


SCENES = {
    "separable": (henon_heiles, [0.1, 0.2], [0.3, 0.1], vi.gauss(8)),
    "full mass": (double_pendulum, [1.0, 0.4], [0.1, -0.2], vi.gauss(8)),
    "implicit": (double_pendulum, [1.0, 0.4], [0.1, -0.2], vi.lobatto(3)),
    "kicks": (henon_heiles, [0.1, 0.2], [0.3, 0.1], vi.composition("yoshida6")),
    "held": (rods, vi.models.chain_rods(2).q0, vi.models.chain_rods(2).v0, vi.lobatto(2)),
}


def wait_for(system: vi.System, rule: vi.Rule, scheme=BY_STAGES) -> None:
    found = gears_of(system, rule, scheme)
    for _ in range(600):
        gears.kernel_now(found)
        if high_gear(system, rule, scheme):
            return
        time.sleep(0.05)
    raise AssertionError("the compiler has not come to its end")


@pytest.mark.parametrize("scene", SCENES)
def test_a_run_that_shifts_up_on_its_way_has_the_bytes_of_all_others(
    scene, monkeypatch, tmp_path, forget
):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    make, q0, v0, rule = SCENES[scene]
    start = {"q0": q0, "v0": v0, **RUN, "h": 0.01}
    low = vi.simulate(make(), rule, **start, backend="native")
    high = vi.simulate(make(), rule, **start, backend="compiled")
    forget()  # else the new scene would begin in the high gear
    system, used = make(), []
    compiled_run, kernel_after = compiled_loop.compiled_run, gears.kernel_after

    def noted(kernel, *arguments, **options):
        used.append(kernel.is_native)
        return compiled_run(kernel, *arguments, **options)

    def patient(found, seconds, ahead):
        kernel_after(found, seconds, 1e9)
        wait_for(system, rule, found.scheme)
        return gears.kernel_now(found)

    monkeypatch.setattr(compiled_loop, "CAUTION", 1e-5)  # short first pieces
    monkeypatch.setattr(compiled_loop, "compiled_run", noted)
    monkeypatch.setattr(compiled_loop, "kernel_after", patient)
    shifted = vi.simulate(system, rule, **start)
    assert used[0] and not used[-1]
    for motion in (low, high):
        assert motion.q.tobytes() == shifted.q.tobytes()
        assert motion.p.tobytes() == shifted.p.tobytes()
        for name in ("iterations", "residual", "steps"):
            assert motion.stats[name] == shifted.stats[name]


def test_many_short_runs_shift_up_like_a_long_one(monkeypatch, tmp_path, forget):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(gears, "compiling_seconds", lambda system, rule: 0.01)
    system, rule = henon_heiles(), vi.gauss(6)
    start = {"q0": [0.1, 0.2], "v0": [0.3, 0.1], "h": 0.05, "steps": 200}
    first = vi.simulate(system, rule, **start)
    assert first.stats["backend"].startswith("native")
    while gears_of(system, rule, BY_STAGES).work is None:
        vi.simulate(system, rule, **start)
    wait_for(system, rule)
    last = vi.simulate(system, rule, **start)
    assert last.stats["backend"].startswith("compiled")
    assert first.q.tobytes() == last.q.tobytes()


@pytest.mark.parametrize(
    ("runs", "begins"),
    (
        ([(0.1, 0.0)] * 9, None),  # of the compiler's time: spent, and still ahead
        ([(0.4, 0.4)], None),  # over before the compiler would be
        ([(0.45, 0.45), *[(0.45, 0.0)] * 5], 4),  # many of these
        ([(0.01, 3.0)], 0),  # a long one, from its first piece on
        ([(0.4, 0.0), (0.01, 3.0)], 1),
    ),
)
def test_the_compiler_starts_where_it_ends_before_the_runs_do(
    runs, begins, monkeypatch, tmp_path, forget
):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    found = gears_of(henon_heiles(), vi.gauss(7), BY_STAGES)
    begun = []
    monkeypatch.setattr(gears, "begin_compilation", lambda *source: begun.append(source))
    whole = gears.compiling_seconds(found.system, found.rule) + gears.loop_seconds(found.system)
    for k, (spent, ahead) in enumerate(runs):
        assert gears.kernel_after(found, spent * whole, ahead * whole) is found.low
        assert bool(begun) == (begins is not None and k >= begins), k


@pytest.mark.parametrize("loop_is_there", (False, True))
def test_what_the_cache_holds_of_the_loop_makes_the_compiler_start_sooner(
    loop_is_there, monkeypatch, tmp_path, forget
):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    cache.library.cache_clear()
    system, rule = heavier(1.75), vi.gauss(5)
    if loop_is_there:
        compiled(gauss_source(heavier(1.25), rule))
    found = gears_of(system, rule, BY_STAGES)
    begun = []
    monkeypatch.setattr(gears, "begin_compilation", lambda *source: begun.append(source))
    ahead = gears.compiling_seconds(system, rule) * 2.1  # START, and a little
    gears.kernel_after(found, ahead, 0.0)
    assert bool(begun) == loop_is_there
    gears.kernel_after(found, 2 * gears.loop_seconds(system), 0.0)
    assert begun


def heavier(mass: float) -> vi.System:
    q, v = vi.coordinates("a", "b")
    kinetic = mass * v[0] ** 2 + v[1] ** 2 / 2 + v[0] * v[1] * ca.cos(q[0] - q[1])
    return vi.System(q, v, kinetic + 2 * mass * ca.cos(q[0]) + ca.cos(q[1]))


def spring(stiffness: float) -> vi.System:
    q, v = vi.coordinates("a", "b")
    return vi.System(q, v, ca.sumsqr(v) / 2 - stiffness * (q[1] - q[0]) ** 2 - q[0] ** 2)


def bead(weight: float) -> vi.System:
    q, v = vi.coordinates("x", "y")
    return vi.System(q, v, ca.sumsqr(v) / 2 - weight * q[1], constraint=ca.sumsqr(q) - 1)


def disc(weight: float) -> vi.System:
    """On an edge: it moves where it points to."""
    q, v = vi.coordinates("x", "y", "turned")
    kinetic = ca.sumsqr(v[:2]) / 2 + (1 + weight * q[0] ** 2) * v[2] ** 2 / 2
    across = ca.horzcat(ca.sin(q[2]), -ca.cos(q[2]), 0)
    return vi.System(q, v, kinetic - weight * q[1], nonholonomic=across)


LINKS = {"q0": [1.0, 0.4], "v0": [0.1, -0.2]}
OF_A_SIZE = {
    "stages": (gauss_source, heavier, vi.gauss(6), LINKS),
    "closed form": (newton_source, heavier, vi.midpoint(), LINKS),
    "band": (newton_source, heavier, vi.lobatto(3), LINKS),
    "loop over nodes": (newton_source, heavier, vi.gauss(4), LINKS),
    "map": (newton_source, spring, vi.lobatto(3), LINKS),
    "multipliers alone": (newton_source, bead, vi.lobatto(2), {"q0": [1.0, 0], "v0": [0, 0.3]}),
    "path and multipliers": (newton_source, bead, vi.lobatto(3), {"q0": [1.0, 0], "v0": [0, 0.3]}),
    "rolling": (newton_source, disc, vi.lobatto(2), {"q0": [0.1, 0.2, 0], "v0": [1.0, 0, 0.5]}),
}


@pytest.mark.parametrize("kind", OF_A_SIZE)
def test_a_new_scene_of_a_size_is_compiled_without_the_loop_around_it(kind, monkeypatch, tmp_path):
    """The loop's source is the same for both, and compiled with the first of them alone."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    cache.library.cache_clear()  # other tests have scenes of these sizes
    source_of, make, rule, start = OF_A_SIZE[kind]
    scenes = {weight: make(weight) for weight in (1.0, 1.5)}
    sources = [source_of(system, rule) for system in scenes.values()]
    assert sources[0].loop == sources[1].loop
    assert sources[0].text != sources[1].text
    for (weight, system), libraries in zip(scenes.items(), (2, 3), strict=True):
        kernel = compiled(source_of(system, rule))
        assert len(list((tmp_path / "varint").glob("*.so"))) == libraries, weight
        q0, c = np.array(start["q0"], float), system.default_vector
        p0 = ca.Function("p", [system.q, system.v], [system.momentum])(q0, start["v0"])
        runs = [
            run_loop(k, q0, np.array(p0).ravel(), c, t0=0.0, h=0.02, steps=500)
            for k in (kernel, natively(source_of, system, rule))
        ]
        assert all(run.done for run in runs)
        assert runs[0].rows.tobytes() == runs[1].rows.tobytes()


def natively(source_of, system: vi.System, rule: vi.Rule):
    return (native_gauss if source_of is gauss_source else native_newton)(system, rule)


def test_scene_and_loop_are_compiled_beside_a_run_one_after_the_other(
    monkeypatch, tmp_path, forget
):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    system, rule = heavier(1.25), vi.gauss(5)
    found = gears_of(system, rule, BY_STAGES)
    assert gears.kernel_after(found, 1e3, 1e3) is found.low
    wait_for(system, rule)
    assert found.begun == gauss_source(system, rule).texts
    assert not gears.kernel_now(found).is_native
    assert not found.stuck


def test_what_is_compiled_in_vain_is_not_missed(monkeypatch, tmp_path, forget):
    """A compiler that fails, a cache that is full: the run goes on as it began."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(gears, "compiling_seconds", lambda system, rule: 1e-6)
    monkeypatch.setattr(gears, "loop_seconds", lambda system: 0.0)
    system, rule = henon_heiles(), vi.gauss(5)
    start = {"q0": [0.1, 0.2], "v0": [0.3, 0.1], "h": 0.05, "steps": 3000}
    whole = vi.simulate(henon_heiles(), rule, **start, backend="native")

    def full(source, contraction):
        raise cache.CompileError("no room")

    monkeypatch.setattr(gears, "begin_compilation", full)
    motion = vi.simulate(system, rule, **start)
    assert gears_of(system, rule, BY_STAGES).stuck
    assert np.array_equal(motion.q, whole.q)


def test_what_was_begun_is_kept_and_what_fails_leaves_nothing(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    work = cache.begin_compilation("int run(void) { return 7; }\n")
    for _ in range(200):
        if cache.finished(work):
            break
        time.sleep(0.02)
    assert cache.in_cache("int run(void) { return 7; }\n")
    assert cache.library("int run(void) { return 7; }\n").run() == 7
    assert not work.place.exists()
    refused = cache.begin_compilation("this is no C\n")
    while not cache.finished(refused):
        time.sleep(0.02)
    assert not cache.in_cache("this is no C\n")


def test_what_a_compiler_has_made_is_taken_by_one_thread(tmp_path, monkeypatch):
    """All that ask find that it has come to its end."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(cache, "_store", lambda *_: time.sleep(0.05))  # others ask meanwhile
    work = cache.begin_compilation("int run(void) { return 8; }\n")
    work.process.wait()
    with ThreadPoolExecutor(4) as pool:
        assert all(pool.map(cache.finished, [work] * 8))
    assert not work.place.exists()


def test_only_few_compilers_are_at_work_at_once_and_none_outlives_its_process(tmp_path):
    script = (
        "from varint.codegen import cache\n"
        "loop = 'for (long i%d = 0; i%d < n; i%d++) n += i%d * n;'\n"
        "loops = ''.join(loop % (k, k, k, k) for k in range(3000))\n"
        "source = 'long f(long n) {' + loops + 'return n + %d;}'\n"
        "begun = [cache.begin_compilation(source % k) for k in range(4)]\n"
        "print([work is not None for work in begun], *(work.place for work in begun[:2]))\n"
    )
    room = {**os.environ, "XDG_CACHE_HOME": str(tmp_path / "cache"), "TMPDIR": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, env=room, check=True
    )
    assert done.stdout.startswith("[True, True, False, False]") and not done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["cache"]
