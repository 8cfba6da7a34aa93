/* What a run of a Gauss rule needs to go on as if it had not stopped: these numbers, and behind them y and its rest, 2 N each, what
   the scales remember, ROWS each, and the unknowns of the last two steps and of the one that is begun. */
typedef struct {
    double steps_known, expected, h, rate, work, low, count, tried, counts[3]; /* of the steps tried in either order */
    double numbers[];
} Carry;
#define ANOTHER_SIZE (-2) /* steps that are known: a fresh start with steps of another size, whose slopes are asked for at once */
