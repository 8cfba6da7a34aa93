"""Between states of two bodies and the elements of their orbit, of all conics but parabolas."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from varint.errors import InputError, parsed_or_refused
from varint.orbits.anomalies import eccentric_anomaly, hyperbolic_anomaly

TURN = 2 * np.pi


class KeplerElements(NamedTuple):
    """Elements of orbits, arrays of one shape; angles in radians.

    Attributes
    ----------
    a : ndarray
        Semi-major axis, negative for hyperbolas.
    e : ndarray
        Eccentricity.
    inclination : ndarray
        0 … π, to the plane z = 0.
    node : ndarray
        Longitude of the ascending node Ω, 0 … 2π; 0 where the orbit lies in that plane.
    pericentre : ndarray
        Argument of the pericentre ω, 0 … 2π, from the node.
    mean_anomaly : ndarray
        M, 0 … 2π for ellipses.
    """

    a: np.ndarray
    e: np.ndarray
    inclination: np.ndarray
    node: np.ndarray
    pericentre: np.ndarray
    mean_anomaly: np.ndarray


def kepler_elements(r: Any, v: Any, mu: Any) -> KeplerElements:
    """Elements of the orbits that two bodies would go on with alone: r'' = −μ r/|r|³.

    1/a = 2/r − v²/μ, e cos E = 1 − r/a, e sin E = r·v/√(μ a), M = E − e sin E, and ω is the angle
    from the node to r less the true anomaly.

    Parameters
    ----------
    r, v : array (…, 2) or (…, 3)
        Position and velocity relative to the centre.
    mu : array (…) or float
        G (m₁ + m₂) > 0.

    Returns
    -------
    KeplerElements
        Also where the orbit is a circle or lies in the plane z = 0, where angles that are not
        determined are such that their sum is.

    Raises
    ------
    InputError
        If shapes do not fit, r or r × v is zero (a fall along a line has no orbital plane), or the
        orbit is a parabola to round-off.

    References
    ----------
    Murray & Dermott, Solar System Dynamics, 1999, §2.8.

    Examples
    --------
    >>> import numpy as np
    >>> import varint as vi
    >>> one = vi.orbits.kepler_elements([1.0, 0.0, 0.0], [0.0, 1.1, 0.3], 1.0)
    >>> r, v = vi.orbits.kepler_state(*one, mu=1.0)
    >>> bool(np.allclose(r, [1, 0, 0], atol=1e-15) and np.allclose(v, [0, 1.1, 0.3], atol=1e-15))
    True
    """
    r, v, mu = _spatial("r", r), _spatial("v", v), np.asarray(mu, dtype=float)
    if r.shape != v.shape:
        raise InputError(f"r and v must have one shape, got {r.shape} and {v.shape}")
    if not (mu > 0).all():
        raise InputError(f"mu must be positive, got {mu.min():g}")
    distance, along = np.linalg.norm(r, axis=-1), (r * v).sum(axis=-1)
    momentum = np.cross(r, v)
    size = np.linalg.norm(momentum, axis=-1)
    if not (size > 0).all():
        raise InputError(
            "r × v is zero: a fall along a line, or a body at the centre, has no orbital plane"
        )
    alpha = 2 / distance - (v**2).sum(axis=-1) / mu  # 1/a
    if (np.abs(alpha * distance) < 1e-14).any():
        raise InputError("an orbit is a parabola to round-off, which has no semi-major axis")
    a = 1 / alpha
    bound = a > 0
    root = np.sqrt(mu * np.abs(a))
    e_cos, e_sin = 1 - distance / a, along / root  # of E; of cosh and sinh F for hyperbolas
    e = np.where(bound, np.hypot(e_cos, e_sin), np.sqrt(1 + np.where(bound, 0, size / root) ** 2))
    E = np.arctan2(e_sin, e_cos)
    F = np.arcsinh(np.where(bound, 0.0, e_sin / e))
    mean = np.where(bound, np.mod(E - e_sin, TURN), e_sin - F)
    # e and the true anomaly as ellipses have them: what a small e leaves open, E and it share
    f_bound = np.arctan2(size / root * np.sin(E), np.cos(E) - e)
    f_open = np.arctan2(size * along / mu, size**2 / mu - distance)
    x, y, z = np.moveaxis(momentum, -1, 0)
    flat = np.hypot(x, y)
    node = np.where(flat > 0, np.arctan2(x, -y), 0.0)
    towards = np.stack([np.cos(node), np.sin(node), np.zeros_like(node)], axis=-1)
    across = np.cross(momentum / size[..., None], towards)
    latitude = np.arctan2((r * across).sum(axis=-1), (r * towards).sum(axis=-1))
    pericentre = np.mod(latitude - np.where(bound, f_bound, f_open), TURN)
    return KeplerElements(a, e, np.arctan2(flat, z), np.mod(node, TURN), pericentre, mean)


def kepler_state(
    a: Any,
    e: Any,
    inclination: Any = 0.0,
    node: Any = 0.0,
    pericentre: Any = 0.0,
    mean_anomaly: Any = 0.0,
    *,
    mu: Any,
) -> tuple[np.ndarray, np.ndarray]:
    """Position and velocity relative to the centre, from the elements of an orbit.

    Parameters
    ----------
    a, e, inclination, node, pericentre, mean_anomaly : array (…) or float
        As in `KeplerElements`: a < 0 and e > 1 for hyperbolas.
    mu : array (…) or float
        G (m₁ + m₂) > 0.

    Returns
    -------
    r, v : ndarray (…, 3)

    Raises
    ------
    InputError
        If an ellipse has e outside 0 … 1, a hyperbola e ≤ 1, or mu is not positive.

    Examples
    --------
    >>> import varint as vi
    >>> r, v = vi.orbits.kepler_state(1.0, 0.5, mu=1.0)
    >>> r.round(12), abs(v).round(12)
    (array([0.5, 0. , 0. ]), array([0.        , 1.73205081, 0.        ]))
    """
    given = (a, e, inclination, node, pericentre, mean_anomaly, mu)
    a, e, inclination, node, pericentre, mean, mu = (
        np.asarray(x, dtype=float)
        for x in parsed_or_refused(
            lambda: np.broadcast_arrays(*given),
            lambda: "elements must be numbers or arrays of shapes that fit together",
        )
    )
    bound = a > 0
    if not (np.where(bound, (e >= 0) & (e < 1), (e > 1) & (a < 0)) & (mu > 0)).all():
        raise InputError("ellipses have a > 0 and 0 ≤ e < 1, hyperbolas a < 0 and e > 1; mu > 0")
    E = eccentric_anomaly(np.where(bound, mean, 0.0), np.where(bound, e, 0.0))
    F = hyperbolic_anomaly(np.where(bound, 0.0, mean), np.where(bound, 2.0, e))
    cos, sin = np.where(bound, np.cos(E), np.cosh(F)), np.where(bound, np.sin(E), np.sinh(F))
    minor = np.abs(a) * np.sqrt(np.abs((1 - e) * (1 + e)))
    x, y = a * (cos - e), minor * sin
    distance = np.abs(a) * np.abs(1 - e * cos)
    rate = np.sqrt(mu * np.abs(a)) / (np.abs(a) * distance)  # of E or F, in time
    vx, vy = -np.abs(a) * sin * rate, minor * cos * rate
    (cw, sw), (ci, si), (cn, sn) = ((np.cos(x), np.sin(x)) for x in (pericentre, inclination, node))
    first = np.stack([cw * cn - sw * ci * sn, cw * sn + sw * ci * cn, sw * si], axis=-1)
    second = np.stack([-sw * cn - cw * ci * sn, -sw * sn + cw * ci * cn, cw * si], axis=-1)
    place = x[..., None] * first + y[..., None] * second
    return place, vx[..., None] * first + vy[..., None] * second


def _spatial(what: str, x: Any) -> np.ndarray:
    found = parsed_or_refused(
        lambda: np.asarray(x, dtype=float), lambda: f"{what} must be numbers (…, 3), got {x!r}"
    )
    if found.ndim == 0 or found.shape[-1] not in (2, 3) or not np.isfinite(found).all():
        raise InputError(f"{what} must be finite numbers (…, 2) or (…, 3), got {found.shape}")
    if found.shape[-1] == 3:
        return found
    return np.concatenate([found, np.zeros_like(found[..., :1])], axis=-1)
