/* The order of numbers. */
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
