"""Every ready control problem: cost beside its reference, a strip of pictures, and a film.

Claim: double integrator, cart-pole, pendulum, acrobot, crane, brachistochrone, minimum time, low
thrust, robot, closed chains, walk, falling cat and hovercraft all reach their reference costs, and
the simulation repeats every motion.
Source: references of each model (`models.control_catalogue`); costs without one by collocation in
(q, v).
Run: python examples/control_films.py [folder of the pictures and films]
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")
SHOWN = 9  # pictures of a strip
SECONDS, RATE = 2.0, 10  # of a film, and its frames a second


def places(motion: vi.Trajectory, sketch: vi.Sketch) -> dict[str, np.ndarray]:
    """Where the points of a sketch are at every node, (N + 1, 2)."""
    return {name: motion.value(where) for name, where in sketch.points.items()}


def draw(axes, legs: list[vi.Trajectory], sketch: vi.Sketch) -> None:
    """Rods and points at a few times, light to dark, and the traces."""
    for leg in legs:
        at, fine = (places(x, sketch) for x in (leg, leg.at(np.linspace(leg.t[0], leg.t[-1], 200))))
        for name in sketch.traces:
            axes.plot(*fine[name].T, lw=0.8, color="C1")
        for k in np.linspace(0, len(leg) - 1, SHOWN).astype(int):
            shade = plt.get_cmap("Blues")(0.3 + 0.7 * k / (len(leg) - 1))
            for a, b in sketch.rods:
                axes.plot(*np.array([at[a][k], at[b][k]]).T, "-", color=shade, lw=1.5)
            for name in sketch.marks:
                axes.plot(*at[name][k], "o", color=shade, ms=3)


def main(out: Path = Path("out")) -> None:
    films = out / "films"
    films.mkdir(parents=True, exist_ok=True)
    catalogue = vi.models.control_catalogue
    figure, grid = plt.subplots(3, 5, figsize=(17, 10), layout="constrained")
    for axes, (name, factory) in zip(grid.ravel(), catalogue.items(), strict=True):
        model = factory()
        legs = model.solve()
        sketch, cost = vi.models.sketch(model), legs[0].solution.total_cost
        draw(axes, legs, sketch)
        again = [leg.replay() for leg in legs]
        defect = max(np.abs(a.q - b.q).max() for a, b in zip(legs, again, strict=True))
        word = "no reference" if model.cost is None else f"exact {model.cost:.9g}"
        print(f"{name:22} found {cost:.9g}   {word}   replay {defect:.0e}")
        axes.set(
            aspect="equal", xlabel="x", ylabel="y", title=f"{name.replace('_', ' ')}: {cost:.6g}"
        )
        for i, leg in enumerate(legs):
            speed = leg.duration / SECONDS * len(legs)
            file = films / (f"{name}_{i + 1}.gif" if len(legs) > 1 else f"{name}.gif")
            leg.animate(file, sketch=sketch, speed=speed, fps=RATE)
    figure.savefig(out / "control_films.png", dpi=100)
    print(f"{len(list(films.glob('*.gif')))} films in {films}")


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))
