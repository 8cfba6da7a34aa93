"""What is built for a scene, and what Python's collector does meanwhile."""

import gc

import pytest

import varint as vi
from varint.scene.memory import per_scene


@pytest.fixture
def system():
    q, v = vi.coordinates("x")
    return vi.System(q, v, v**2 / 2 - q**4)


@pytest.mark.parametrize("enabled", (True, False))
def test_the_collector_rests_while_something_is_built_and_is_then_as_before(system, enabled):
    seen = []

    @per_scene
    def inner(system):
        seen.append(gc.isenabled())
        return 1

    @per_scene
    def outer(system):
        found = inner(system)
        seen.append(gc.isenabled())
        return found

    @per_scene
    def wrong(system):
        raise ValueError("not this one")

    was = gc.isenabled()
    try:
        (gc.enable if enabled else gc.disable)()
        assert outer(system) == 1
        assert seen == [False, False] and gc.isenabled() == enabled
        with pytest.raises(ValueError, match="not this one"):
            wrong(system)
        assert gc.isenabled() == enabled
    finally:
        (gc.enable if was else gc.disable)()
