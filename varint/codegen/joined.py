"""Blocks of a form that follow one another often, in an order of evaluation, as longer blocks."""

from __future__ import annotations

from collections import Counter
from itertools import pairwise

from varint.codegen.repeats import Block, Repeats

OFTEN = 4  # times that two blocks follow one another before they become one
LONGEST = 300  # operations of a block that is made of others
TURNS = 40  # and of one that is made of several of one form
GROWTH = 8  # operations more to write that two blocks in one are worth, each time they are met


def join(found: Repeats) -> None:
    """Make one block of two that follow one another often, the most frequent first, and then
    of all that follow one another and whose forms are met only once.
    """
    refused: set[tuple[int, int]] = set()
    while True:
        pairs = Counter(
            pair
            for pair, (a, b) in zip(pairwise(found.shapes), pairwise(found.order), strict=True)
            if pair not in refused and len(a) + len(b) <= (LONGEST if pair[0] != pair[1] else TURNS)
        )
        pair, count = max(pairs.items(), key=lambda item: item[::-1], default=((0, 0), 0))
        if count < OFTEN:
            return _gather(found)
        if not _replaced(found, pair):
            refused.add(pair)


def _replaced(found: Repeats, pair: tuple[int, int]) -> bool:
    """Make one block of this pair wherever the whole has a frequent form; False where that is
    nowhere, or there would be much more to write.
    """
    at, k = list[int](), 0
    while k + 1 < len(found.order):
        if (found.shapes[k], found.shapes[k + 1]) == pair:
            at.append(k)
            k += 1
        k += 1
    whole = {k: found.order[k] + found.order[k + 1] for k in at}
    shapes = {k: found.shape(block) for k, block in whole.items()}
    count = Counter(shapes.values())
    chosen = [k for k in at if count[shapes[k]] >= OFTEN]
    more = len(whole[at[0]]) * len({shapes[k] for k in chosen})
    for n, shape in enumerate(pair):
        if found.shapes.count(shape) == len(chosen):
            more -= len(found.order[at[0] + n])
    if more > GROWTH * len(chosen):
        return False
    for k in reversed(chosen):
        found.order[k : k + 2] = [whole[k]]
        found.shapes[k : k + 2] = [shapes[k]]
    return bool(chosen)


def _gather(found: Repeats) -> None:
    often, order = Counter(found.shapes), list[Block]()
    alone = False
    for block, shape in zip(found.order, found.shapes, strict=True):
        if alone and often[shape] == 1 and len(order[-1]) + len(block) <= LONGEST:
            order[-1] += block
        else:
            order.append(block)
        alone = often[shape] == 1
    found.order, found.shapes = order, [found.shape(block) for block in order]
