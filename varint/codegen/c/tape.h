/* Functions as data: their operations, carried out one after the other on registers of LANES numbers.

   lanes.h stands before this file. The first registers of a function hold what is the same all the time; `once` computes
   that from the parameters, on plain numbers. varint/codegen/tape.py has the same layouts and reads the names of the
   operations here. The numbers are those of the C source that varint/codegen/emit.py writes of the same operations. */

#define OPERATIONS(CALL1, CALL2) \
    CALL2(div) CALL1(sqrt) CALL1(sin) CALL1(cos) CALL1(exp) CALL1(log) CALL2(pow) CALL1(tan) CALL1(asin) CALL1(acos) \
    CALL1(atan) CALL1(sinh) CALL1(cosh) CALL1(tanh) CALL1(asinh) CALL1(acosh) CALL1(atanh) CALL1(erf) CALL1(expm1) \
    CALL1(log1p) CALL2(atan2) CALL2(hypot) CALL1(floor) CALL1(ceil) CALL2(fmod) CALL2(remainder) CALL1(fabs) \
    CALL2(copysign) CALL2(fmin) CALL2(fmax) CALL2(lt) CALL2(le) CALL2(eq) CALL2(ne) CALL1(not) CALL2(and) CALL2(or) \
    CALL2(if_else_zero) CALL1(sign)
#define ONLY_ONCE(CALL1, CALL2, LOAD) CALL2(add) CALL2(sub) CALL2(mul) CALL1(neg) CALL1(rsqrt) LOAD(constant) LOAD(parameter)
#define ONLY_OFTEN(SUM, CALL1, PAIR) SUM(sum) CALL1(rsqrt_exact) CALL1(rsqrt_iterated) PAIR(sincos)

typedef struct { unsigned short operation, result, a, b, c, signs; } Instruction;
typedef struct { unsigned short argument, component, place; } Moved;
typedef struct {
    int64_t uniforms, numbers, registers; /* the same all the time, with 1 and -0; numbers of `once`; the function's registers */
    int64_t inputs, outputs;
    const Instruction *once, *often; /* the last one is `end` */
    const double *constants;
    const Moved *input, *output; /* from where to which register, from which register to where */
} Tape;

#define NAME(f) OP_##f,
enum Operation { OP_end, OPERATIONS(NAME, NAME) ONLY_ONCE(NAME, NAME, NAME) ONLY_OFTEN(NAME, NAME, NAME) };
INLINE V v_div(V x, V y) { return x / y; }
INLINE double s_add(double x, double y) { return x + y; }
INLINE double s_sub(double x, double y) { return x - y; }
INLINE double s_mul(double x, double y) { return x * y; }
INLINE double s_div(double x, double y) { return x / y; }
INLINE double s_neg(double x) { return -x; }

/* Sums, products and both are one operation, +-a b +- c with the constants 1 and -0 where one of them is missing: the same
   numbers, and nothing to be guessed wrong about what comes next, which takes longer than the operation. */
#define ONE 0
#define NOTHING 1
INLINE V signed_by(V x, unsigned bit) { return real_of(bits_of(x) ^ ((int64_t)bit << 63)); }

/* What depends on the parameters alone, in all lanes of the first registers. */
static __attribute__((noinline)) void prepare_tape(const Tape *tape, const double *parameters, double *w) {
    double x[tape->numbers + 2];
    x[ONE] = 1.0, x[NOTHING] = -0.0;
    for (const Instruction *i = tape->once;; i++) switch (i->operation) {
#define ONCE1(f) case OP_##f: x[i->result] = s_##f(x[i->a]); break;
#define ONCE2(f) case OP_##f: x[i->result] = s_##f(x[i->a], x[i->b]); break;
#define FROM(f)
        OPERATIONS(ONCE1, ONCE2) ONLY_ONCE(ONCE1, ONCE2, FROM)
        case OP_constant: x[i->result] = tape->constants[i->a]; break;
        case OP_parameter: x[i->result] = parameters[i->a]; break;
        default:
            for (int64_t k = 0; k < tape->uniforms; k++) ((V *)w)[k] = splat(x[k]);
            return;
    }
}

/* The function at one point of each lane; component i of an argument is found at x[i * stride]. */
static __attribute__((noinline)) void evaluate_tape(const Tape *tape, const V *const *arguments, V *const *results, int stride,
                                                    const double *w) {
    static const void *const where[] = {
#define LABEL(f) &&do_##f,
#define NOWHERE(f) &&do_end,
        &&do_end, OPERATIONS(LABEL, LABEL) ONLY_ONCE(NOWHERE, NOWHERE, NOWHERE) ONLY_OFTEN(LABEL, LABEL, LABEL)};
    V *const x = (V *)w;
    for (int64_t k = 0; k < tape->inputs; k++)
        x[tape->input[k].place] = arguments[tape->input[k].argument][tape->input[k].component * stride];
    const Instruction *i = tape->often;
#define NEXT goto *where[i->operation];
#define OFTEN1(f) do_##f: do x[i->result] = v_##f(x[i->a]); while ((++i)->operation == OP_##f); NEXT
#define OFTEN2(f) do_##f: do x[i->result] = v_##f(x[i->a], x[i->b]); while ((++i)->operation == OP_##f); NEXT
#define SUM(f) \
    do_##f: \
    do x[i->result] = v_fma(signed_by(x[i->a], i->signs & 1), x[i->b], signed_by(x[i->c], i->signs >> 1)); \
    while ((++i)->operation == OP_##f); \
    NEXT
#define PAIR(f) \
    do_##f: do { V one, other; v_##f(x[i->a], &one, &other), x[i->result] = one, x[i->b] = other; } \
    while ((++i)->operation == OP_##f); \
    NEXT
    NEXT
    OPERATIONS(OFTEN1, OFTEN2)
    ONLY_OFTEN(SUM, OFTEN1, PAIR)
do_end:
    for (int64_t k = 0; k < tape->outputs; k++)
        results[tape->output[k].argument][tape->output[k].component * stride] = x[tape->output[k].place];
}
