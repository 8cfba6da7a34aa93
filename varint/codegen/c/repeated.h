/* A default call as the last one was, of a start and a duration that are there already: nothing of it is looked at once more in
   Python, which takes longer than the run. What is asked in another way, or of something else, goes the longer way.

   direct.c includes this file. */

/* The arguments of `simulate`, as they stand there. */
enum { SYSTEM, RULE, Q0, V0, P0, H, STEPS_OF, DURATION, T0, CONTROLS, PARAMS, SAVE_EVERY, AT, UNTIL, EVENTS, TIME_SCALE, TOL, SCALE,
       ITERATION_TOL, PROGRESS, BACKEND, CHECKPOINT, ON_FAILURE, ARGUMENTS };
static const int unasked[] = {P0, H, STEPS_OF, CONTROLS, PARAMS, AT, TIME_SCALE, SCALE, ITERATION_TOL, CHECKPOINT};

/* Fields of Repeated in varint/integration/repeated.py */
enum { LAST, STATE, LAST_RULE, BY_DEFAULT, LAST_ROOM, POOL, THERE, HIGH, KERNEL, HOW, IN_PLACES, PARAMETERS, RATES, LAST_BESIDE, WATCHED, REPEATED };
enum { EXPRESSION, NODE }; /* of what was watched for */
typedef struct { double t0, duration, tol, default_tol, radians, first; } Last;

/* Whether a number is this one, to its sign where it is zero; it is one of Python's own. */
static int is_number(PyObject *x, double wanted) {
    int over = 0;
    const double own = PyFloat_Check(x) ? PyFloat_AS_DOUBLE(x) : PyLong_CheckExact(x) ? (double)PyLong_AsLongLongAndOverflow(x, &over) : NAN;
    return !over && fabs(own) < 0x1p53 && !memcmp(&own, &wanted, sizeof own);
}

/* Whether these are n such numbers, as an array or one by one. */
static int are_numbers(PyObject *x, const double *wanted, Py_ssize_t n) {
    if (PyList_CheckExact(x) || PyTuple_CheckExact(x)) {
        if (PySequence_Fast_GET_SIZE(x) != n) return 0;
        PyObject **const each = PySequence_Fast_ITEMS(x);
        for (Py_ssize_t i = 0; i < n; i++)
            if (!is_number(each[i], wanted[i])) return 0;
        return 1;
    }
    if (!PyObject_CheckBuffer(x)) return n == 1 && is_number(x, *wanted);
    Py_buffer memory;
    if (PyObject_GetBuffer(x, &memory, PyBUF_C_CONTIGUOUS | PyBUF_FORMAT)) return PyErr_Clear(), 0;
    const int same = memory.ndim == 1 && memory.len == n * (Py_ssize_t)sizeof(double) && memory.format && !strcmp(memory.format, "d") &&
                     !memcmp(memory.buf, wanted, memory.len);
    PyBuffer_Release(&memory);
    return same;
}

/* Whether an expression is the one that was watched for, which may have been changed in place. */
static int is_watched(PyObject *x, PyObject *watched) {
    if (x != ITEM(watched, EXPRESSION)) return 0;
    PyObject *const node = PyObject_CallMethodNoArgs(x, names[ELEMENT_HASH_NAME]);
    const int same = node && PyObject_RichCompareBool(node, ITEM(watched, NODE), Py_EQ) == 1;
    Py_XDECREF(node);
    PyErr_Clear(); /* said elsewhere */
    return same;
}

/* Whether the same is watched for, by the same names. */
static int are_watched(PyObject *until, PyObject *events, PyObject *ready) {
    PyObject *const watched = ITEM(ready, WATCHED), *key, *x;
    const Py_ssize_t ends = until != Py_None, count = PyTuple_GET_SIZE(watched);
    if (ends ? !count || !is_watched(until, ITEM(watched, 0)) : count && ITEM(ITEM(ready, LAST_BESIDE), STOPS) == Py_True) return 0;
    if (events == Py_None) return count == ends;
    if (!PyDict_CheckExact(events) || !count || PyDict_GET_SIZE(events) != count - ends) return 0;
    Py_ssize_t at = 0, i = ends;
    while (PyDict_Next(events, &at, &key, &x)) {
        const int named = PyObject_RichCompareBool(key, ITEM(ITEM(ITEM(ready, LAST_BESIDE), EXPRESSIONS), i), Py_EQ);
        if (named < 0) PyErr_Clear();
        if (named != 1 || !is_watched(x, ITEM(watched, i++))) return 0;
    }
    return 1;
}

/* Whether nothing is asked for but what was asked for last. */
static int is_asked_again(PyObject *const *given, PyObject *ready, const Last *last) {
    for (size_t i = 0; i < sizeof unasked / sizeof *unasked; i++)
        if (given[unasked[i]] != Py_None) return 0;
    if (given[RULE] != ITEM(ready, LAST_RULE) || (given[PROGRESS] != Py_None && given[PROGRESS] != Py_False)) return 0;
    PyObject *const words[] = {given[BACKEND], given[ON_FAILURE], given[SAVE_EVERY]};
    for (int i = 0; i < 3; i++)
        if (words[i] != ITEM(ITEM(ready, BY_DEFAULT), i)) return 0;
    const Py_ssize_t n = PyBytes_GET_SIZE(ITEM(ready, STATE)) / (2 * sizeof(double));
    const double *const state = (const double *)PyBytes_AS_STRING(ITEM(ready, STATE));
    if (given[TOL] == Py_None ? last->tol != last->default_tol : !PyFloat_CheckExact(given[TOL]) || PyFloat_AS_DOUBLE(given[TOL]) != last->tol)
        return 0;
    return is_number(given[DURATION], last->duration) && is_number(given[T0], last->t0) && are_numbers(given[Q0], state, n) &&
           are_numbers(given[V0], state + n, n) && are_watched(given[UNTIL], given[EVENTS], ready);
}

/* Whether the start is in its room, which nobody uses, and the loop the one that runs now. */
static int is_there(PyObject *ready) {
    PyObject *const pool = ITEM(ready, POOL), *const high = ITEM(ready, HIGH), *const room = ITEM(ready, LAST_ROOM);
    const Py_ssize_t free = PyList_GET_SIZE(pool);
    if (!free || PyList_GET_ITEM(pool, free - 1) != room) return 0;
    if (!PyList_GET_SIZE(high) || PyList_GET_ITEM(high, 0) != ITEM(ready, KERNEL)) return 0;
    PyObject *const known = PyObject_GetAttr(room, names[KNOWN_NAME]);
    Py_XDECREF(known);
    return known == ITEM(ready, THERE);
}

/* (the arguments of `simulate`) -> its motion, or None where another way is to be taken. */
static PyObject *repeated(PyObject *self, PyObject *const *given, Py_ssize_t count) {
    if (count != ARGUMENTS) return PyErr_Format(PyExc_TypeError, "the arguments of simulate are needed");
    PyObject *const own = PyObject_GenericGetDict(given[SYSTEM], 0), *const ready = own ? PyDict_GetItemWithError(own, names[REPEATED_NAME]) : 0;
    PyObject *found = 0;
    Last last;
    Py_XDECREF(own); /* the system has it */
    if (!ready || !is_tuple_of(ready, REPEATED)) return PyErr_Occurred() ? 0 : again(Py_None);
    memcpy(&last, PyBytes_AS_STRING(ITEM(ready, LAST)), sizeof last);
    again(ready);
    if (is_asked_again(given, ready, &last) && is_there(ready)) {
        PyObject *const pool = ITEM(ready, POOL), *const how = ITEM(ready, HOW), *const now = PyObject_CallNoArgs(ITEM(how, NOW));
        const Py_ssize_t free = PyList_GET_SIZE(pool) - 1;
        if (now && !PyList_SetSlice(pool, free, free + 1, 0)) { /* as long as it runs the room is nobody else's */
            const Wanted wanted = {how, ITEM(ready, IN_PLACES), given[SYSTEM], ITEM(ready, PARAMETERS), PyList_GET_ITEM(ITEM(ready, RATES), 0),
                                   ITEM(ready, LAST_BESIDE) == Py_None ? 0 : ITEM(ready, LAST_BESIDE), 0, 0, last.t0, last.duration, last.radians, last.tol, PyFloat_AsDouble(now), (int64_t)last.first};
            found = proved(&wanted);
            if (PyList_Append(pool, ITEM(ready, LAST_ROOM))) Py_CLEAR(found);
        }
        Py_XDECREF(now);
        if (found && (PyObject *)Py_TYPE(found) != ITEM(how, TYPE)) Py_CLEAR(found); /* more is to be looked at */
    }
    Py_DECREF(ready);
    return found || PyErr_Occurred() ? found : again(Py_None);
}
