"""What is built for a scene is built once, and kept as long as the scene lives."""

from __future__ import annotations

import gc
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from typing import Any, TypeVar

from varint.scene.alike import first_alike

Built = TypeVar("Built")
_MISSING: Any = object()
_BUILDING = threading.RLock()


def per_system(build: Callable[..., Built]) -> Callable[..., Built]:
    """Remember what `build(system, *key)` returns as long as the system lives; several threads
    build it once.
    """

    return _remembering(build, "_built", lambda system: system)


def per_scene(build: Callable[..., Built]) -> Callable[..., Built]:
    """`per_system` of what holds none of the system's symbols: built once for all systems that are
    made alike, whatever the values of their parameters.
    """
    return _remembering(build, "_built_for_alike", first_alike)


def lately(known: dict[Any, Built], key: Any, build: Callable[[], Built], most: int) -> Built:
    """What `build` returns, and returned for so many keys before; when they are more, all are
    forgotten.
    """
    found = known.get(key, _MISSING)
    if found is _MISSING:
        found = build()
        if len(known) >= most:
            known.clear()
        known[key] = found
    return found


def _remembering(
    build: Callable[..., Built], place: str, whose: Callable[[Any], Any]
) -> Callable[..., Built]:
    """`build`, whose results lie at a place of the system that they are built for."""

    @wraps(build)
    def remembered(system: Any, *key: Any) -> Built:
        name = (build, *key)
        known = system.__dict__.get(place)
        if known is not None:  # of a short run's time this is no small part
            try:
                return known[name]
            except KeyError:
                pass  # it is built below
        owner = whose(system)
        store = owner.__dict__.setdefault(place, {})
        system.__dict__[place] = store
        if name not in store:
            with _BUILDING, _nothing_collected():
                if name not in store:
                    store[name] = build(owner, *key)
        return store[name]

    return remembered


@contextmanager
def _nothing_collected() -> Iterator[None]:
    """Python does not look for cycles to free meanwhile: many thousands of operations are made here
    that are kept, and looking through all that there is again and again takes a fifth of the time.
    """
    if not gc.isenabled():
        yield
        return
    gc.disable()
    try:
        yield
    finally:
        gc.enable()
