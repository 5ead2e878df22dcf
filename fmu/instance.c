/* One instance of a model: its life cycle, its values, its steps, its derivatives. Names no model and no FMI version:
   the model comes in by model.h (generated tables and equations), the standard's functions are in fmi2.c and fmi3.c,
   which include this file, so that one translation unit exports nothing but them.

   Values are numbered time, states, their derivatives, inputs, parameters, other variables, stand-still flags. What an
   importer reads never changes what is computed next: algebraic variables found for a reading are kept apart (z_now)
   from those that start the next step (z).

   A sampled model (a controller, MODEL_SAMPLED) has a clock of its own: it takes a sample at its start and once a period
   after it, whatever steps the importer makes, and holds its outputs in between. */

#include <math.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "model.h"

#define LONGEST model_names[VR_Y - 1 - VR_TIME] /* the last parameter: longest step, or a sampled model's period */
#define DIM(n) ((n) > 0 ? (n) : 1)
/* Value references: from one on, so that they are the places in the list of variables, as FMI 2 counts those. */
enum { VR_TIME = 1, VR_X, VR_DX = VR_X + NX, VR_U = VR_DX + NX, VR_P = VR_U + NU, VR_Y = VR_P + NP,
       VR_STILL = VR_Y + NY, VR_END = VR_STILL + NE };

typedef enum { OK, WARNING, DISCARD, ERROR } Status; /* as in both versions of the standard */
typedef enum { MODEL_EXCHANGE, CO_SIMULATION } Kind;
enum { CREATED = 1, INITIALIZING = 2, EVENT = 4, CONTINUOUS = 8, STEPPING = 16, TERMINATED = 32, FAILED = 64,
       UPDATING = 128 }; /* in the middle of a step, while the importer is asked for inputs */
enum { RUNNING = EVENT | CONTINUOUS | STEPPING, READABLE = INITIALIZING | RUNNING | TERMINATED | FAILED,
       ANY = CREATED | READABLE };
#define TICK_ROUNDING 1e-3 /* of a period: a communication point so close to a sample is at it, as sums of steps round */
#define DIVERGED 0.5 /* of the range of a bounded state, beyond it: no solver that keeps its tolerance gets there */

/* All that a saved state holds: 8-byte fields only, so without padding and the same on every platform. */
typedef struct {
    double time, start, stop;
    double x[DIM(NX)], z[DIM(NZ)], z_now[DIM(NZ)], u[DIM(NU)], du[DIM(NU)], p[NP];
    double held[DIM(MODEL_SAMPLED * NY)]; /* outputs since the last sample */
    int64_t phase, z_fresh, has_stop, samples, still[DIM(NE)];
} State;

typedef struct Instance Instance;
typedef void Log(const Instance *m, Status status, const char *category, const char *message);
/* Asks the importer for inputs at a time within a step; true where it wants the step to end, at *end or before. */
typedef bool Update(Instance *m, double time, double *end);

struct Instance {
    State s;
    Kind kind;
    bool q_fresh, y_fresh, logging, may_return, returned;
    Log *log;
    Update *update;
    void *environment, *callback, *callback_update;
    double q[DIM(NQ)], xdot[DIM(NX)], y[DIM(NY)], x_next[DIM(NX)], z_next[DIM(NZ)]; /* q: what p alone asks for */
    double dx[DIM(NX)], du[DIM(NU)], dp[NP], dt, dxdot[DIM(NX)], dy[DIM(NY)];
    const double **arg;
    double **res, *w;
    casadi_int *iw;
    char *name, message[400];
};

/* --- messages ---------------------------------------------------------------------------------------------------- */

static Status fail(Instance *m, Status status, const char *format, ...) {
    va_list list;
    va_start(list, format);
    vsnprintf(m->message, sizeof m->message, format, list);
    va_end(list);
    if (m->log && (status >= ERROR || m->logging))
        m->log(m, status, status >= ERROR ? "logStatusError" : "logStatusDiscard", m->message);
    return status;
}

static const char *phase_name(int64_t phase) {
    switch (phase) {
    case CREATED: return "just instantiated";
    case INITIALIZING: return "in initialization mode";
    case EVENT: return "in event mode";
    case CONTINUOUS: return "in continuous-time mode";
    case STEPPING: return "in step mode";
    case UPDATING: return "in the middle of a step";
    case TERMINATED: return "terminated";
    default: return "stopped by an error; reset it, or restore a saved state";
    }
}

/* Whether a function may be called now; every function of the standard starts with it. */
static Status allowed(Instance *m, int phases, const char *function) {
    if (!m) return ERROR;
    if (m->s.phase & phases) return OK;
    return fail(m, ERROR, "%s cannot be called: the instance is %s", function, phase_name(m->s.phase));
}

static Status unsupported(Instance *m, const char *function) {
    return m ? fail(m, ERROR, "%s: this model does not have what it asks for", function) : ERROR;
}

static Status null_pointer(Instance *m, const char *function) {
    return fail(m, ERROR, "%s: a null pointer where values were expected", function);
}

/* --- life -------------------------------------------------------------------------------------------------------- */

static void to_start(Instance *m) {
    memset(&m->s, 0, sizeof m->s);
    memcpy(m->s.x, model_x_start, sizeof m->s.x);
    memcpy(m->s.u, model_u_start, sizeof m->s.u);
    memcpy(m->s.p, model_p_start, sizeof m->s.p);
    m->s.phase = CREATED;
    m->q_fresh = m->y_fresh = false;
}

static size_t larger(size_t a, casadi_int b) { return b > 0 && (size_t)b > a ? (size_t)b : a; }

/* An instance in one piece of memory, work space of the equations included; nothing is allocated after this. */
static Instance *create(Kind kind, const char *name) {
    size_t n_arg = 1, n_res = 1, n_iw = 1, n_w = 1, length = strlen(name) + 1;
    for (size_t k = 0; k < sizeof model_work / sizeof *model_work; k++) {
        casadi_int arg = 0, res = 0, iw = 0, w = 0;
        model_work[k](&arg, &res, &iw, &w);
        n_arg = larger(n_arg, arg), n_res = larger(n_res, res), n_iw = larger(n_iw, iw), n_w = larger(n_w, w);
    }
    Instance *m = calloc(1, sizeof *m + n_w * sizeof *m->w + n_arg * sizeof *m->arg + n_res * sizeof *m->res
                                + n_iw * sizeof *m->iw + length);
    if (!m) return NULL;
    m->w = (double *)(m + 1);
    m->arg = (const double **)(m->w + n_w);
    m->res = (double **)(m->arg + n_arg);
    m->iw = (casadi_int *)(m->res + n_res);
    m->name = (char *)(m->iw + n_iw);
    memcpy(m->name, name, length);
    m->kind = kind;
    to_start(m);
    return m;
}

/* Why an instance cannot be made, or NULL. */
static const char *refusal(Kind kind, const char *name, const char *token) {
    if (!name || !*name) return "the instance has no name";
    if (!token || strcmp(token, MODEL_TOKEN))
        return "the instantiation token is not this FMU's: its modelDescription.xml belongs to another binary";
    if (kind == CO_SIMULATION ? !MODEL_CS : !MODEL_ME) return "this FMU was exported without the interface asked for";
    return NULL;
}

/* --- equations --------------------------------------------------------------------------------------------------- */

static bool finite_all(const double *v, size_t n) {
    for (size_t k = 0; k < n; k++)
        if (!isfinite(v[k])) return false;
    return true;
}

static void arguments(Instance *m, const double *z) {
    m->arg[0] = m->s.x, m->arg[1] = z, m->arg[2] = m->s.u, m->arg[3] = m->s.p, m->arg[4] = &m->s.time;
}

static void changed(Instance *m) { m->s.z_fresh = m->y_fresh = false; }

/* What only the parameters ask for, worked out once for all steps that they last. */
static const double *prepared(Instance *m) {
    if (m->q_fresh) return m->q;
    m->arg[0] = m->s.p, m->res[0] = m->q;
    model_prepare(m->arg, m->res, m->iw, m->w, 0);
    m->q_fresh = true;
    return m->q;
}

/* Why there may be no solution: a fixed parameter at zero that is not zero by itself, or no inertia. */
static Status fail_to_solve(Instance *m) {
    const Status status = m->kind == MODEL_EXCHANGE ? DISCARD : ERROR;
    for (size_t k = 0; k < NP; k++)
        if (m->s.p[k] == 0 && model_p_start[k] != 0 && !model_p_tunable[k])
            return fail(m, status, "the loads have no solution at t = %g s; check '%s', which is 0, and that every joint "
                        "has inertia", m->s.time, model_names[VR_P + k - VR_TIME]);
    return fail(m, status, "the loads have no solution at t = %g s; check that every joint has inertia", m->s.time);
}

/* Algebraic variables that fit states, inputs and parameters. */
static Status solve(Instance *m) {
    if (m->s.z_fresh) return OK;
    const double *q = prepared(m);
    arguments(m, m->s.z);
    m->arg[3] = q, m->res[0] = m->s.z_now;
    if (model_initial(m->arg, m->res, m->iw, m->w, 0) || !finite_all(m->s.z_now, NZ))
        return fail_to_solve(m);
    m->s.z_fresh = true;
    return OK;
}

/* When a sampled model takes its next sample. */
static double next_sample(const Instance *m) { return m->s.start + (double)m->s.samples * m->s.p[NP - 1]; }

/* Whether outputs are those of the last sample; at a sample, a model answers to its inputs at once. */
static bool holding(const Instance *m) {
    return MODEL_SAMPLED && next_sample(m) - m->s.time > TICK_ROUNDING * m->s.p[NP - 1];
}

/* Derivatives and all other variables. */
static Status evaluate(Instance *m) {
    if (m->y_fresh) return OK;
    Status status = solve(m);
    if (status != OK) return status;
    arguments(m, m->s.z_now);
    m->res[0] = m->xdot, m->res[1] = m->y;
    model_observe(m->arg, m->res, m->iw, m->w, 0);
    if (holding(m)) memcpy(m->y, m->s.held, sizeof m->s.held);
    m->y_fresh = true;
    return OK;
}

/* What stands still changes at events only, so that nothing jumps in the middle of an importer's step. */
static Status find_still(Instance *m) {
    Status status = evaluate(m);
    for (size_t k = 0; status == OK && k < NE; k++) m->s.still[k] = m->y[NY - NE + k] < 0;
    return status;
}

/* Whether a bounded state is where no solver that keeps its tolerance takes it: a step too long for an explicit one. */
static Status check_states(Instance *m) {
    for (size_t k = 0; k < NX; k++) {
        double low = model_x_min[k], high = model_x_max[k], slack = DIVERGED * (high - low), x = m->s.x[k];
        if (isfinite(slack) && !(x >= low - slack && x <= high + slack))
            return fail(m, ERROR, "'%s' is %g at t = %g s, outside %g to %g: the integration diverged; these equations "
                        "are stiff, take an implicit solver with error control, or much shorter steps",
                        model_names[VR_X + k - VR_TIME], x, m->s.time, low, high);
    }
    return OK;
}

/* The point that was reached becomes the guess for the next one. */
static Status commit(Instance *m) {
    Status status = check_states(m);
    if (status == OK) status = solve(m);
    if (status == OK) memcpy(m->s.z, m->s.z_now, sizeof m->s.z);
    return status;
}

/* --- modes ------------------------------------------------------------------------------------------------------- */

static Status set_up(Instance *m, double start, bool has_stop, double stop) {
    if (!isfinite(start)) return fail(m, ERROR, "the start time is not a finite number");
    if (has_stop && !(stop >= start))
        return fail(m, ERROR, "the stop time %g s is before the start, %g s", stop, start);
    m->s.time = m->s.start = start;
    m->s.has_stop = has_stop;
    m->s.stop = stop;
    changed(m);
    return OK;
}

static Status exit_initialization(Instance *m) {
    Status status = commit(m);
    if (status == OK) status = find_still(m);
    m->s.phase = status != OK ? FAILED : m->kind == MODEL_EXCHANGE ? EVENT : STEPPING;
    return status == OK ? OK : ERROR;
}

static Status update_discrete(Instance *m) {
    Status status = commit(m);
    return status == OK ? find_still(m) : status;
}

/* --- values ------------------------------------------------------------------------------------------------------ */

static Status get_values(Instance *m, const uint32_t *vr, size_t n, double *value, const char *function) {
    if (n && (!vr || !value)) return null_pointer(m, function);
    for (size_t k = 0; k < n; k++) {
        uint32_t v = vr[k];
        bool computed = (v >= VR_DX && v < VR_U) || (v >= VR_Y && v < VR_STILL);
        if (v < VR_TIME || v >= VR_STILL)
            return fail(m, ERROR, "%s: %u is not the value reference of a real variable", function, v);
        Status status = computed ? evaluate(m) : OK;
        if (status != OK) return status;
        value[k] = v < VR_X    ? m->s.time
                   : v < VR_DX ? m->s.x[v - VR_X]
                   : v < VR_U  ? m->xdot[v - VR_DX]
                   : v < VR_P  ? m->s.u[v - VR_U]
                   : v < VR_Y  ? m->s.p[v - VR_P]
                               : m->y[v - VR_Y];
    }
    return OK;
}

static Status get_still(Instance *m, uint32_t vr, bool *value, const char *function) {
    if (vr < VR_STILL || vr >= VR_END)
        return fail(m, ERROR, "%s: %u is not the value reference of a Boolean variable", function, vr);
    Status status = m->s.phase == CONTINUOUS ? OK : find_still(m);
    *value = m->s.still[vr - VR_STILL] != 0;
    return status;
}

/* Why a value may not be set now, or OK. */
static Status settable(Instance *m, uint32_t v, double value, const char *function) {
    const int before = CREATED | INITIALIZING;
    if (v < VR_TIME || v >= VR_STILL)
        return fail(m, ERROR, "%s: %u is not the value reference of a real variable", function, v);
    const char *name = model_names[v - VR_TIME];
    if (!isfinite(value))
        return fail(m, ERROR, "%s: '%s' cannot be set to %g, which is not finite", function, name, value);
    if (v >= VR_X && v < VR_DX) { /* importers of model exchange, CasADi among them, set states one by one as well */
        double low = model_x_min[v - VR_X], high = model_x_max[v - VR_X];
        if ((m->s.phase & before) && !(value >= low && value <= high))
            return fail(m, ERROR, "%s: %g is outside the bounds of '%s', %g to %g", function, value, name, low, high);
        if (m->s.phase & (before | EVENT | CONTINUOUS)) return OK;
        return fail(m, ERROR, "%s: the state '%s' can be set before the end of the initialization only", function,
                    name);
    }
    if (v >= VR_U && v < VR_P) return OK;
    if (v < VR_P || v >= VR_Y) return fail(m, ERROR, "%s: '%s' is computed and cannot be set", function, name);
    if (m->s.phase == UPDATING)
        return fail(m, ERROR, "%s: '%s' is a parameter; in the middle of a step, inputs can be set", function, name);
    double low = model_p_min[v - VR_P], high = model_p_max[v - VR_P];
    if (!(value >= low && value <= high))
        return fail(m, ERROR, "%s: %g is outside the bounds of '%s', %g to %g", function, value, name, low, high);
    if (m->s.phase & before) return OK;
    if (!model_p_tunable[v - VR_P])
        return fail(m, ERROR, "%s: the fixed parameter '%s' can be set before the end of the initialization only",
                    function, name);
    if (m->s.phase == CONTINUOUS)
        return fail(m, ERROR, "%s: the parameter '%s' can be changed in event mode, not in between", function, name);
    return OK;
}

/* All or nothing: a refused value leaves the others as they were. */
static Status set_values(Instance *m, const uint32_t *vr, size_t n, const double *value, const char *function) {
    if (n && (!vr || !value)) return null_pointer(m, function);
    for (size_t k = 0; k < n; k++)
        if (settable(m, vr[k], value[k], function) != OK) return ERROR;
    for (size_t k = 0; k < n; k++) {
        uint32_t v = vr[k];
        double *place = v < VR_DX ? &m->s.x[v - VR_X] : v < VR_P ? &m->s.u[v - VR_U] : &m->s.p[v - VR_P];
        if (*place == value[k]) continue;
        *place = value[k];
        if (v >= VR_P) m->q_fresh = false;
        changed(m);
    }
    return OK;
}

static Status set_states(Instance *m, const double *x, size_t n, const char *function) {
    if (n != NX) return fail(m, ERROR, "%s: %zu values for %d states", function, n, NX);
    if (n && !x) return null_pointer(m, function);
    if (!finite_all(x, n)) return fail(m, ERROR, "%s: a state is not finite at t = %g s", function, m->s.time);
    if (n && memcmp(m->s.x, x, n * sizeof *x)) changed(m);
    if (n) memcpy(m->s.x, x, n * sizeof *x);
    return OK;
}

static Status set_time(Instance *m, double time, const char *function) {
    if (!isfinite(time)) return fail(m, ERROR, "%s: the time is not finite", function);
    if (time != m->s.time) changed(m);
    m->s.time = time;
    return OK;
}

static Status get_vector(Instance *m, const double *from, size_t have, double *to, size_t n, const char *function) {
    if (n != have) return fail(m, ERROR, "%s: room for %zu values, the model has %zu", function, n, have);
    if (n && !to) return null_pointer(m, function);
    if (n) memcpy(to, from, n * sizeof *to);
    return OK;
}

/* What model exchange reads as a whole: states, their derivatives, event indicators. */
static Status read_vector(Instance *m, uint32_t first, size_t have, double *to, size_t n, const char *function) {
    Status status = allowed(m, INITIALIZING | EVENT | CONTINUOUS | TERMINATED | FAILED, function);
    if (status != OK || first == VR_X) return status != OK ? status : get_vector(m, m->s.x, have, to, n, function);
    status = evaluate(m);
    if (status != OK) return status;
    return get_vector(m, first == VR_DX ? m->xdot : &m->y[NY - NE], have, to, n, function);
}

/* --- co-simulation ----------------------------------------------------------------------------------------------- */

/* Whether a step was short enough for the motion: by how much the trapezoidal rule misses what each angle moved. */
static bool resolved(const Instance *m, double h) {
    for (size_t k = 0; k < NX; k++) {
        int j = model_speed_of[k];
        if (j < 0) continue;
        if (!(fabs(m->x_next[k] - m->s.x[k] - h * (m->s.x[j] + m->x_next[j]) / 2) <= MODEL_GAP)) return false;
    }
    return true;
}

static bool step_once(Instance *m, double t, double h, double since) {
    double left[DIM(NU)], right[DIM(NU)];
    for (size_t k = 0; k < NU; k++) {
        left[k] = m->s.u[k] + m->s.du[k] * since;
        right[k] = m->s.u[k] + m->s.du[k] * (since + h);
    }
    const double *in[] = {m->s.x, m->s.z, left, right, prepared(m), &t, &h};
    memcpy(m->arg, in, sizeof in);
    double error = 0; /* of the equations, relative to what is tolerated */
    m->res[0] = m->x_next, m->res[1] = m->z_next, m->res[2] = &error;
    if (model_step(m->arg, m->res, m->iw, m->w, 0) || !(error <= 1)) return false;
    if (!finite_all(m->x_next, NX) || !finite_all(m->z_next, NZ) || !resolved(m, h)) return false;
    memcpy(m->s.x, m->x_next, sizeof m->s.x);
    memcpy(m->s.z, m->z_next, sizeof m->s.z);
    return true;
}

static Status check_step(Instance *m, double t, double h) {
    if (!isfinite(t) || !isfinite(h) || h <= 0)
        return fail(m, ERROR, "a step of %g s from t = %g s: both must be finite, the step above zero", h, t);
    /* n h and a sum of h differ by rounding; anything more is a mistake of the importer */
    if (fabs(t - m->s.time) > 1e-3 * h + 1e-9 * fabs(t))
        return fail(m, ERROR, "a step from t = %.12g s, but the instance is at %.12g s", t, m->s.time);
    if (m->s.has_stop && t + h > m->s.stop + 1e-3 * h + 1e-9 * fabs(t))
        return fail(m, ERROR, "a step to t = %.12g s, past the stop time %.12g s", t + h, m->s.stop);
    if (t + h == t) return fail(m, ERROR, "a step of %g s is lost in rounding at t = %g s", h, t);
    if (h / m->s.p[NP - 1] > 1e8)
        return fail(m, ERROR, "a step of %g s is more than 1e8 times %s, %g s", h, LONGEST, m->s.p[NP - 1]);
    return OK;
}

/* One integration step; where it has no solution, or is too long for the motion, two of half its length, and so on. */
static bool integrate(Instance *m, double t, double h, double since, int halvings) {
    if (step_once(m, t, h, since)) return true;
    if (!halvings) return false;
    return integrate(m, t, h / 2, since, halvings - 1)
           && integrate(m, t + h / 2, h / 2, since + h / 2, halvings - 1);
}

/* The sample that is due, with inputs as they are since the start of the communication step. */
static bool take_sample(Instance *m, double since) {
    double u[DIM(NU)];
    for (size_t k = 0; k < NU; k++) u[k] = m->s.u[k] + m->s.du[k] * since;
    const double *q = prepared(m);
    arguments(m, m->s.z);
    m->arg[2] = u, m->res[0] = m->xdot, m->res[1] = m->y;
    model_observe(m->arg, m->res, m->iw, m->w, 0);
    memcpy(m->s.held, m->y, sizeof m->s.held);
    const double *in[] = {m->s.x, m->s.z, u, u, q, &m->s.time, &m->s.p[NP - 1]};
    memcpy(m->arg, in, sizeof in);
    double error = 0;
    m->res[0] = m->x_next, m->res[1] = m->z_next, m->res[2] = &error;
    if (model_step(m->arg, m->res, m->iw, m->w, 0) || !finite_all(m->x_next, NX)) return false;
    memcpy(m->s.x, m->x_next, sizeof m->s.x);
    m->s.samples++;
    return true;
}

/* Samples from t on, the one at its end left to the next step; *done is how far this went. */
static bool take_samples(Instance *m, double t, double h, double *done) {
    double end = t + h - TICK_ROUNDING * m->s.p[NP - 1];
    for (double next = next_sample(m); next <= end; next = next_sample(m)) {
        *done = fmax(0, next - t);
        if (!take_sample(m, *done)) return false;
    }
    *done = h;
    return true;
}

/* Equal integration steps no longer than solver.step; *done is how far they went. Between them the importer may give
   inputs and end the communication step, where it asked for that. */
static bool take_steps(Instance *m, double t, double h, double *done) {
    double count = ceil(h / m->s.p[NP - 1] - 1e-6), part, end = h;
    long n = count < 1 ? 1 : (long)count;
    part = h / n;
    for (long k = 0; k < n; k++) {
        double since = k * part, length = part;
        *done = since;
        if (k && m->update) {
            double wanted = t + h;
            m->s.time = t + since;
            memcpy(m->s.z_now, m->s.z, sizeof m->s.z);
            m->s.z_fresh = true, m->y_fresh = false;
            m->s.phase = UPDATING;
            if (m->update(m, t + since, &wanted)) m->returned = true, end = fmax(since, fmin(end, wanted - t));
            m->s.phase = STEPPING;
            if (m->returned && end - since < 1e-6 * part) return true;
        }
        if (m->returned) length = fmin(part, end - since);
        if (!integrate(m, t + since, length, since, MODEL_HALVINGS)) return false;
        if (length < part) {
            *done = since + length;
            return true;
        }
    }
    *done = h;
    return true;
}

/* A communication step; one that fails leaves everything as it was before. */
static Status do_step(Instance *m, double t, double h) {
    Status status = check_step(m, t, h);
    if (status != OK) return status;
    double x[DIM(NX)], z[DIM(NZ)], u[DIM(NU)], now = m->s.time, done = 0;
    int64_t samples = m->s.samples;
    memcpy(x, m->s.x, sizeof x);
    memcpy(z, m->s.z, sizeof z);
    memcpy(u, m->s.u, sizeof u);
    m->returned = false;
    if (!(MODEL_SAMPLED ? take_samples : take_steps)(m, t, h, &done)) {
        memcpy(m->s.x, x, sizeof x);
        memcpy(m->s.z, z, sizeof z);
        memcpy(m->s.u, u, sizeof u);
        m->s.samples = samples;
        m->s.time = now;
        m->s.phase = FAILED;
        changed(m);
        return fail(m, ERROR, "no solution for the step from t = %g s; take a smaller %s than %g s, or check inputs and "
                    "parameters; the instance is as before this call", t + done, LONGEST, m->s.p[NP - 1]);
    }
    for (size_t k = 0; k < NU; k++) m->s.u[k] += m->s.du[k] * done, m->s.du[k] = 0;
    memcpy(m->s.z_now, m->s.z, sizeof m->s.z);
    m->s.time = t + done;
    m->s.z_fresh = true;
    m->y_fresh = false;
    return OK;
}

/* --- derivatives ------------------------------------------------------------------------------------------------- */

/* Where a variable's seed or sensitivity stands: NULL when it is neither known nor, for unknowns, computed. */
static double *known_slot(Instance *m, uint32_t v) {
    if (v == VR_TIME) return &m->dt;
    if (v >= VR_X && v < VR_DX) return &m->dx[v - VR_X];
    if (v >= VR_U && v < VR_P) return &m->du[v - VR_U];
    return v >= VR_P && v < VR_Y ? &m->dp[v - VR_P] : NULL;
}

static double *unknown_slot(Instance *m, uint32_t v) {
    if (v >= VR_X && v < VR_DX) return &m->dx[v - VR_X]; /* an output that is a state */
    if (v >= VR_DX && v < VR_U) return &m->dxdot[v - VR_DX];
    return v >= VR_Y && v < VR_STILL ? &m->dy[v - VR_Y] : NULL;
}

static Status check_slots(Instance *m, const uint32_t *vr, size_t n, bool known, const char *function) {
    if (n && !vr) return null_pointer(m, function);
    for (size_t k = 0; k < n; k++)
        if (!(known ? known_slot(m, vr[k]) : unknown_slot(m, vr[k])))
            return fail(m, ERROR, "%s: value reference %u cannot be %s of a derivative", function, vr[k],
                        known ? "a known" : "an unknown");
    return OK;
}

static void clear_slots(Instance *m) {
    memset(m->dx, 0, sizeof m->dx);
    memset(m->du, 0, sizeof m->du);
    memset(m->dp, 0, sizeof m->dp);
    memset(m->dxdot, 0, sizeof m->dxdot);
    memset(m->dy, 0, sizeof m->dy);
    m->dt = 0;
}

static Status check_derivative(Instance *m, const uint32_t *unknown, size_t n_unknown, const uint32_t *known,
                               size_t n_known, const double *seed, size_t n_seed, const double *result,
                               const char *function) {
    if (check_slots(m, unknown, n_unknown, false, function) != OK) return ERROR;
    if (check_slots(m, known, n_known, true, function) != OK) return ERROR;
    if ((n_seed && !seed) || !result) return null_pointer(m, function);
    if (!finite_all(seed, n_seed)) return fail(m, ERROR, "%s: a seed is not finite", function);
    return solve(m);
}

/* sensitivity = (d unknown / d known) seed */
static Status directional(Instance *m, const uint32_t *unknown, size_t n_unknown, const uint32_t *known, size_t n_known,
                          const double *seed, double *sensitivity, const char *function) {
    Status status = check_derivative(m, unknown, n_unknown, known, n_known, seed, n_known, sensitivity, function);
    if (status != OK) return status;
    clear_slots(m);
    for (size_t k = 0; k < n_known; k++) *known_slot(m, known[k]) += seed[k];
    arguments(m, m->s.z_now);
    m->arg[5] = m->dx, m->arg[6] = m->du, m->arg[7] = m->dp, m->arg[8] = &m->dt;
    m->res[0] = m->dxdot, m->res[1] = m->dy;
    if (model_forward(m->arg, m->res, m->iw, m->w, 0))
        return fail(m, ERROR, "%s: the equations are singular at t = %g s", function, m->s.time);
    if (holding(m)) memset(m->dy, 0, sizeof m->dy);
    for (size_t k = 0; k < n_unknown; k++) sensitivity[k] = *unknown_slot(m, unknown[k]);
    return OK;
}

/* First derivatives of variables by time, inputs held. */
static Status time_derivatives(Instance *m, const uint32_t *vr, size_t n, const int32_t *order, double *value,
                               const char *function) {
    if (!n) return OK;
    if (!vr || !order || !value) return null_pointer(m, function);
    for (size_t k = 0; k < n; k++)
        if (order[k] != 1) return fail(m, ERROR, "%s: order %d; there is the first derivative only", function, order[k]);
    Status status = check_slots(m, vr, n, false, function);
    if (status == OK) status = evaluate(m);
    if (status != OK) return status;
    clear_slots(m);
    memcpy(m->dx, m->xdot, sizeof m->dx);
    m->dt = 1;
    arguments(m, m->s.z_now);
    m->arg[5] = m->dx, m->arg[6] = m->du, m->arg[7] = m->dp, m->arg[8] = &m->dt;
    m->res[0] = m->dxdot, m->res[1] = m->dy;
    if (model_forward(m->arg, m->res, m->iw, m->w, 0))
        return fail(m, ERROR, "%s: the equations are singular at t = %g s", function, m->s.time);
    for (size_t k = 0; k < n; k++) value[k] = MODEL_SAMPLED ? 0 : *unknown_slot(m, vr[k]);
    return OK;
}

/* --- saved states ------------------------------------------------------------------------------------------------ */

static const char state_magic[8] = "pycosim";
enum { STATE_VERSION = 2, TOKEN_ROOM = 48 };

typedef struct {
    char magic[8];
    State s;
} Saved;

typedef struct {
    char magic[8];
    uint32_t version, kind;
    uint64_t length;
    char token[TOKEN_ROOM];
    State s;
    uint64_t checksum;
} Serialized;

static uint64_t checksum(const void *data, size_t n) { /* FNV-1a, 64 bit */
    uint64_t hash = 14695981039346656037u;
    for (const unsigned char *p = data, *end = p + n; p < end; p++) hash = (hash ^ *p) * 1099511628211u;
    return hash;
}

static Status save(Instance *m, void **state, const char *function) {
    if (!state) return null_pointer(m, function);
    Saved *saved = *state ? *state : calloc(1, sizeof *saved);
    if (!saved) return fail(m, ERROR, "%s: no memory for the state", function);
    memcpy(saved->magic, state_magic, sizeof state_magic);
    saved->s = m->s;
    *state = saved;
    return OK;
}

static Status check_saved(Instance *m, const Saved *saved, const char *function) {
    if (!saved) return null_pointer(m, function);
    if (memcmp(saved->magic, state_magic, sizeof state_magic)) return fail(m, ERROR, "%s: not a saved state", function);
    return OK;
}

static Status restore(Instance *m, const Saved *saved, const char *function) {
    if (check_saved(m, saved, function) != OK) return ERROR;
    m->s = saved->s;
    m->q_fresh = m->y_fresh = false;
    return OK;
}

static void release(void **state) {
    if (!state || !*state) return;
    memset(*state, 0, sizeof state_magic); /* so that a second use is noticed where it can be */
    free(*state);
    *state = NULL;
}

static Status serialize(Instance *m, const Saved *saved, void *bytes, size_t n, const char *function) {
    Serialized out = {0};
    if (check_saved(m, saved, function) != OK) return ERROR;
    if (!bytes) return null_pointer(m, function);
    if (n < sizeof out) return fail(m, ERROR, "%s: room for %zu bytes, the state takes %zu", function, n, sizeof out);
    memcpy(out.magic, state_magic, sizeof state_magic);
    out.version = STATE_VERSION;
    out.kind = m->kind;
    out.length = sizeof out;
    snprintf(out.token, sizeof out.token, "%s", MODEL_TOKEN);
    out.s = saved->s;
    out.checksum = checksum(&out, offsetof(Serialized, checksum));
    memcpy(bytes, &out, sizeof out);
    return OK;
}

static Status deserialize(Instance *m, const void *bytes, size_t n, void **state, const char *function) {
    Serialized in;
    if (!bytes || !state) return null_pointer(m, function);
    if (n < sizeof in)
        return fail(m, ERROR, "%s: %zu bytes, a state takes %zu: it is truncated", function, n, sizeof in);
    memcpy(&in, bytes, sizeof in);
    if (memcmp(in.magic, state_magic, sizeof state_magic) || in.version != STATE_VERSION || in.length != sizeof in)
        return fail(m, ERROR, "%s: not a state that this version wrote", function);
    if (strncmp(in.token, MODEL_TOKEN, sizeof in.token) || in.kind != (uint32_t)m->kind)
        return fail(m, ERROR, "%s: the state of another FMU, or of its other interface", function);
    if (in.checksum != checksum(&in, offsetof(Serialized, checksum)))
        return fail(m, ERROR, "%s: the state is damaged, its checksum does not fit", function);
    Saved *saved = *state ? *state : calloc(1, sizeof *saved);
    if (!saved) return fail(m, ERROR, "%s: no memory for the state", function);
    memcpy(saved->magic, state_magic, sizeof state_magic);
    saved->s = in.s;
    *state = saved;
    return OK;
}

/* --- logging ----------------------------------------------------------------------------------------------------- */

static Status set_logging(Instance *m, bool on, size_t n, const char *const *categories) {
    for (size_t k = 0; k < n; k++) {
        const char *name = categories ? categories[k] : NULL;
        if (!name || (strcmp(name, "logStatusError") && strcmp(name, "logStatusDiscard")))
            return fail(m, ERROR, "no log category '%s'; there are logStatusError and logStatusDiscard",
                        name ? name : "(null)");
    }
    m->logging = on;
    return OK;
}
