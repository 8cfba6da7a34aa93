/* What a proof by two runs begins and ends with. order.h stands before this file, two_runs.h goes on. */
#define NO_NUMBER (0 * INFINITY)
#define MIDDLE 2 /* of the quantiles */
/* DOUBTED: but for a closer look. VARIES: equal steps are too many, and the number is added of a rate that others follow */
enum Proof { PROVED, NOT_PROVED, NOT_SHORT, DOUBTED, VARIES };

typedef struct {
    double rough, half, floor, lost, gain, margin, safety, spread, evidence, rounded, no_shrinkage, not_worse, rounding,
        stalled, part_close, caution, least, good, most, far, clear, secular_growth, left,
        uneven, chance, grows, ways, parted, far_below, magnified, again;
    double samples, most_without_a_part, parts, attempts, watched, first_part, fewest, seen_parts, slow, same_rounding, same_chance,
        same_step, poor, secular, level, closer, foreseen, hopeless, pairs, by_chance, sure_of_order, less_of_order, nearly, least_order, tells, still, converges;
    double quantiles[QUANTILES];
} Limits;

/* What the energies of a run of so many steps tell; hidden: what they cannot, for it is less than their last digits. */
typedef struct {
    double swing[QUANTILES], hidden;
    int64_t steps;
    int lost;
} Seen;
