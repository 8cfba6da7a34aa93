/* Where the prepared numbers of each function of newton.c begin, behind room for the address of a table (newton_table.h).

   NAME_W, how many a function has, stands before this file. */
#define EQUATIONS_AT 1
#define FINISH_AT (EQUATIONS_AT + EQUATIONS_W)
#define UNITS_AT (FINISH_AT + FINISH_W)
#define SPEED_AT (UNITS_AT + UNITS_W)
#define KICK_AT (SPEED_AT + SPEED_W)
#define SIZED_AT (KICK_AT + KICK_W)
#define HIDDEN_AT (SIZED_AT + SIZED_W)
#define PULLED_AT (HIDDEN_AT + HIDDEN_W)
#define SLOPE_AT (PULLED_AT + PULLED_W)
#define AFFINE_AT (SLOPE_AT + SLOPE_W)
#define DRIVEN_AT (AFFINE_AT + AFFINE_W)
#define LEGENDRE_AT (DRIVEN_AT + DRIVEN_W)
#define INDEPENDENCE_AT (LEGENDRE_AT + LEGENDRE_W)
#define LENGTHS_AT (INDEPENDENCE_AT + INDEPENDENCE_W)
#define FROZEN_AT (LENGTHS_AT + LENGTHS_W)
#define ALL_W (FROZEN_AT + FROZEN_W)
