/* One step of a size of its own from each of many states: a run of one step, again and again. */
int parts(const PartsArguments *a) {
#ifdef SCENE_AS_DATA
    scene = a->scene;
#endif
    double *const carry = malloc((size_t)CARRY_SIZE * sizeof(double));
    if (!carry) return NOT_FINITE;
    double stats[sizeof(RunStats) / sizeof(double) + 3 * N], ends[2 * 3 * N];
    for (int64_t i = 0; i < a->count; i++) {
        const double *const start = a->start + i * 2 * N;
        /* another one from the same state begins with what is known of the one before */
        const int again = i && a->good[i - 1] && !a->told && !a->u && a->t[i] == a->t[i - 1] && !memcmp(start, start - 2 * N, 2 * N * sizeof(double));
        carry[0] = again ? -1 : 0;
        if (a->told) memcpy(carry + 1, a->opening + i * a->told, (size_t)a->told * sizeof(double));
        const double *const u = a->u ? a->u + i * a->used : a->u;
        const RunArguments one = {1, 1, 0, a->most, a->t[i], a->h[i], 0, start, a->c, u, ends, carry,
                                  (RunStats *)stats, a->scene, .alone = 1};
        a->good[i] = run(&one) == DONE;
        memcpy(a->rows + i * 3 * N, ends + 3 * N, 3 * N * sizeof(double));
    }
    free(carry);
    return DONE;
}
