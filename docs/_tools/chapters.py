"""The gallery's chapters: examples in reading order, each with its Lagrangian (and what else
defines it) in LaTeX.
"""

PENDULUM = r"L = \tfrac12 m\ell^2\dot\theta^2 + m g \ell\cos\theta"
KEPLER = r"L = \tfrac12 m\,|\dot{\mathbf r}|^2 + \frac{k}{|\mathbf r|}"
CHARGE = (
    r"L = \tfrac12 m\,|\dot{\mathbf r}|^2 - e\,\bigl(\varphi - \dot{\mathbf r}\cdot\mathbf A\bigr)"
)
PAIRS = r"L = \tfrac12 \sum_i m_i\,|\dot{\mathbf r}_i|^2 - \sum_{i<j} V_{ij}\bigl(|\mathbf r_i - \mathbf r_j|\bigr)"
CART_POLE = (
    r"L = \tfrac12 (M + m)\,\dot x^2 + m\ell\,\dot x\dot\theta\cos\theta"
    r" + \tfrac12 m\ell^2\dot\theta^2 + m g\ell\cos\theta"
)

CHAPTERS: dict[str, dict[str, str]] = {
    "Pendulums": {
        "pendulum": PENDULUM,
        "double_pendulum": r"L = \tfrac12 \sum_i m_i\,(\dot x_i^2 + \dot y_i^2) - g \sum_i m_i\,y_i,\qquad"
        r" x_i = \sum_{j\le i}\ell_j\sin\theta_j,\quad y_i = -\sum_{j\le i}\ell_j\cos\theta_j",
        "spherical_pendulum": r"L = \tfrac12 m\ell^2\bigl(\dot\theta^2 + \dot\varphi^2\sin^2\theta\bigr)"
        r" + m g\ell\cos\theta",
        "sliding_bodies": r"L = \tfrac12 (m + M)\,\dot X^2 + \tfrac12 m\,\bigl(2\ell\,\dot X\dot\theta\cos\theta"
        r" + \ell^2\dot\theta^2\bigr) + m g\ell\cos\theta",
        "beads": r"L = \tfrac12 m R^2\bigl(\dot\theta^2 + \Omega^2\sin^2\theta\bigr) + m g R\cos\theta,\qquad"
        r" L = \tfrac12 m\,\bigl(\dot r^2 + \Omega^2 r^2\bigr)",
        "swinging_atwood": r"L = \tfrac12 (1 + \mu)\,m\dot r^2 + \tfrac12 m r^2\dot\theta^2"
        r" - \mu m g r + m g r\cos\theta",
    },
    "Central forces and many bodies": {
        "kepler": KEPLER,
        "central_force": r"L = \tfrac12 m\,\bigl(\dot r^2 + r^2\dot\theta^2\bigr) - V(r)",
        "many_bodies": PAIRS,
        "planets": PAIRS,
        "outer_solar_system": r"L = \tfrac12 \sum_i m_i\,|\dot{\mathbf r}_i|^2"
        r" + G \sum_{i<j} \frac{m_i m_j}{|\mathbf r_i - \mathbf r_j|}",
    },
    "Oscillators and chains": {
        "oscillators": r"L = \tfrac12 m\,(\dot x_1^2 + \dot x_2^2) - \tfrac12 k\,(x_1^2 + x_2^2)"
        r" - \tfrac12 k_c\,(x_1 - x_2)^2",
        "henon_heiles": r"L = \tfrac12 (\dot x^2 + \dot y^2) - \tfrac12 (x^2 + y^2) - \bigl(x^2 y - \tfrac13 y^3\bigr)",
        "chaos": r"L = \tfrac12 |\dot{\mathbf q}|^2 - V(\mathbf q),\qquad \delta L ="
        r" \frac{\partial L}{\partial q}\,\delta + \frac{\partial L}{\partial\dot q}\,\dot\delta",
        "fpu_chain": r"L = \tfrac12 \sum_i \dot q_i^2 - \sum_{\text{soft}} (q_{i+1} - q_i)^4"
        r" - \tfrac{\omega^2}{4} \sum_{\text{stiff}} (q_{i+1} - q_i)^2",
        "toda_chain": r"L = \tfrac12 \sum_i \dot q_i^2 - \sum_i \bigl[e^{-r_i} + r_i - 1\bigr],"
        r"\qquad r_i = q_{i+1} - q_i",
    },
    "Explicit time and friction": {
        "driven_pendulum": r"L = \tfrac12 m\ell^2\dot\theta^2 + m g\ell\cos\theta + \tau\,\theta\cos\Omega t",
        "kapitza": r"L = \tfrac12 m\,\bigl(\dot x^2 + \dot y^2\bigr) - m g y,\qquad"
        r" (x, y) = \bigl(\ell\sin\theta,\ a\cos\Omega t - \ell\cos\theta\bigr)",
        "damping": r"L = e^{\gamma t}\,\bigl(\tfrac12 m\dot x^2 - \tfrac12 m\omega^2 x^2\bigr)\qquad\text{or}\qquad"
        r" L = \tfrac12 \dot x^2 - \tfrac12 \omega^2 x^2,\quad F = -\gamma\dot x",
        "machines": CART_POLE,
    },
    "Frames and fields": {
        "rotating_frame": r"L = \tfrac12 m\,|\dot{\mathbf r} + \boldsymbol\Omega\times\mathbf r|^2",
        "charged_particle": CHARGE,
        "magnetic_mirror": CHARGE
        + r",\qquad L_{\mathrm{gc}} = (e\mathbf A + m w\,\mathbf b)\cdot\dot{\mathbf r}"
        r" - \tfrac12 m w^2 - \mu B",
        "predator_prey": r"L = \eta\,\dot\xi - H(\xi, \eta)",
    },
    "Rigid bodies": {
        "free_body": r"L = \tfrac12 \bigl(I_1\omega_1^2 + I_2\omega_2^2 + I_3\omega_3^2\bigr)",
        "heavy_top": r"L = \tfrac12 I_1\bigl(\dot\theta^2 + \dot\varphi^2\sin^2\theta\bigr)"
        r" + \tfrac12 I_3\bigl(\dot\psi + \dot\varphi\cos\theta\bigr)^2 - m g\ell\cos\theta",
    },
    "Symmetries": {
        "homogeneity_of_space": PAIRS,
        "homogeneity_of_time": KEPLER,
        "isotropy": r"L = \tfrac12 |\dot{\mathbf r}|^2 + \frac{1}{|\mathbf r|}",
        "galilean_boosts": PAIRS + r",\qquad \delta L = \frac{d}{dt}\sum_i m_i x_i",
        "magnetic_translations": CHARGE + r",\qquad \mathbf B = B\,\mathbf e_z",
        "broken_symmetry": r"L = \tfrac12 |\dot{\mathbf r}|^2 + \frac{1}{|\mathbf r|},"
        r"\qquad \mathbf F = -\gamma\,\dot{\mathbf r}",
    },
    "Constraints and contacts": {
        "falling_ladder": r"L = \tfrac12 M\,(\dot x^2 + \dot y^2) + \tfrac12 I\dot\theta^2 - M g y,\qquad"
        r" x - \tfrac12\ell\cos\theta \ge 0,\quad y - \tfrac12\ell\sin\theta = 0",
        "closed_loops": r"S = \int \bigl(L + \boldsymbol\lambda\cdot\mathbf g\bigr)\,dt,"
        r"\qquad \mathbf g(q) = 0\ \text{closes the loops}",
        "atwood_and_wire": r"L = \tfrac12 m_1\dot x_1^2 + \tfrac12 m_2\dot x_2^2 + m_1 g x_1 + m_2 g x_2,"
        r"\qquad x_1 + x_2 - c = 0",
        "spherical_pendulum_cartesian": r"L = \tfrac12 |\dot{\mathbf r}|^2 - g z,\qquad |\mathbf r|^2 - \ell^2 = 0",
        "rod_chain": r"L = \tfrac12 \sum_i (\dot x_i^2 + \dot y_i^2) - g \sum_i y_i,"
        r"\qquad |\mathbf r_i - \mathbf r_{i-1}|^2 - \ell^2 = 0",
        "linkages": r"L = T(q, \dot q) - V(q),\qquad \mathbf g(q) = 0\ \text{the joints}",
        "bouncing_balls": r"L = \tfrac12 m\,|\dot{\mathbf r}|^2 - m g y,\qquad \mathrm{gap}(q) \ge 0",
        "rolling": r"\frac{d}{dt}\frac{\partial L}{\partial\dot q} - \frac{\partial L}{\partial q}"
        r" = A^{\mathsf T}\lambda,\qquad A(q)\,\dot q = 0",
    },
    "Paths between fixed end points": {
        "exact_actions": r"\delta\int_0^T L\,dt = 0,\qquad q(0) = q_a,\quad q(T) = q_b",
        "pendulum_paths": PENDULUM,
        "lambert": KEPLER,
        "geodesics": r"L = \tfrac12 |\dot{\mathbf r}|^2,\qquad g(\mathbf r) = 0\ \text{the surface}",
        "brachistochrone": r"\min T:\qquad L = \tfrac12 m\,(\dot x^2 + \dot y^2) - m g y",
        "figure_eight": PAIRS,
        "obstacle": r"\min \int_0^T L\,dt,\qquad |\mathbf r - \mathbf c| \ge R",
    },
    "Periodic orbits and their stability": {
        "normal_modes": r"L \approx \tfrac12 \dot{\mathbf x}^{\mathsf T} M \dot{\mathbf x}"
        r" - \tfrac12 \mathbf x^{\mathsf T} K \mathbf x",
        "halo_orbits": r"L = \tfrac12 (\dot x - y)^2 + \tfrac12 (\dot y + x)^2 + \tfrac12 \dot z^2"
        r" + \frac{1 - \mu}{r_1} + \frac{\mu}{r_2}",
        "arenstorf": r"L = \tfrac12 (\dot x - y)^2 + \tfrac12 (\dot y + x)^2"
        r" + \frac{1 - \mu}{r_1} + \frac{\mu}{r_2}",
    },
    "Parameters from data": {
        "learnt_from_data": PENDULUM
        + r",\qquad \min_{\theta, q_0, v_0} \sum_j \bigl((\psi(q(t_j)) - y_j) / \sigma_j\bigr)^2",
        "exoplanets": PAIRS,
        "solar_system_masses": PAIRS,
        "estimated_cart_pole": CART_POLE
        + r",\qquad \min \sum_k |y_k - q_k|^2_{R^{-1}} + |w_k|^2_{Q^{-1}},"
        r"\quad x_{k+1} = \Phi(x_k, u_k) + w_k",
    },
    "Optimal control": {
        "control_cart_pole": CART_POLE + r",\qquad \min \int_0^2 u^2\,dt",
        "control_minima": r"L = \tfrac12 m\ell^2\dot\theta^2 + m g \ell\cos\theta,\quad F = u,\qquad"
        r" \min \int_0^3 u^2\,dt",
        "control_fastest": r"\min T:\qquad L = \tfrac12 \dot x^2,\quad F = u,\quad |u| \le 1",
        "control_rocket": r"\max r(T):\qquad L = \tfrac12 \dot r^2 + \frac{1}{r},\quad"
        r" F = \frac{u - D(r, \dot r)}{m},\quad \dot m = -\frac{u}{c},\quad 0 \le u \le u_{\max}",
        "control_machines": r"\min \int_0^T \ell(q, \dot q, u)\,dt,"
        r"\qquad \frac{d}{dt}\frac{\partial L}{\partial\dot q} - \frac{\partial L}{\partial q}"
        r" = F(u) + G^{\mathsf T}\lambda",
        "control_films": r"\min \sum_k \int \ell(q, \dot q, u)\,dt,\qquad p^+_{k-1} = p^-_k",
        "design_parameters": r"\min_{u,\,c} \int_0^T \ell(q, \dot q, u; c)\,dt,"
        r"\qquad L = L(q, \dot q; c)",
        "mpc_cart_pole": CART_POLE
        + r",\qquad \min \int_t^{t + T} \ell(q, \dot q, u)\,dt\ \text{at every step}",
        "six_axis_arm": r"\min \int_0^T 1 + \varepsilon \sum_i (u_i / \hat u_i)^2\,dt,\qquad"
        r" L = \sum_k \tfrac12 m_k |\dot{\mathbf r}_k|^2"
        r" + \tfrac12 \boldsymbol\omega_k^{\mathsf T} I_k \boldsymbol\omega_k - m_k g z_k",
        "quadruped": r"\min \int_0^T |u|^2\,dt,\qquad L = \sum_k \tfrac12 m_k |\dot{\mathbf r}_k|^2"
        r" + \tfrac12 \boldsymbol\omega_k^{\mathsf T} I_k \boldsymbol\omega_k - m_k g z_k",
        "crane_and_leap": r"\min \int_0^T \ell(u)\,dt,\qquad"
        r" L = \sum_k \tfrac12 m_k |\dot{\mathbf r}_k|^2 + \tfrac12 I_k \omega_k^2 - m_k g z_k",
        "two_link_arm_in_c": r"L = \tfrac12 \sum_i \bigl(m_i\,|\dot{\mathbf r}_i|^2 + I_i\,\omega_i^2\bigr),"
        r"\qquad \min \int_t^{t + T} \ell(q, \dot q, u)\,dt\ \text{in C at 1 kHz}",
    },
}
