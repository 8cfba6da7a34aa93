/* The order of numbers, and what they say of a run's energies. */
double rint(double);
#define QUANTILES 5

static void swap(double *x, double *y) { const double z = *x; *x = *y, *y = z; }

/* x[k] is where it stands in order, smaller ones before it and larger ones behind it (Hoare). */
static void place(double *x, int64_t low, int64_t high, int64_t k) {
    while (low < high) {
        const int64_t middle = low + (high - low) / 2;
        if (x[middle] < x[low]) swap(x + middle, x + low);
        if (x[high] < x[low]) swap(x + high, x + low);
        if (x[high] < x[middle]) swap(x + high, x + middle);
        const double pivot = x[middle];
        int64_t i = low, j = high;
        while (i <= j) {
            while (x[i] < pivot) i++;
            while (pivot < x[j]) j--;
            if (i <= j) swap(x + i++, x + j--);
        }
        if (k <= j) high = j;
        else if (k >= i) low = i;
        else return;
    }
}

/* Quantiles of |H - H0| over the middle one of |p v| at so many nodes; infinite where the motion is lost. */
static void quantiles(double *energy, double *moving, int64_t many, const double *parts, double *swing) {
    const double start = energy[0];
    double sum = 0;
    for (int64_t k = 0; k < many; k++) {
        energy[k] = fabs(energy[k] - start), sum += energy[k];
        if (!(moving[k] == moving[k])) moving[k] = INFINITY;
    }
    const int64_t last = many - 2;
    place(moving, 0, many - 1, many / 2);
    const double size = moving[many / 2];
    if (sum - sum != 0 || !(size > 0)) {
        for (int i = 0; i < QUANTILES; i++) swing[i] = INFINITY;
        return;
    }
    int64_t low = 0;
    for (int i = 0; i < QUANTILES; i++) {
        const int64_t k = (int64_t)rint(parts[i] * last);
        place(energy + 1, low, last, k);
        swing[i] = energy[1 + k] / size, low = k;
    }
}
