/* A drive as an actuator plugin of MuJoCo. Before this come, generated: DRIVE (identifier), DRIVE_NAME, sizes NM (motors),
   NX (friction states), NP (parameters), NQ (what they alone ask for), drive_names, drive_start, drive_low, drive_high,
   and the law: drive_prepare, drive_implicit, drive_follow.

   One instance has one or many drives: its actuators in their order, NM a drive. An actuator's length is its motor's
   angle, its control drives the motor, its force is the torque at that angle. The speed v at the end of the step follows
   from v = b + h A tau(v): A is what the bodies move for a unit of torque, b what they would do without the drives; all
   drives of an instance are solved for together, by Newton's method. What constraints (contacts, stops, equalities) did
   in the last step is taken as what they will do in this one. */

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <mujoco/mujoco.h>

#define SMALL 1e-6      /* of a correction of a speed, relative and of 1 rad/s; its square is what it leaves */
#define PLAIN 8         /* corrections taken whole */
#define MOST 30         /* then shortened ones, as far as the equations fail less */

typedef struct {
  int n, nv;                                       /* actuators, degrees of freedom of the engine */
  int *output, *control;                           /* of each actuator */
  double q[NQ];
  double *moved, *mobility, *by, *scale;           /* half of inv(M) over each actuator (n x nv), A, one more, sqrt(1/D) */
  double *free, *v, *tau, *slope, *miss, *matrix;  /* b, v, torque, its slope (n x NM), what is left, Jacobian */
  double *change, *trial, *trial_tau, *trial_slope, *trial_miss;
} Drive;

static int count(const mjModel *m, int instance) {
  int n = 0;
  for (int i = 0; i < m->nactuator; ++i) n += m->actuator_plugin[i] == instance;
  return n;
}

static int nstate(const mjModel *m, int instance) {
  int n = count(m, instance);
  return n / NM * NX + n; /* friction states; acceleration of each actuator that constraints made in the last step */
}

static void destroy(mjData *d, int instance) {
  Drive *e = (Drive *)d->plugin_data[instance];
  if (e) {
    free(e->output);
    free(e->moved);
    free(e);
  }
  d->plugin_data[instance] = 0;
}

/* Parameters of an instance: its own, or those identified; 0 where one is no number within its bounds. */
static int configure(const mjModel *m, int instance, Drive *e) {
  double p[NP + 1];
  for (int i = 0; i < NP; ++i) {
    const char *text = mj_getPluginConfig(m, instance, drive_names[i]);
    char *end = 0;
    p[i] = text && *text ? strtod(text, &end) : drive_start[i];
    if ((end && *end) || !(p[i] >= drive_low[i] && p[i] <= drive_high[i])) {
      mju_warning("%s: '%s' is '%s'; give a number from %g to %g", DRIVE_NAME, drive_names[i], text, drive_low[i],
                  drive_high[i]);
      return 0;
    }
  }
  drive_prepare(p, e->q);
  return 1;
}

static int init(const mjModel *m, mjData *d, int instance) {
  int n = count(m, instance), nv = m->nv, at = 0;
  d->plugin_data[instance] = 0;
  if (n % NM) {
    mju_warning("%s: %d actuators share an instance; a drive has %d, in the order of its motors", DRIVE_NAME, n, NM);
    return -1;
  }
  if (m->opt.integrator == mjINT_RK4) {
    mju_warning("%s: friction is implicit in the speed at the end of a step; take Euler, implicit or implicitfast",
                DRIVE_NAME);
    return -1;
  }
  Drive *e = (Drive *)calloc(1, sizeof(Drive));
  size_t numbers = (size_t)n * nv + 2 * (size_t)n * n + 2 * (size_t)nv + 8 * (size_t)n + 2 * (size_t)n * NM;
  if (e) e->output = (int *)calloc(2 * (size_t)n + 1, sizeof(int));
  if (e) e->moved = (double *)calloc(numbers + 1, sizeof(double));
  d->plugin_data[instance] = (uintptr_t)e;
  if (!e || !e->output || !e->moved || !configure(m, instance, e)) {
    destroy(d, instance);
    return -1;
  }
  e->n = n, e->nv = nv, e->control = e->output + n;
  e->mobility = e->moved + n * nv, e->matrix = e->mobility + n * n, e->by = e->matrix + n * n, e->scale = e->by + nv;
  e->free = e->scale + nv, e->v = e->free + n, e->tau = e->v + n, e->miss = e->tau + n, e->trial = e->miss + n;
  e->trial_tau = e->trial + n, e->trial_miss = e->trial_tau + n, e->change = e->trial_miss + n;
  e->slope = e->change + n;
  e->trial_slope = e->slope + n * NM;
  for (int i = 0; i < m->nactuator; ++i) {
    if (m->actuator_plugin[i] != instance) continue;
    e->output[at] = m->actuator_outadr[i];
    e->control[at++] = m->actuator_ctrladr[i];
  }
  return 0;
}

static void reset(const mjModel *m, mjtNum *state, void *data, int instance) {
  (void)data;
  memset(state, 0, m->plugin_statenum[instance] * sizeof(mjtNum));
}

/* The half x <- D^-1/2 L^-T x of a solution with the inertia M = L' D L of the engine. */
static void half(const mjModel *m, const mjData *d, const double *scale, double *x) {
  for (int i = m->nv - 1; i >= 0; --i) {
    if (x[i] == 0) continue;
    const int first = m->M_rowadr[i], last = first + m->M_rownnz[i] - 1;
    for (int k = first; k < last; ++k) x[m->M_colind[k]] -= d->qLD[k] * x[i];
    x[i] *= scale[i];
  }
}

static void add_moment(const mjData *d, int output, double by, double *x) {
  const int first = d->moment_rowadr[output], last = first + d->moment_rownnz[output];
  for (int k = first; k < last; ++k) x[d->moment_colind[k]] += by * d->actuator_moment[k];
}

static double larger(double so_far, double change, double of) {
  const double size = fabs(change) / (1 + fabs(of));
  return size <= so_far ? so_far : size;
}

static double dot(const double *a, const double *b, int n) {
  double s0 = 0, s1 = 0, s2 = 0, s3 = 0; /* four sums, which a processor forms side by side */
  int i = 0;
  for (; i < n - 3; i += 4) {
    s0 += a[i] * b[i], s1 += a[i + 1] * b[i + 1];
    s2 += a[i + 2] * b[i + 2], s3 += a[i + 3] * b[i + 3];
  }
  for (; i < n; ++i) s0 += a[i] * b[i];
  return (s0 + s1) + (s2 + s3);
}

/* What the bodies would do without the drives, and what they do for them. */
static void see_bodies(const mjModel *m, mjData *d, int instance, Drive *e, const double *constrained) {
  const int n = e->n, nv = e->nv;
  const double h = m->opt.timestep;
  for (int i = 0; i < nv; ++i) {
    e->scale[i] = sqrt(d->qLDiagInv[i]);
    e->by[i] = d->qfrc_passive[i] - d->qfrc_bias[i] + d->qfrc_applied[i];
  }
  for (int i = 1; i < m->nbody; ++i) {
    const mjtNum *f = d->xfrc_applied + 6 * i;
    if (f[0] != 0 || f[1] != 0 || f[2] != 0 || f[3] != 0 || f[4] != 0 || f[5] != 0)
      mj_applyFT(m, d, f, f + 3, d->xipos + 3 * i, i, e->by);
  }
  for (int i = 0; i < m->nactuator; ++i) {
    if (m->actuator_plugin[i] == instance) continue;
    for (int k = m->actuator_outadr[i]; k < m->actuator_outadr[i] + m->actuator_outnum[i]; ++k)
      add_moment(d, k, d->actuator_force[k], e->by);
  }
  half(m, d, e->scale, e->by);
  memset(e->moved, 0, (size_t)n * nv * sizeof(double));
  for (int k = 0; k < n; ++k) {
    double *x = e->moved + k * nv;
    add_moment(d, e->output[k], 1, x);
    half(m, d, e->scale, x);
    e->free[k] = d->actuator_velocity[e->output[k]] + h * (dot(x, e->by, nv) + constrained[k]);
    for (int j = 0; j <= k; ++j) {
      int last = nv;
      while (last && (x[last - 1] == 0 || e->moved[j * nv + last - 1] == 0)) --last; /* other branches of the tree */
      e->mobility[k * n + j] = e->mobility[j * n + k] = h * dot(x, e->moved + j * nv, last);
    }
  }
}

/* Torques at a speed, and by how much it is not the one that they lead to; the largest, relative to the speed. */
static double missed(const mjModel *m, const mjData *d, const Drive *e, const double *states, const double *v,
                     double *tau, double *slope, double *miss) {
  double worst = 0, phi[NM], w[NM], u[NM];
  for (int i = 0; i < e->n; i += NM) {
    for (int k = 0; k < NM; ++k) {
      phi[k] = d->actuator_length[e->output[i + k]];
      w[k] = d->actuator_velocity[e->output[i + k]];
      u[k] = d->ctrl[e->control[i + k]];
    }
    drive_implicit(v + i, states + i / NM * NX, phi, w, u, d->time, m->opt.timestep, e->q, tau + i, slope + i * NM);
  }
  for (int i = 0; i < e->n; ++i) miss[i] = v[i] - e->free[i] - dot(e->mobility + i * e->n, tau, e->n);
  for (int i = 0; i < e->n; ++i) worst = larger(worst, miss[i], v[i]);
  return worst;
}

/* The correction x of the speeds, (1 - mobility slope) x = miss; no pivots are needed, as torque falls with speed. */
static double correct(Drive *e, double *x) {
  const int n = e->n;
  double *a = e->matrix, largest = 0;
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j < n; j += NM) {
      for (int c = 0; c < NM; ++c) {
        double sum = i == j + c;
        for (int k = 0; k < NM; ++k) sum -= e->mobility[i * n + j + k] * e->slope[j * NM + c * NM + k];
        a[i * n + j + c] = sum;
      }
    }
    x[i] = e->miss[i];
  }
  for (int k = 0; k < n; ++k) {
    const double inverse = 1 / a[k * n + k];
    for (int i = k + 1; i < n; ++i) {
      const double by = a[i * n + k] * inverse;
      if (by == 0) continue;
      for (int j = k + 1; j < n; ++j) a[i * n + j] -= by * a[k * n + j];
      x[i] -= by * x[k];
    }
  }
  for (int i = n - 1; i >= 0; --i) {
    for (int j = i + 1; j < n; ++j) x[i] -= a[i * n + j] * x[j];
    x[i] /= a[i * n + i];
    largest = larger(largest, x[i], e->v[i]);
  }
  return largest;
}

static void swap(double **a, double **b) {
  double *c = *a;
  *a = *b, *b = c;
}

/* Torques where the speeds are those that they lead to. */
static void solve(const mjModel *m, const mjData *d, Drive *e, const double *states) {
  const int n = e->n;
  for (int i = 0; i < n; ++i) e->v[i] = d->actuator_velocity[e->output[i]];
  double worst = missed(m, d, e, states, e->v, e->tau, e->slope, e->miss), found;
  for (int k = 0; k < MOST; ++k) {
    double share = 1, size = correct(e, e->change);
    if (size <= SMALL) break;
    do {
      for (int i = 0; i < n; ++i) e->trial[i] = e->v[i] - share * e->change[i];
      found = missed(m, d, e, states, e->trial, e->trial_tau, e->trial_slope, e->trial_miss);
      share /= 2;
    } while (k >= PLAIN && !(found < worst) && share > 0.01);
    swap(&e->v, &e->trial), swap(&e->tau, &e->trial_tau), swap(&e->slope, &e->trial_slope);
    swap(&e->miss, &e->trial_miss);
    worst = found;
  }
  for (int i = 0; i < n; i += NM) /* along the last, small correction torque is straight */
    for (int c = 0; c < NM; ++c)
      for (int k = 0; k < NM; ++k) e->tau[i + k] -= e->slope[i * NM + c * NM + k] * e->change[i + c];
}

static void compute(const mjModel *m, mjData *d, int instance, int capability) {
  Drive *e = (Drive *)d->plugin_data[instance];
  const double *states = d->plugin_state + m->plugin_stateadr[instance];
  (void)capability;
  see_bodies(m, d, instance, e, states + e->n / NM * NX);
  solve(m, d, e, states);
  for (int k = 0; k < e->n; ++k) d->actuator_force[e->output[k]] = e->tau[k];
}

/* Friction states follow what the step moved; what the constraints did is kept for the next. */
static void advance(const mjModel *m, mjData *d, int instance) {
  Drive *e = (Drive *)d->plugin_data[instance];
  double *states = d->plugin_state + m->plugin_stateadr[instance], *constrained = states + e->n / NM * NX;
  double mean[NM];
  for (int i = 0; i < e->n; i += NM) {
    for (int k = 0; k < NM; ++k) {
      const int first = d->moment_rowadr[e->output[i + k]], last = first + d->moment_rownnz[e->output[i + k]];
      mean[k] = 0;
      for (int j = first; j < last; ++j) mean[k] += d->actuator_moment[j] * d->qvel[d->moment_colind[j]];
    }
    drive_follow(mean, states + i / NM * NX, m->opt.timestep, e->q, states + i / NM * NX);
  }
  memset(constrained, 0, e->n * sizeof(double));
  if (!d->nefc) return;
  memcpy(e->by, d->qfrc_constraint, e->nv * sizeof(double));
  half(m, d, e->scale, e->by);
  for (int k = 0; k < e->n; ++k) constrained[k] = dot(e->moved + k * e->nv, e->by, e->nv);
}

mjPLUGIN_LIB_INIT(DRIVE) {
  static mjpPlugin plugin;
  mjp_defaultPlugin(&plugin);
  plugin.name = DRIVE_NAME;
  plugin.nattribute = NP;
  plugin.attributes = drive_names;
  plugin.capabilityflags = mjPLUGIN_ACTUATOR;
  plugin.nstate = nstate;
  plugin.init = init;
  plugin.destroy = destroy;
  plugin.reset = reset;
  plugin.compute = compute;
  plugin.advance = advance;
  mjp_registerPlugin(&plugin);
}
