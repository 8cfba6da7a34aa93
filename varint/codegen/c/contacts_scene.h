/* What the contacts of a scene are, as data.

   tape.h stands before this file. varint/codegen/contacts.py reads the names here. `gaps`: (q, v, t) to the gaps and their
   rates; `bounds`: (q, v at both ends, t, w) of a piece to lower bounds of the gaps and bounds of their rates and curvatures; `floors`: (q: low, high, t: low, high) to lower bounds of the gaps in such a box;
   `blow`: (q, v, t) to the gradients W row by row, of constraints and then of contacts, the mass matrix by columns, the force
   f = M a, what W a lacks of the second derivatives of the rows, the energy, and coefficients of restitution. */
#define SCENE_AS_DATA
#define COUNTS(DO) \
    DO(N) DO(ROWS) DO(CONTACTS) DO(MOST_LOOKS) DO(NEWTON) DO(GAP_ITERATIONS) DO(ROOT_ITERATIONS) DO(MOST_IMPACTS) DO(RESTLESS)
#define LIMITS(DO) \
    DO(TOUCH) DO(RESTING) DO(PULL) DO(ZENO) DO(LOCATED) DO(NEAR) DO(FLAT) DO(DEPENDENT) DO(RESIDUAL_LIMIT) DO(SHORTEST) DO(PATH_ERROR)
#define PLACES(DO)
#define TABLES(DO) /* none */
#define FUNCTIONS(DO) DO(gaps) DO(bounds) DO(blow) DO(floors)

#include "scene_members.h"
#define N ((int)scene->N_)
#define ROWS ((int)scene->ROWS_)
#define CONTACTS ((int)scene->CONTACTS_)
#define MOST_LOOKS ((int)scene->MOST_LOOKS_)
#define SHORTEST scene->SHORTEST_
#define NEWTON ((int)scene->NEWTON_)
#define GAP_ITERATIONS ((int)scene->GAP_ITERATIONS_)
#define ROOT_ITERATIONS ((int)scene->ROOT_ITERATIONS_)
#define MOST_IMPACTS ((int)scene->MOST_IMPACTS_)
#define RESTLESS ((int)scene->RESTLESS_)
#define TOUCH scene->TOUCH_
#define RESTING scene->RESTING_
#define PULL scene->PULL_
#define ZENO scene->ZENO_
#define LOCATED scene->LOCATED_
#define NEAR scene->NEAR_
#define FLAT scene->FLAT_
#define DEPENDENT scene->DEPENDENT_
#define RESIDUAL_LIMIT scene->RESIDUAL_LIMIT_
#define PATH_ERROR scene->PATH_ERROR_
#define GAPS_AT 0
#define BOUNDS_AT scene->gaps.registers
#define BLOW_AT (BOUNDS_AT + scene->bounds.registers)
#define ALL_W (BLOW_AT + scene->blow.registers + 1)

INLINE void gaps(In q, In v, In t, In w, double *gap, double *rate) { CALL(gaps, ARGUMENTS(q, v, t), gap, rate); }
INLINE void bounds(In q0, In v0, In q1, In v1, In t, In width, In w, double *low, double *rate_low, double *rate_high, double *bend) {
    CALL(bounds, ARGUMENTS(q0, v0, q1, v1, t, width), low, rate_low, rate_high, bend);
}
INLINE void blow(In q, In v, In t, In w, double *slope, double *mass, double *force, double *bend, double *energy, double *bounce) {
    CALL(blow, ARGUMENTS(q, v, t), slope, mass, force, bend, energy, bounce);
}
