/* Runs that prove an error, and the motion of the nodes that they found, in one call from Python: what the numbers of a short
   run take to be packed, and its nodes and what is told of them to become objects, is longer than the run.

   A module of its own, by Python's own interface; varint/integration/even_motion.py does the same where it was not built. */
#define PY_SSIZE_T_CLEAN
#include <Python.h>
#include "found.h"
#include "times.h"

/* What stands behind the course of runs: the start, and what is asked (two_runs_core.c, refined_core.c). */
typedef struct {
    const double *start, *c;
    Proved *found;
    const double *mass;
    int64_t apart;
    Room room;
} Place;
typedef struct { const void *open, *told; int64_t opens; } Opening;
typedef struct { const void *sought, *speed, *velocities; const double *zeros; int64_t numbers[3]; const void *typical[2]; } Search; /* sought.h */
typedef struct {
    int64_t first;
    double t0, duration, radians, tol;
    const void *rates;
    Opening opening;
    Search search;
} Asked;
#define ZERO_SIZE(n) (5 + 3 * (n)) /* numbers of a zero: the second says of which expression it is, the third when (sought.h) */
enum Status { GRADED_DOUBTED = -2, GRADED, PROVED, DOUBTED = 3 }; /* graded: steps differ (refined.h) */
#define LONGEST_COURSE 512 /* bytes */

/* Fields of Made in varint/integration/even_motion.py, of Places in varint/codegen/two_runs.py, of Beside in
   varint/codegen/beside.py, and of Between in varint/codegen/times.py */
enum { COURSE, ENTRY, HEAD, N, PARTS, TYPE, BLANK, NAME, MAKE, NOW, ARRAY, FLOAT, MADE };
enum { PLACE, TOLD, ROOM, VIEWS, PLACES };
enum { OPENING, SEARCH, STOPS, EXPRESSIONS, ZEROS, HELD_BESIDE, BESIDE };
enum { AT_TIMES, STEPS, STEPS_SCENE, MOST, WHOLE, WITHIN, WITHIN_SCENE, TABLES, ORDER, FEWEST, BETWEEN };
enum { SYSTEM_NAME, Q_NAME, P_NAME, V_NAME, T_NAME, K_NAME, H_NAME, C_NAME, ORIGIN_NAME, MAKE_NAME, COPY_NAME, DICT_NAME, REPEATED_NAME, KNOWN_NAME, SIZES_NAME, ELEMENT_HASH_NAME, NAMES };
static const char *const spelt[NAMES] = {"system", "q", "p", "v", "t", "k", "h", "c", "origin", "_make", "copy", "__dict__", "_repeated", "known", "sizes", "element_hash"};
static PyObject *names[NAMES];

#define ITEM(tuple, i) PyTuple_GET_ITEM(tuple, i)

static PyObject *again(PyObject *x) { Py_INCREF(x); return x; }

static int is_tuple_of(PyObject *x, Py_ssize_t size) { return PyTuple_Check(x) && PyTuple_GET_SIZE(x) == size; }

/* (parts, last + 1, n) numbers, from the room or from a run that is long. */
static PyObject *nodes_of(PyObject *how, PyObject *places, const Proved *found) {
    PyObject *const views = ITEM(places, VIEWS), *const count = PyLong_FromLongLong(found->last);
    const int64_t n = PyLong_AsLongLong(ITEM(how, N)), parts = PyLong_AsLongLong(ITEM(how, PARTS));
    PyObject *made = 0, *const known = count && !found->run ? PyDict_GetItemWithError(views, count) : 0;
    if (known) made = PyObject_CallMethodNoArgs(known, names[COPY_NAME]);
    else if (count && !PyErr_Occurred()) {
        PyObject *const shape = Py_BuildValue("LLL", (long long)parts, (long long)found->last + 1, (long long)n);
        PyObject *given[] = {shape, ITEM(how, FLOAT), ITEM(places, ROOM)};
        if (shape) made = PyObject_Vectorcall(ITEM(how, ARRAY), given, found->run ? 2 : 3, 0);
        Py_XDECREF(shape);
        if (made && found->run) {
            Py_buffer memory;
            if (!PyObject_GetBuffer(made, &memory, PyBUF_WRITABLE)) {
                put_nodes(found->run, n, found->last + 1, parts, memory.buf);
                PyBuffer_Release(&memory);
            } else
                Py_CLEAR(made);
        } else if (made) {
            PyObject *const view = made;
            made = PyDict_SetItem(views, count, view) ? 0 : PyObject_CallMethodNoArgs(view, names[COPY_NAME]);
            Py_DECREF(view);
        }
    }
    Py_XDECREF(count);
    return made;
}

/* Times that are asked for, how a motion is looked at between its nodes, and what is found: (2, times, n) numbers, coordinates
   and momenta, and whole steps before each. */
typedef struct { PyObject *times, *between, *states, *whole; } AtTimes;

static PyObject *new_array(PyObject *how, PyObject *shape, PyObject *kind) {
    PyObject *given[] = {shape, kind}, *const made = shape ? PyObject_Vectorcall(ITEM(how, ARRAY), given, 2, 0) : 0;
    Py_XDECREF(shape);
    return made;
}

/* The states at those times, and none where another way is to be taken; 0 with an error. */
static int look_between(AtTimes *to, PyObject *how, const Asked *asked, const Place *at, const Proved *found) {
    Py_buffer times, states, whole;
    const int64_t n = PyLong_AsLongLong(ITEM(how, N)), parts = PyLong_AsLongLong(ITEM(how, PARTS)), nodes = found->steps + 1;
    if (PyObject_GetBuffer(to->times, &times, PyBUF_SIMPLE)) return PyErr_Clear(), 1; /* not in one piece */
    const int64_t count = times.len / sizeof(double);
    int done = 0;
    double *const own = found->run ? malloc(parts * nodes * n * sizeof(double)) : at->room.at;
    to->states = new_array(how, Py_BuildValue("iLL", 2, (long long)count, (long long)n), ITEM(how, FLOAT));
    to->whole = new_array(how, Py_BuildValue("(L)", (long long)count), ITEM(to->between, WHOLE));
    const int has_states = to->states && !PyObject_GetBuffer(to->states, &states, PyBUF_WRITABLE),
              has_whole = to->whole && !PyObject_GetBuffer(to->whole, &whole, PyBUF_WRITABLE);
    if (own && has_states && has_whole) {
        int (*const at_times)(const Times *) = (int (*)(const Times *))PyLong_AsVoidPtr(ITEM(to->between, AT_TIMES));
        const Times a = {.parts = (int (*)(const void *))PyLong_AsVoidPtr(ITEM(to->between, STEPS)),
                         .scene = PyLong_AsVoidPtr(ITEM(to->between, STEPS_SCENE)), .n = n,
                         .most = PyLong_AsLongLong(ITEM(to->between, MOST)), .nodes = nodes, .count = count, .q = own, .p = own + n * nodes,
                         .c = at->c, .times = times.buf, .found_q = states.buf, .found_p = (double *)states.buf + n * count,
                         .found_k = whole.buf, .h = asked->duration / (double)found->steps, .t0 = asked->t0,
                         .within = (int (*)(const void *))PyLong_AsVoidPtr(ITEM(to->between, WITHIN)),
                         .within_scene = PyLong_AsVoidPtr(ITEM(to->between, WITHIN_SCENE)),
                         .tables = PyLong_AsVoidPtr(ITEM(to->between, TABLES)), .order = PyLong_AsLongLong(ITEM(to->between, ORDER)),
                         .fewest = PyLong_AsLongLong(ITEM(to->between, FEWEST))};
        if (found->run) put_nodes(found->run, n, nodes, parts, own);
        Py_BEGIN_ALLOW_THREADS
        done = !at_times(&a);
        Py_END_ALLOW_THREADS
    }
    if (has_states) PyBuffer_Release(&states);
    if (has_whole) PyBuffer_Release(&whole);
    PyBuffer_Release(&times);
    if (found->run) free(own);
    if (!done) {
        Py_CLEAR(to->states);
        Py_CLEAR(to->whole);
    }
    return !PyErr_Occurred();
}

/* Into `to`, whose reference to x it takes; whether that was done. */
static int put(PyObject *to, int name, PyObject *x) {
    const int done = x && !PyDict_SetItem(to, names[name], x);
    Py_XDECREF(x);
    return done;
}

/* Times of the nodes of steps that differ, which stand in the place of the first velocity, and the sizes of these, into a motion. */
static int put_times(PyObject *to, PyObject *how, const Proved *found) {
    const int64_t n = PyLong_AsLongLong(ITEM(how, N)), steps = found->steps;
    PyObject *const made[] = {new_array(how, Py_BuildValue("(L)", (long long)steps + 1), ITEM(how, FLOAT)),
                              new_array(how, Py_BuildValue("(L)", (long long)steps), ITEM(how, FLOAT))};
    Py_buffer memory[2];
    const int times = made[0] && !PyObject_GetBuffer(made[0], &memory[0], PyBUF_WRITABLE),
              sizes = times && made[1] && !PyObject_GetBuffer(made[1], &memory[1], PyBUF_WRITABLE);
    if (sizes) {
        double *const t = memory[0].buf, *const h = memory[1].buf;
        for (int64_t k = 0; k <= steps; k++) t[k] = found->run[3 * n * k + 2 * n];
        for (int64_t k = 0; k < steps; k++) h[k] = t[k + 1] - t[k];
        PyBuffer_Release(&memory[1]);
    }
    if (times) PyBuffer_Release(&memory[0]);
    if (sizes) return put(to, T_NAME, made[0]) & put(to, SIZES_NAME, made[1]);
    Py_XDECREF(made[0]), Py_XDECREF(made[1]);
    return 0;
}

/* What was found on the way: when the run ends within a step, if it does, and the zeros that are no end, with whose they are, or
   None. */
typedef struct {
    PyObject *happened;
    double end;
    int cut;
} OnTheWay;

/* (system, parameters, expressions, zeros behind the first so many), or None where there are no more; 0 with an error. */
static PyObject *happened_in(PyObject *how, PyObject *system, PyObject *c, PyObject *beside, const double *zeros, int64_t first, int64_t count) {
    if (count <= first) return again(Py_None);
    const int64_t width = ZERO_SIZE(PyLong_AsLongLong(ITEM(how, N)));
    PyObject *const kept = new_array(how, Py_BuildValue("LL", (long long)(count - first), (long long)width), ITEM(how, FLOAT));
    Py_buffer memory;
    if (!kept || PyObject_GetBuffer(kept, &memory, PyBUF_WRITABLE)) {
        Py_XDECREF(kept);
        return 0;
    }
    memcpy(memory.buf, zeros + width * first, memory.len);
    PyBuffer_Release(&memory);
    return Py_BuildValue("(OOON)", system, c, ITEM(beside, EXPRESSIONS), kept);
}

/* What makes a motion's fields when they are looked at: (name) -> the field. Numbers become objects only then. */
typedef struct {
    PyObject_HEAD
    PyObject *make, *rule;
    double t0, h, seconds, tol;
    Proved found;
    OnTheWay way;
} Maker;

static PyObject *made_by(PyObject *self, PyObject *given, PyObject *named) {
    const Maker *const m = (Maker *)self;
    const Proved *const f = &m->found;
    PyObject *name;
    if (!PyArg_ParseTuple(given, "O", &name)) return 0;
    PyObject *const grid = m->way.cut ? Py_BuildValue("(ddLddLd)", m->h, m->t0, (long long)f->steps, f->iterations, f->residual,
                                                      (long long)f->last, m->way.end)
                                      : Py_BuildValue("(ddLdd)", m->h, m->t0, (long long)f->steps, f->iterations, f->residual);
    return grid ? PyObject_CallFunction(m->make, "N(dddOL)OO", grid, m->seconds, m->tol, f->estimate, m->rule, (long long)f->runs,
                                        m->way.happened, name)
                : 0;
}

static void free_maker(PyObject *self) {
    Maker *const m = (Maker *)self;
    Py_DECREF(m->make), Py_DECREF(m->rule), Py_DECREF(m->way.happened);
    Py_TYPE(self)->tp_free(self);
}

static PyTypeObject maker = {PyVarObject_HEAD_INIT(NULL, 0).tp_name = "varint.codegen._direct.Maker", .tp_basicsize = sizeof(Maker),
                             .tp_flags = Py_TPFLAGS_DEFAULT | Py_TPFLAGS_DISALLOW_INSTANTIATION, .tp_call = made_by, .tp_dealloc = free_maker};

static PyObject *maker_of(PyObject *how, const Asked *asked, const Proved *found, const OnTheWay *way, double began) {
    PyObject *const now = PyObject_CallNoArgs(ITEM(how, NOW));
    Maker *const made = now ? PyObject_New(Maker, &maker) : 0;
    if (made) {
        made->make = again(ITEM(how, MAKE)), made->rule = again(ITEM(how, NAME)), made->way = *way, again(way->happened);
        made->t0 = asked->t0, made->h = asked->duration / (double)found->steps, made->tol = asked->tol, made->found = *found;
        made->seconds = PyFloat_AsDouble(now) - began;
    }
    Py_XDECREF(now);
    return (PyObject *)made;
}

/* The motion with its nodes, or at the times that are asked for. */
static PyObject *motion_of(PyObject *system, PyObject *c, PyObject *how, PyObject *places, const Asked *asked, const Proved *found,
                           const OnTheWay *way, int graded, const AtTimes *at, double began) {
    PyObject *const nodes = at->states ? again(at->states) : nodes_of(how, places, found), *const known = PyDict_Copy(ITEM(how, BLANK));
    const int has_v = PyLong_AsLongLong(ITEM(how, PARTS)) > 2;
    PyTypeObject *const type = (PyTypeObject *)ITEM(how, TYPE);
    PyObject *motion = 0;
    if (nodes && known && put(known, SYSTEM_NAME, again(system)) && put(known, Q_NAME, PySequence_GetItem(nodes, 0)) &&
        put(known, P_NAME, PySequence_GetItem(nodes, 1)) && (!has_v || at->states || put(known, V_NAME, PySequence_GetItem(nodes, 2))) &&
        (!at->states || ((!has_v || !PyDict_DelItem(known, names[V_NAME])) && put(known, T_NAME, again(at->times)) &&
                         put(known, K_NAME, again(at->whole)))) &&
        put(known, H_NAME, PyFloat_FromDouble(asked->duration / (double)found->steps)) && put(known, C_NAME, again(c)) &&
        (!graded || put_times(known, how, found)) && put(known, ORIGIN_NAME, PyFloat_FromDouble(asked->t0)) && put(known, MAKE_NAME, maker_of(how, asked, found, way, began))) {
        motion = type->tp_alloc(type, 0);
        if (motion && PyObject_GenericSetAttr(motion, names[DICT_NAME], known)) Py_CLEAR(motion); /* frozen: not its own way */
    }
    Py_XDECREF(nodes), Py_XDECREF(known);
    return motion;
}

/* A run that is wanted: the arguments of `prove`; beside, times and between are 0 where nothing of the kind is asked for. */
typedef struct {
    PyObject *how, *places, *system, *c, *rates, *beside, *times, *between;
    double t0, duration, radians, tol, began;
    int64_t first;
} Wanted;

static int is_bytes_of(PyObject *x, size_t size) { return PyBytes_Check(x) && PyBytes_GET_SIZE(x) == (Py_ssize_t)size; }

/* What is asked beside the runs; whether it is such. */
static int set_beside(PyObject *beside, Asked *to) {
    if (!beside) return 1;
    if (!is_tuple_of(beside, BESIDE) || !is_bytes_of(ITEM(beside, OPENING), sizeof to->opening) ||
        !is_bytes_of(ITEM(beside, SEARCH), sizeof to->search) || !PyTuple_Check(ITEM(beside, EXPRESSIONS)))
        return 0;
    memcpy(&to->opening, PyBytes_AS_STRING(ITEM(beside, OPENING)), sizeof to->opening);
    memcpy(&to->search, PyBytes_AS_STRING(ITEM(beside, SEARCH)), sizeof to->search);
    return 1;
}

/* The motion, at these times where it can be looked at there, with its estimated error where more is to be looked at before it is
   proved; or what the core says. */
static PyObject *proved(const Wanted *w) {
    PyObject *const how = w->how;
    if (!is_tuple_of(how, MADE) || !is_tuple_of(w->places, PLACES) || !PyTuple_Check(w->rates) || !PyTuple_GET_SIZE(w->rates) ||
        (w->times && !is_tuple_of(w->between, BETWEEN)))
        return PyErr_Format(PyExc_TypeError, "how runs are made, places and rates are needed, and how they are looked at between nodes");
    PyObject *const head = ITEM(how, HEAD), *const place = ITEM(w->places, PLACE);
    Asked asked = {w->first, w->t0, w->duration, w->radians, w->tol, PyLong_AsVoidPtr(ITEM(w->rates, 0))};
    if (!PyBytes_Check(head) || PyBytes_GET_SIZE(head) > LONGEST_COURSE || !is_bytes_of(place, sizeof(Place)) || !set_beside(w->beside, &asked))
        return PyErr_Format(PyExc_TypeError, "a course, places or what is asked beside them are of another size");
    int (*const entry)(const void *) = (int (*)(const void *))PyLong_AsVoidPtr(ITEM(how, ENTRY));
    if (PyErr_Occurred()) return 0;
    const size_t size = PyBytes_GET_SIZE(head);
    char call[LONGEST_COURSE + sizeof(Place) + sizeof(Asked)] __attribute__((aligned(8)));
    Place at;
    memcpy(call, PyBytes_AS_STRING(head), size), memcpy(&at, PyBytes_AS_STRING(place), sizeof at);
    memcpy(call + size, &at, sizeof at), memcpy(call + size + sizeof at, &asked, sizeof asked);
    int status;
    Py_BEGIN_ALLOW_THREADS
    status = entry(call);
    Py_END_ALLOW_THREADS
    const int graded = status == GRADED || status == GRADED_DOUBTED, sure = status == PROVED || status == GRADED;
    if (!sure && !graded && status != DOUBTED) return PyLong_FromLong(status);
    const Proved found = *at.found;
    const double *const zeros = asked.search.zeros;
    const int cut = found.zeros > 0 && zeros[1] == 0 && ITEM(w->beside, STOPS) == Py_True;
    const OnTheWay way = {happened_in(how, w->system, w->c, w->beside, zeros, cut, found.zeros), cut ? zeros[2] : INFINITY, cut};
    AtTimes there = {w->times, w->between};
    const int looked = way.happened && (status != PROVED || !there.times || look_between(&there, how, &asked, &at, &found));
    PyObject *const motion = looked ? motion_of(w->system, w->c, how, w->places, &asked, &found, &way, graded, &there, w->began) : 0;
    free(found.run);
    Py_XDECREF(there.states), Py_XDECREF(there.whole), Py_XDECREF(way.happened);
    return sure || !motion ? motion : Py_BuildValue("(Nd)", motion, found.estimate);
}

/* (how, places, system, c, t0, duration, first, radians, tol, rates, began[, beside or None[, times, between]]) -> what `proved`
   gives. */
static PyObject *prove(PyObject *self, PyObject *const *given, Py_ssize_t count) {
    if (count != 11 && count != 12 && count != 14) return PyErr_Format(PyExc_TypeError, "eleven arguments are needed, twelve or fourteen");
    const Wanted wanted = {given[0], given[1], given[2], given[3], given[9],
                           count > 11 && given[11] != Py_None ? given[11] : 0, count > 12 ? given[12] : 0, count > 12 ? given[13] : 0,
                           PyFloat_AsDouble(given[4]), PyFloat_AsDouble(given[5]), PyFloat_AsDouble(given[7]), PyFloat_AsDouble(given[8]),
                           PyFloat_AsDouble(given[10]), PyLong_AsLongLong(given[6])};
    return PyErr_Occurred() ? 0 : proved(&wanted);
}

#include "repeated.h"

#define FAST(name) {#name, (PyCFunction)(void (*)(void))name, METH_FASTCALL, 0}
static PyMethodDef methods[] = {FAST(prove), FAST(repeated), {0}};
static struct PyModuleDef module = {PyModuleDef_HEAD_INIT, "_direct", 0, -1, methods};

PyMODINIT_FUNC PyInit__direct(void) {
    if (PyType_Ready(&maker)) return 0;
    for (int i = 0; i < NAMES; i++)
        if (!(names[i] = PyUnicode_InternFromString(spelt[i]))) return 0;
    PyObject *const made = PyModule_Create(&module);
    return made && !PyModule_AddStringConstant(made, "digest", DIGEST) ? made : 0;
}
