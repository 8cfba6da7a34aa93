/* Starts that differ from one by round-off (varint/integration/round_off.py). */
double nextafter(double, double);

/* q and p of a start whose momenta have last digits one up or down, in one of the ways; at rest its coordinates have. */
static void set_other_digits(int64_t n, const double *start, int64_t way, double *other) {
    int64_t begin = 0; /* momenta, or coordinates at rest */
    for (int64_t d = 0; d < 2 * n; d++) {
        other[d] = start[d];
        if (d >= n && start[d] != 0) begin = n;
    }
    for (int64_t i = 0; i < n; i++) {
        const double x = start[begin + i];
        other[begin + i] = x == 0 ? x : nextafter(x, (way ? i + 1 : i / 2) % 2 ? -INFINITY : INFINITY);
    }
}
