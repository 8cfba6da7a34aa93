"""A solver watched while it runs: a progress bar, and Ctrl-C as a request to stop."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import casadi as ca
import numpy as np

from varint.numerics.progress import Move, progress_bar

NEAR = 1e-4  # in the solver's units: rows violated by less will be met
PROGRESS = 0.9  # of the least violation so far: the rows come closer


class Watch(ca.Callback):
    """Called by the solver after each iteration: shows progress, stops on Ctrl-C, and when the
    rows come no closer for more iterations than it has patience.
    """

    def __init__(self, unknowns: int, rows: int, data: int):
        ca.Callback.__init__(self)
        self.sizes = dict(x=unknowns, f=1, g=rows, lam_x=unknowns, lam_g=rows, lam_p=data)
        self.stop = False
        self.move: Move | None = None
        self.patience, self.least, self.waited = np.inf, np.inf, 0
        self.g_low = self.g_high = np.zeros(rows)
        self.factor = 1.0
        self.construct("watch", {})

    def get_n_in(self):
        return ca.nlpsol_n_out()

    def get_n_out(self):
        return 1

    def get_name_in(self, i):
        return ca.nlpsol_out(i)

    def get_name_out(self, i):
        return "stop"

    def get_sparsity_in(self, i):
        return ca.Sparsity.dense(self.sizes[ca.nlpsol_out(i)], 1)

    def eval(self, arg):
        if self.move is None and not np.isfinite(self.patience):
            return [int(self.stop)]
        g = arg[2].full().ravel()
        off = max(np.max(self.g_low - g, initial=0.0), np.max(g - self.g_high, initial=0.0))
        progress = off <= NEAR or off <= PROGRESS * self.least
        self.least, self.waited = min(self.least, off), 0 if progress else self.waited + 1
        if self.move is not None:
            self.move(1, lambda: f"cost {float(arg[1]) / self.factor:.8g}, violation {off:.1e}")
        return [int(self.stop or self.gave_up)]

    @property
    def gave_up(self) -> bool:
        """Has the violation of the rows not fallen for longer than the watch is patient?"""
        return self.waited > self.patience

    @contextmanager
    def running(self, progress: bool | None, called: bool) -> Iterator[None]:
        """While a solver runs that calls the watch: a progress bar, and Ctrl-C as a request to stop
        after the iteration.
        """
        self.stop, self.least, self.waited = False, np.inf, 0
        with progress_bar(None, "iteration", progress if called else False) as self.move:
            stops = called and threading.current_thread() is threading.main_thread()
            previous = signal.signal(signal.SIGINT, self._ask) if stops else None
            try:
                yield
            finally:
                if stops:
                    signal.signal(signal.SIGINT, previous)
                self.move = None

    def _ask(self, *_: Any) -> None:
        self.stop = True
