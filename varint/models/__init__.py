"""Ready scenes with initial data, invariants and exact or reference solutions.

Every factory can be called without arguments and returns a `Model`; its arguments set the default
parameters and the start. ``catalogue`` holds all of them by name.
"""

from varint.models.central import (
    apsidal_angle,
    central_force,
    kepler,
    radial_motion,
    radial_period,
    rosette,
)
from varint.models.chains import fpu_chain, fpu_stiff_energies, toda_chain
from varint.models.constrained import (
    atwood,
    chain_rods,
    double_atwood,
    pendulum_cartesian,
    spherical_pendulum_cartesian,
    turning_wire,
)
from varint.models.contacts import bouncing_ball, falling_ladder, slack_string, slide_off_sphere
from varint.models.control import (
    ControlModel,
    fastest_transfer,
    fastest_wire,
    orbit_transfer,
    overhead_crane,
    rest_to_rest,
)
from varint.models.control_bodies import (
    carried_load,
    carried_load_reduced,
    falling_cat,
    free_floating_robot,
    hovercraft,
    walker,
)
from varint.models.control_swings import (
    swing_up_acrobot,
    swing_up_cart_pole,
    swing_up_pendulum,
    swing_up_rod,
)
from varint.models.degenerate import guiding_centre, lotka_volterra
from varint.models.driven import (
    accelerated_pivot,
    caldirola_kanai,
    driven_pendulum,
    forced_oscillator,
    horizontal_pivot,
    kapitza_frequency,
    kapitza_pendulum,
    lengthening_pendulum,
    linear_drag,
)
from varint.models.encounters import (
    ARENSTORF_PERIOD,
    HALO_PERIOD,
    arenstorf,
    pleiades,
    pythagorean_three_body,
    restricted_three_body,
)
from varint.models.fields import (
    charged_particle,
    growing_field,
    inverse_distance_field,
    inverse_distance_period,
    magnetic_mirror,
    oscillating_field,
    uniform_fields,
)
from varint.models.kicked import kicked_rotor
from varint.models.linkages import andrews_mechanism, four_bar, slider_crank
from varint.models.model import Model
from varint.models.oscillators import (
    coupled_oscillators,
    duffing,
    henon_heiles,
    isotropic_oscillator,
    spring_pendulum,
)
from varint.models.particles import (
    FIGURE_EIGHT_PERIOD,
    figure_eight,
    lagrange_triangle,
    lennard_jones,
    outer_solar_system,
    pairs,
    spring_cluster,
    two_body,
)
from varint.models.paths import (
    brachistochrone,
    catenary,
    cycloid,
    great_circle,
    spheroid_geodesic,
    torus_geodesic,
)
from varint.models.pendulums import (
    chain_pendulum,
    double_pendulum,
    inclined_axis,
    pendulum,
    pendulum_period,
    sliding_support,
    sliding_support_period,
    spherical_pendulum,
)
from varint.models.planets import solar_system
from varint.models.quaternions import (
    body_omega,
    free_body_quaternion,
    heavy_top_quaternion,
    quaternion_rate,
    rotation,
)
from varint.models.robots import acrobot, cart_pole, two_link_arm
from varint.models.rolling import chaplygin_sleigh, knife_edge, rolling_disc
from varint.models.rotating import foucault_pendulum, rotating_frame, turntable
from varint.models.sketches import sketch
from varint.models.sliding import (
    block_on_wedge,
    rotating_hoop,
    rotating_hoop_period,
    rotating_wire,
    swinging_atwood,
)
from varint.models.tops import body_rates, euler_rates, free_rigid_body, heavy_rigid_body, heavy_top

catalogue = {
    factory.__name__: factory
    for factory in (
        *(pendulum, inclined_axis, sliding_support, spherical_pendulum, double_pendulum),
        *(chain_pendulum, driven_pendulum, horizontal_pivot, kapitza_pendulum, accelerated_pivot),
        *(lengthening_pendulum, forced_oscillator, caldirola_kanai, linear_drag, rotating_hoop),
        *(rotating_wire, block_on_wedge, swinging_atwood, isotropic_oscillator),
        *(coupled_oscillators, henon_heiles, duffing, spring_pendulum, kicked_rotor, fpu_chain),
        *(toda_chain, kepler, central_force, radial_motion, rosette, two_body, lagrange_triangle),
        *(figure_eight, spring_cluster, lennard_jones, outer_solar_system, solar_system),
        *(pleiades, pythagorean_three_body, arenstorf, restricted_three_body, rotating_frame),
        *(turntable, foucault_pendulum, uniform_fields, magnetic_mirror, inverse_distance_field),
        *(oscillating_field, growing_field, free_rigid_body, heavy_rigid_body, heavy_top),
        *(cart_pole, acrobot, two_link_arm, great_circle, torus_geodesic, spheroid_geodesic),
        *(brachistochrone, catenary, lotka_volterra, guiding_centre, pendulum_cartesian),
        *(spherical_pendulum_cartesian, atwood, double_atwood, chain_rods, turning_wire),
        *(free_body_quaternion, heavy_top_quaternion, slider_crank, four_bar, andrews_mechanism),
        *(falling_ladder, bouncing_ball, slide_off_sphere, slack_string, knife_edge),
        *(chaplygin_sleigh, rolling_disc),
    )
}

control_catalogue = {
    factory.__name__: factory
    for factory in (
        rest_to_rest,
        fastest_transfer,
        swing_up_cart_pole,
        swing_up_pendulum,
        swing_up_acrobot,
        overhead_crane,
        fastest_wire,
        orbit_transfer,
        free_floating_robot,
        swing_up_rod,
        walker,
        falling_cat,
        hovercraft,
        carried_load,
        carried_load_reduced,
    )
}

__all__ = [
    "ARENSTORF_PERIOD",
    "FIGURE_EIGHT_PERIOD",
    "HALO_PERIOD",
    "ControlModel",
    "Model",
    "apsidal_angle",
    "body_omega",
    "body_rates",
    "catalogue",
    "charged_particle",
    "control_catalogue",
    "cycloid",
    "euler_rates",
    "fpu_stiff_energies",
    "inverse_distance_period",
    "kapitza_frequency",
    "pairs",
    "pendulum_period",
    "quaternion_rate",
    "radial_period",
    "rotating_hoop_period",
    "rotation",
    "sketch",
    "sliding_support_period",
    *catalogue,
    *control_catalogue,
]
