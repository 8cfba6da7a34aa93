/* Root in (0, 1) of the cubic with values a >= 0 > b and slopes ra, rb at 0 and 1; the other one where a = 0. */
static double cubic_root(double a, double b, double ra, double rb, int64_t most, double close) {
    const double c3 = 2 * (a - b) + ra + rb, c2 = 3 * (b - a) - 2 * ra - rb;
    const double cubic[4] = {a, ra, c2, c3}, deflated[4] = {ra, c2, c3, 0}, *const c = a > 0 ? cubic : deflated;
    double low = 0, high = 1, s = 0.5;
    for (int64_t i = 0; i < most; i++) {
        const double value = c[0] + s * (c[1] + s * (c[2] + s * c[3])), slope = c[1] + s * (2 * c[2] + s * 3 * c[3]);
        if (value > 0) low = s;
        else high = s;
        double following = slope < 0 ? s - value / slope : 0.5 * (low + high);
        if (!(low <= following && following <= high)) following = 0.5 * (low + high);
        if (fabs(following - s) <= close * s) break;
        s = following;
    }
    return s;
}
