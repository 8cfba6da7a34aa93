"""Code that leaves: a two-link arm held by predictive control at 1 kHz, controller and plant in C.

Claim: `vi.export` writes the controller and a step of the arm as C99 that needs neither Python nor
CasADi, allocates nothing and bounds its iterations; the loop in C follows a set-point that jumps,
its motion is that of Python to round-off, and a plan takes a fraction of the millisecond.
Source: Murray, Li & Sastry, A Mathematical Introduction to Robotic Manipulation, 1994, §4.2;
Nocedal & Wright, Numerical Optimization, §18.1.
Run: python examples/two_link_arm_in_c.py [folder of the picture]; it needs a C compiler.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")
PERIOD, CALLS, JUMP = 1e-3, 3500, 700  # s; the set-point jumps at call 700
GOALS = np.array([[0.9, 0.6], [0.2, 1.4]])
LOOP = r"""
#define _POSIX_C_SOURCE 199309L
#include <stdio.h>
#include <time.h>
#include "arm.h"
#include "reach.h"
static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return 1e6 * (double)t.tv_sec + 1e-3 * (double)t.tv_nsec;
}
int main(void) {
    static double memory[REACH_MEMORY];
    double x[ARM_STATE], q[2] = {0.3, 0.8}, p[2] = {0}, v[2], u[2] = {0}, c[ARM_PARAMETERS], at[3];
    int k, i, status;
    for (i = 0; i < ARM_PARAMETERS; ++i) c[i] = reach_params[i];
    arm_start(q, p, u, c, 0, 1e-3, x);
    reach_start(memory);
    for (k = 0; k < CALLS; ++k) {
        for (i = 0; i < 2 && k == JUMP; ++i) c[ARM_PARAMETERS - 2 + i] = i ? 1.4 : 0.2;
        arm_velocity(x + ARM_Q, x + ARM_P, c, 0, v);
        at[0] = now();
        status = reach_step(memory, x + ARM_Q, v, 0, c, k % 25 == 0 && k, u, NULL);
        at[1] = now();
        status += arm_step(x, u, c, k * 1e-3, 1e-3, NULL);
        at[2] = now();
        printf("%.17g %.17g %.17g %.17g %d %g %g\n", x[ARM_Q], x[ARM_Q + 1], u[0], u[1], status,
            at[1] - at[0], at[2] - at[1]);
    }
    return 0;
}
"""


def arm_and_controller():
    """The arm with a set-point among its parameters, and a controller that looks 0.3 s ahead."""
    s, goal = vi.models.two_link_arm().system, ca.SX.sym("goal", 2)
    params = [(getattr(s.params, name), value) for name, value in s.defaults.items()]
    params += [(goal, GOALS[0])]
    arm = vi.System(s.q, s.v, s.lagrangian, force=s.force, control=s.control, params=params)
    off, limits = ca.sumsqr(arm.q - goal), [(-4, arm.control[0], 4), (-2, arm.control[1], 2)]
    cost = 40 * off + ca.sumsqr(arm.v) + 0.02 * ca.sumsqr(arm.control)
    end = 20 * off + 2 * ca.sumsqr(arm.v)
    phase = vi.Phase(arm, vi.gauss(1), 0.3, 12, cost, terminal_cost=end, bounds=limits)
    return arm, vi.mpc(phase)


def run_in_c(motion: vi.Trajectory, controller: vi.Controller, along: vi.Trajectory, folder: str):
    """Both as C, tested, and their closed loop."""
    vi.export(motion, folder, "arm")
    vi.export(controller, folder, "reach", along=along)
    (Path(folder) / "loop.c").write_text(LOOP)
    sizes = f"-DCALLS={CALLS} -DJUMP={JUMP}"
    strict = f"cc -std=c99 -Wall -Wextra -Werror -pedantic -O2 {sizes}".split()
    subprocess.run([*strict, "-c", *Path(folder).glob("*.c")], cwd=folder, check=True)
    for program, parts in (("arm_test", "arm"), ("reach_test", "reach"), ("loop", "arm reach")):
        objects = [f"{part}.o" for part in [program, *parts.split()]]
        subprocess.run([*strict, *objects, "-o", program, "-lm"], cwd=folder, check=True)
        done = subprocess.run([f"./{program}"], cwd=folder, check=True, capture_output=True)
        if program != "loop":
            print(done.stdout.decode().strip())
    return np.loadtxt(done.stdout.decode().splitlines())


def main(out: Path = Path("out")) -> None:
    arm, controller = arm_and_controller()
    first = vi.simulate(arm, vi.gauss(2), q0=[0.3, 0.8], v0=[0, 0], h=PERIOD, steps=50, u=[0.5, 0])
    along, _ = vi.closed_loop(controller, [0.3, 0.8], [0.0, 0.0], 20)
    with tempfile.TemporaryDirectory() as folder:
        table = run_in_c(first, controller, along, folder)
    q, u, status, plan, step = table[:, :2], table[:, 2:4], table[:, 4], table[:, 5], table[:, 6]
    again = vi.simulate(arm, vi.gauss(2), q0=[0.3, 0.8], v0=[0, 0], h=PERIOD, steps=CALLS, u=u)
    print(f"{int((status == 0).sum())} of {CALLS} calls with an answer; the first {plan[0]:.0f} µs")
    print(f"motion in C and in Python by the same torques: {np.abs(again.q[1:] - q).max():.1e} rad")
    print(f"elbow at the end   found {q[-1, 1]:.8f}   exact {GOALS[1, 1]:.8f}")
    for what, us in (("plan", plan[1:]), ("step", step)):
        print(f"{what}: mean {us.mean():.1f}, median {np.median(us):.1f}, worst {us.max():.1f} µs")

    figure, (angles, torques, times) = plt.subplots(1, 3, figsize=(14, 4), layout="constrained")
    t = PERIOD * np.arange(CALLS)
    angles.plot(t, q, label=["shoulder", "elbow"])
    angles.plot(t, GOALS[(t >= PERIOD * JUMP).astype(int)], "k:", lw=1)
    angles.set(xlabel="$t$ in s", title="Angles in rad, and their set-points (dotted)")
    torques.step(t, u, where="post", label=["shoulder", "elbow"])
    torques.set(xlabel="$t$ in s", title="Torques in N m, limits 4 and 2")
    times.semilogy(t, table[:, 5:], ".", ms=3, label=["plan", "step of the arm"])
    times.axhline(1e6 * PERIOD, color="k", lw=0.8, ls="--", label="the period")
    times.set(xlabel="$t$ in s", title="Processor time of a call in µs")
    for axes in figure.axes:
        axes.legend()
    out.mkdir(exist_ok=True)
    figure.savefig(out / "two_link_arm_in_c.png", dpi=150)


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:2]))
