"""Files damaged at random: whatever is wrong with them, they open or end in varint's own error."""

from __future__ import annotations

import json
import random
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from saved_files import parts_of, plain_run, put, saved
from scenes import double_pendulum, driven_damped, henon_heiles, rocking

import varint as vi

HARMLESS = (vi.VarintError,)  # what a bad file may raise


def with_contacts() -> vi.Trajectory:
    return vi.simulate(rocking(), q0=[1.0, 0.5, 1.2], v0=[1.5, 0, 0], h=0.01, steps=120)


def with_controls() -> vi.Trajectory:
    return vi.models.rest_to_rest(steps=4).solve()[0]


def with_a_time_scale() -> vi.Trajectory:
    q, v = vi.coordinates("x", "y")
    kepler = vi.System(q, v, ca.sumsqr(v) / 2 + 1 / ca.norm_2(q))
    return vi.simulate(
        kepler, q0=[1, 0], v0=[0, 0.8], h=0.05, steps=8, time_scale=ca.norm_2(q) ** 1.5
    )


def with_events() -> vi.Trajectory:
    system = double_pendulum()
    return vi.simulate(
        system, q0=[1, 0], v0=[0, 0], h=0.05, steps=40, events=dict(down=system.q[0])
    )


def driven() -> vi.Trajectory:
    n = driven_damped().structure.n
    return vi.simulate(driven_damped(), q0=np.ones(n) / 2, v0=np.zeros(n), h=0.05, steps=5)


MOTIONS = [plain_run, with_contacts, with_controls, with_a_time_scale, with_events, driven]
STRANGE = [
    None,
    -1,
    0,
    2**70,
    10**400,
    1.5,
    float("nan"),
    float("inf"),
    "",
    "x",
    "\ud800",
    "0x1p9999",
    [],
    [[]],
    {},
    {"a": 1},
    True,
    [1] * 3,
    "t",
]


def places_of(data, path=()) -> list[tuple]:
    """Where something stands in nested lists and dictionaries."""
    found = [path] if path else []
    children = (
        data.items()
        if isinstance(data, dict)
        else enumerate(data)
        if isinstance(data, list)
        else ()
    )
    for key, value in children:
        found += places_of(value, (*path, key))
    return found


def mutated(header: dict, moments: random.Random) -> dict:
    """The header with something replaced, removed or doubled somewhere."""
    header = json.loads(json.dumps(header))
    for _ in range(moments.randint(1, 2)):
        *way, last = moments.choice(places_of(header))
        at = header
        for key in way:
            at = at[key]
        kind = moments.random()
        if kind < 0.2:
            del at[last]
        elif kind < 0.3 and isinstance(at, list):
            at.insert(last, at[last])
        elif kind < 0.5 and isinstance(at[last], (int, float)):
            at[last] = at[last] + moments.choice([-1, 1, 7])
        else:
            at[last] = moments.choice(STRANGE)
    return header


def disturbed(arrays: dict, moments: random.Random) -> dict:
    """The arrays with one of them replaced or removed."""
    changed = dict(arrays)
    name = moments.choice(list(arrays))
    x = arrays[name]
    other = [
        None,
        x[..., None],
        x.ravel()[:1],
        x[:0],
        x.astype(np.int64 if x.dtype.kind == "f" else float),
        np.full_like(x, moments.choice([-1, 0, 10**6])),
        np.full(x.shape, np.nan),
        np.full(x.shape, 2**62),
        x.T,
        x.astype(np.float32),
        x.astype("S3"),
        np.zeros((0, 5)),
        np.array(3.0),
    ]
    change = moments.choice(other)
    if change is None:
        del changed[name]
    else:
        changed[name] = change
    return changed


def used(motion: vi.Trajectory) -> None:
    """What one does with a trajectory; the numbers may be anything."""
    with np.errstate(all="ignore"):
        _ = repr(motion), motion.parameters, motion.v, motion.energy


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("make", MOTIONS)
def test_headers_with_anything_in_them_open_or_are_refused(tmp_path, make):
    header, arrays = parts_of(saved(tmp_path, make()))
    moments, refused = random.Random(14), 0
    for _ in range(100):
        path = put(tmp_path / "a.npz", mutated(header, moments), arrays)
        try:
            used(vi.load(path))
        except HARMLESS:
            refused += 1
    assert 30 < refused < 100


@pytest.mark.parametrize(
    ("way", "strange"),
    [
        (("control", "timings", "build"), None),
        (("control", "timings", "solve"), "x"),
        (("control", "timings"), {}),
        (("stats", "error_estimate"), "x"),
    ],
)
def test_what_a_report_needs_is_there_or_the_file_is_refused(tmp_path, way, strange):
    header, arrays = parts_of(saved(tmp_path, with_controls()))
    at = header
    for key in way[:-1]:
        at = at[key]
    del at[way[-1]]
    if strange is not None:
        at[way[-1]] = strange
    with pytest.raises(vi.InputError, match="no whole file"):
        vi.load(put(tmp_path / "a.npz", header, arrays))


def test_a_control_of_other_steps_or_coordinates_is_refused(tmp_path):
    """Every array twice as long, or wide, or shorter: refused as the file is read, not when its
    report is asked for.
    """
    header, arrays = parts_of(saved(tmp_path, with_controls()))
    vi.load(put(tmp_path / "a.npz", header, arrays)).report()
    names = [name for name, x in arrays.items() if x.ndim and name != "c"]
    assert sum(name.startswith("control_") for name in names) >= 10
    for name in names:
        x = arrays[name]
        for other in (np.concatenate([x, x]), x[:-1], np.stack([x, x], axis=-1), x[..., :0]):
            with pytest.raises(vi.InputError, match="no whole file"):
                vi.load(put(tmp_path / "a.npz", header, {**arrays, name: other}))


def test_times_that_steps_do_not_reach_are_refused_between_nodes(tmp_path):
    """They would be looked for step by step."""
    q, v = vi.coordinates("theta")
    pendulum = vi.System(q, v, v**2 / 2 + ca.cos(q))
    motion = vi.simulate(pendulum, vi.gauss(2), q0=0.5, v0=0.0, h=0.1, steps=20, save_every=4)
    far = np.append(motion.t[:-1], 1e9)
    replace(motion, t=far).save(tmp_path / "far.npz")
    again = vi.load(tmp_path / "far.npz")
    assert again.at(0.35).q == pytest.approx(motion.at(0.35).q, rel=1e-5)
    with pytest.raises(vi.InputError, match="times do not fit its steps"):
        again.at(1e8)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("make", MOTIONS)
def test_arrays_with_anything_in_them_open_or_are_refused(tmp_path, make):
    header, arrays = parts_of(saved(tmp_path, make()))
    moments, refused = random.Random(15), 0
    for _ in range(80):
        try:
            used(vi.load(put(tmp_path / "a.npz", header, disturbed(arrays, moments))))
        except HARMLESS:
            refused += 1
    assert refused > 30


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("make", MOTIONS)
def test_files_with_turned_bits_and_torn_ends_open_or_are_refused(tmp_path, make):
    path = saved(tmp_path, make())
    whole, moments, refused = path.read_bytes(), random.Random(16), 0
    for i in range(200):
        broken = bytearray(whole)
        if i % 4:
            for _ in range(moments.randint(1, 3)):
                broken[moments.randrange(len(broken))] ^= 1 << moments.randrange(8)
        else:
            broken = broken[: moments.randrange(len(broken))]
        path.write_bytes(bytes(broken))
        try:
            used(vi.load(path))
        except HARMLESS:
            refused += 1
    assert refused > 100


@pytest.mark.filterwarnings("ignore")
def test_checkpoints_with_anything_in_them_are_refused_or_go_on(tmp_path):
    start = dict(q0=[1.0, 0.5, 1.2], v0=[1.5, 0, 0], h=0.01, steps=60)
    path = tmp_path / "run"
    vi.simulate(rocking(), checkpoint=path, **start)
    header, arrays = parts_of(path)
    whole, moments, refused = path.read_bytes(), random.Random(17), 0
    for i in range(80):
        if i % 2:
            put(path, mutated(header, moments), arrays)
        else:
            broken = bytearray(whole)
            broken[moments.randrange(len(broken))] ^= 1 << moments.randrange(8)
            path.write_bytes(bytes(broken))
        try:
            vi.simulate(rocking(), checkpoint=path, **start)
        except HARMLESS:
            refused += 1
    assert refused > 40


def follows_the_scene():
    model = vi.models.kepler(e=0.9)
    events = dict(node=model.system.q[1])
    return model.system, dict(q0=model.q0, v0=model.v0, duration=7.0, events=events)


def rubs():
    q, v = vi.coordinates("x")
    wall = dict(contact=q + 0.3, restitution=0.5)
    system = vi.System(q, v, v**2 / 2 - q**2 / 2, force=-0.1 * ca.sign(v), **wall)
    return system, dict(q0=1.0, v0=0.0, duration=4.0)


def touches():
    return rocking(), dict(q0=[1.0, 0.5, 1.2], v0=[1.5, 0, 0], duration=0.5, tol=1e-4)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("scene", [follows_the_scene, rubs, touches])
def test_whole_motions_with_anything_in_them_are_refused_or_come_back(tmp_path, scene):
    path, (system, start) = tmp_path / "run", scene()
    vi.simulate(system, **start, checkpoint=path)
    header, arrays = parts_of(path)
    whole, moments, refused = path.read_bytes(), random.Random(19), 0
    for i in range(120):
        if i % 3 == 0:
            put(path, mutated(header, moments), arrays)
        elif i % 3 == 1:
            put(path, header, disturbed(arrays, moments))
        else:
            broken = bytearray(whole)
            broken[moments.randrange(len(broken))] ^= 1 << moments.randrange(8)
            path.write_bytes(bytes(broken))
        try:
            used(vi.simulate(system, **start, checkpoint=path))
        except HARMLESS:
            refused += 1
    assert 60 < refused < 120


@pytest.mark.filterwarnings("ignore")
def test_ensembles_with_anything_in_their_files_are_refused_or_open(tmp_path):
    where = tmp_path / "kept"
    q0 = np.linspace(0, 0.2, 8).reshape(4, 2)
    vi.ensemble(henon_heiles(), q0=q0, v0=[0, 0], h=0.1, steps=6, store=where)
    files = sorted(where.iterdir())
    whole, moments, refused = {x: x.read_bytes() for x in files}, random.Random(18), 0
    header, arrays = parts_of(where / "ensemble.npz")
    for i in range(200):
        for x, content in whole.items():
            x.write_bytes(content)
        if i % 2:
            put(where / "ensemble.npz", mutated(header, moments), arrays)
        else:
            path = moments.choice(files)
            broken = bytearray(whole[path])
            broken[moments.randrange(len(broken))] ^= 1 << moments.randrange(8)
            path.write_bytes(bytes(broken))
        try:
            found = vi.load(where)
            _ = found.q, found.p, found[0], repr(found)
            with np.errstate(all="ignore"):
                _ = found.v
        except HARMLESS:
            refused += 1
    assert 60 < refused < 200
