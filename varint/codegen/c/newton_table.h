/* What the loop of newton.c has of a scene that is compiled apart: its functions, and what differs between scenes of a size.

   w begins with the addresses of this table and of what the loop has for many angles at once; the prepared numbers, which
   all functions share, begin behind them. Functions that a scene does not need do nothing. */
typedef const double *In;
typedef void (*Angles)(const double *angle, double *sine, double *cosine);
typedef const Angles *AnglesPlace __attribute__((may_alias));
#define ANGLES 8 /* at once; varint/codegen/angles.py */
#define PREPARED_AT 2
#define sines_and_cosines(w, angle, sine, cosine) (*(AnglesPlace)((w) - 1))(angle, sine, cosine) /* for w behind the addresses */
struct Run;
typedef struct Scene {
    int64_t prepared, parameters; /* how many numbers */
    void (*prepare)(In k, double *w);
    void (*residual)(In y, In q, In p, In t, In u, In w, double *b);
    void (*residual_and_slope)(In y, In q, In p, In t, In u, In w, double *b, double *jacobian);
    void (*finish)(In y, In q, In p, In t, In u, In w, double *increment, double *gain, double *remains);
    void (*units)(In w, double *size);
    void (*node_values)(In q, In v, In t, In u, In lam, In w, double *p, double *f, double *gap);
    void (*node_slopes)(In q, In v, In t, In u, In lam, In w, double *p, double *f, double *gap, double *gap_q, double *p_q,
                        double *p_v, double *f_q, double *f_v);
    void (*node_turn)(In q, In v, In t, In u, In lam, In dq, In dv, In w, double *dp, double *df, double *dg);
    void (*node_inertia)(In w, double *p_v);
    void (*row_units)(In w, double *units);
    void (*judged)(In y, In q, In p, In t, In gain, In w, double *sizes);
    void (*speed)(In x, In q_or_p, In t, In w, double *v);
    void (*kick)(In q, In t, In u, In w, double *force);
    void (*sized)(In q, In t, In w, double *sizes);
    void (*hidden)(In q, In p, In t, In w, double *b, double *jacobian, double *size);
    void (*pulled)(In x, In q, In p, In t, In w, double *pull);
    void (*frozen)(In y, In q, In t, In w, double *jacobian);
    void (*slope)(In w, double *jacobian);
    void (*affine)(In w, double *parts);
    void (*driven)(In t, In u, In w, double *parts);
    void (*legendre)(In v, In q, In p, In t, In w, double *missing, double *correction);
    void (*independence)(In q, In t, In w, double *pivot);
    void (*lengths)(In q, In t, In w, double *squares);
    int (*step)(struct Run *r, double t, double end);
} Scene;
