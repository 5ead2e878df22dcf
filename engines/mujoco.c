/* A drive as an actuator plugin of MuJoCo. Before this come, generated: DRIVE (identifier), DRIVE_NAME, sizes NM
   (motors), NX (friction states), NP (parameters), NQ (what they alone ask for), drive_names, drive_start, drive_low,
   drive_high, and the law: drive_prepare, and, as loops over drives, drive_implicit and drive_follow.

   One instance has one or many drives: its actuators in their order, NM a drive. An actuator's length is its motor's
   angle, its control drives the motor, its force is the torque at that angle. What a step of h changes the bodies'
   speeds v by, x, follows from M x = h (f + J' tau(J (v + x))): M and f are MuJoCo's inertia and its other forces, J
   the actuators' moments. All drives of an instance are solved for together, by Newton's method. Its matrix,
   M - h J' tau' J, has MuJoCo's own pattern where an actuator moves one joint, or joints of one branch: then a
   correction costs what MuJoCo's factorisation of M does. What constraints (contacts, stops, equalities) did in the
   last step is taken as what they will do in this one.

   With MuJoCo's integrators of order one (Euler, implicit, implicitfast) that is all. RK4 takes the mean torque over
   the step, from the FMU's own step of order two: two such solutions, each over GAMMA h. In each of RK4's stages they
   start where the step does, and the bodies' forces are those of the stage: so what holds a joint at rest in one holds
   it in all, and RK4's weights give the mean over the step. */

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <mujoco/mujoco.h>

#define SMALL 1e-6      /* of a correction of a speed, relative and of 1 rad/s; its square is what it leaves */
#define STRAIGHT 1e-10  /* over the largest torque: as far off the line of a correction, that was the last one; the
                           FMU's own solver leaves as much */
#define PLAIN 8         /* corrections taken whole */
#define MOST 30         /* then shortened ones, as far as the next one gets smaller */
#define GAMMA 0.29289321881345248 /* 1 - sqrt(1/2), of the L-stable method of order two with two stages */
#define PAST 4          /* accelerations of last steps that a guess is made of */
#define SAME 1e-9       /* relative and of 1 rad/s; as near is a speed that RK4 made to where it should be */

/* What a step calls becomes one function, for any processor and for one with AVX2 and FMA. */
#if defined(__GNUC__) && defined(__x86_64__) && !defined(_WIN32)
#define INLINE static inline __attribute__((always_inline))
#define APART static __attribute__((noinline)) /* its loops are too short for wide registers */
#define WIDE __attribute__((target("avx2,fma")))
#define HAS_WIDE (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma"))
#else
#define INLINE static
#define APART static
#define WIDE
#define HAS_WIDE 0
#endif

typedef struct {
  int n, nv, dofs, full;                 /* actuators, degrees of freedom: MuJoCo's, the drives' trees'; own pattern? */
  int single, *first, *at;               /* J by rows: has each one entry? where they begin; columns */
  double *by;                            /* its entries */
  int *output, *control, *dof, *has;     /* of each actuator; the trees' degrees of freedom, which they are */
  int *length, *start, *column;          /* the matrix by rows up to the diagonal, as MuJoCo stores M */
  int *place;                            /* where in it the drives' entries are, in their order */
  double q[NQ];
  double *lower, *upper, *inverse;       /* the matrix, then its factors; columns up to the diagonal; 1 / pivots */
  double *push, *left, *change, *next;   /* forces; what x still misses, its correction, what the next misses */
  double *phi, *w, *u;                   /* of actuators at the start of a step, or of a part: angle, speed, control */
  double *v, *tau, *slope;               /* at its end: speed, torque, slope (n x NM) */
  double *turn, *line;                   /* their correction of the speed, and of the torque along a straight line */
  double *trial, *trial_tau, *trial_slope, *spare, *mean, *ratio, *after;
  double *guess, *ahead;                 /* acceleration; what it makes of the speed, until the first correction */
  double *rate;                          /* acceleration that was found */
  int begun, stages;                     /* whether a step is; whether it is one of RK4, and these are of its start */
  double time, *qpos, *qvel, *phi_start, *w_start;
} Drive;

static int count(const mjModel *m, int instance) {
  int n = 0;
  for (int i = 0; i < m->nactuator; ++i) n += m->actuator_plugin[i] == instance;
  return n;
}

static int nstate(const mjModel *m, int instance) {
  const int n = count(m, instance);
  return n / NM * NX + m->nv + PAST * n; /* friction states; what constraints did; accelerations: differences */
}

static void destroy(mjData *d, int instance) {
  Drive *e = (Drive *)d->plugin_data[instance];
  if (e) {
    free(e->output);
    free(e->push);
    free(e->qpos);
    free(e->by);
    free(e->column);
    free(e->lower);
    free(e->place);
    free(e);
  }
  d->plugin_data[instance] = 0;
}

/* Room for a matrix of so many entries; 0 where there is none. */
static int room(Drive *e, size_t entries) {
  free(e->column);
  free(e->lower);
  e->column = (int *)calloc(entries + 1, sizeof(int));
  e->lower = (double *)calloc((NM > 1 ? 2 : 1) * entries + 1, sizeof(double));
  e->upper = e->lower + (NM > 1 ? entries : 0); /* with one motor a drive the matrix is symmetric */
  return e->column && e->lower;
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
  const int n = count(m, instance), nv = m->nv;
  int at = 0;
  d->plugin_data[instance] = 0;
  if (n % NM) {
    mju_warning("%s: %d actuators share an instance; a drive has %d, in the order of its motors", DRIVE_NAME, n, NM);
    return -1;
  }
  Drive *e = (Drive *)calloc(1, sizeof(Drive));
  d->plugin_data[instance] = (uintptr_t)e;
  if (e) e->output = (int *)calloc(3 * (size_t)n + 4 * (size_t)nv + (size_t)n * nv + 2, sizeof(int));
  if (e) e->by = (double *)calloc((size_t)n * nv + 1, sizeof(double));
  if (e) e->push = (double *)calloc(5 * (size_t)nv + (15 + 2 * NM + NX) * (size_t)n + 1, sizeof(double));
  if (e) e->qpos = (double *)calloc((size_t)m->nq + nv + 2 * (size_t)n + 1, sizeof(double));
  if (!e || !e->output || !e->push || !e->qpos || !e->by || !room(e, m->nC) || !configure(m, instance, e)) {
    destroy(d, instance);
    return -1;
  }
  e->n = n, e->nv = nv;
  e->control = e->output + n, e->dof = e->control + n, e->has = e->dof + nv, e->length = e->has + nv;
  e->start = e->length + nv, e->first = e->start + nv, e->at = e->first + n + 1;
  e->left = e->push + nv, e->change = e->left + nv, e->next = e->change + nv, e->inverse = e->next + nv;
  e->v = e->inverse + nv, e->tau = e->v + n, e->turn = e->tau + n, e->line = e->turn + n, e->trial = e->line + n;
  e->trial_tau = e->trial + n, e->spare = e->trial_tau + n, e->slope = e->spare + n;
  e->trial_slope = e->slope + n * NM, e->phi = e->trial_slope + n * NM, e->w = e->phi + n, e->mean = e->w + n;
  e->ahead = e->mean + n, e->guess = e->ahead + n, e->rate = e->guess + n, e->u = e->rate + n, e->ratio = e->u + n;
  e->after = e->ratio + n;
  e->qvel = e->qpos + m->nq, e->phi_start = e->qvel + nv, e->w_start = e->phi_start + n;
  memcpy(e->length, m->M_rownnz, nv * sizeof(int));
  memcpy(e->start, m->M_rowadr, nv * sizeof(int));
  memcpy(e->column, m->M_colind, m->nC * sizeof(int));
  for (int i = 0; i < m->nactuator; ++i) {
    if (m->actuator_plugin[i] != instance) continue;
    e->output[at] = m->actuator_outadr[i];
    e->control[at++] = m->actuator_ctrladr[i];
  }
  return 0;
}

static void reset(const mjModel *m, mjtNum *state, void *data, int instance) {
  if (data) ((Drive *)data)->begun = ((Drive *)data)->stages = 0;
  memset(state, 0, m->plugin_statenum[instance] * sizeof(mjtNum));
}

/* --- the actuators' moments, J */

/* J of this moment. Whether it has the pattern that it had. */
INLINE int gather(const mjData *d, Drive *e) {
  int same = 1, p = 0;
  if (e->single) {
    for (int k = 0; k < e->n; ++k) {
      const int from = d->moment_rowadr[e->output[k]];
      same &= (d->moment_rownnz[e->output[k]] == 1) & (d->moment_colind[from] == e->at[k]);
      e->by[k] = d->actuator_moment[from];
    }
    if (same) return 1;
  }
  for (int k = 0; k < e->n; ++k) {
    const int from = d->moment_rowadr[e->output[k]], many = d->moment_rownnz[e->output[k]];
    for (int l = 0; l < many; ++l, ++p) {
      same &= e->at[p] == d->moment_colind[from + l];
      e->at[p] = d->moment_colind[from + l];
      e->by[p] = d->actuator_moment[from + l];
    }
    same &= e->first[k + 1] == p;
    e->first[k + 1] = p;
  }
  return same;
}

/* What the bodies' speeds x turn the actuators by. */
INLINE void turn_of(const Drive *e, const double *restrict x, double *restrict turn) {
  if (e->single) {
    for (int k = 0; k < e->n; ++k) turn[k] = e->by[k] * x[e->at[k]];
    return;
  }
  for (int k = 0; k < e->n; ++k) {
    turn[k] = 0;
    for (int p = e->first[k]; p < e->first[k + 1]; ++p) turn[k] += e->by[p] * x[e->at[p]];
  }
}

/* What h times the actuators' torques push the bodies by, added to x. */
INLINE void push_by(const Drive *e, double h, const double *restrict tau, double *restrict x) {
  if (e->single) {
    for (int k = 0; k < e->n; ++k) x[e->at[k]] += h * tau[k] * e->by[k];
    return;
  }
  for (int k = 0; k < e->n; ++k)
    for (int p = e->first[k]; p < e->first[k + 1]; ++p) x[e->at[p]] += h * tau[k] * e->by[p];
}

/* --- the matrix */

/* Where row i of the matrix has column j <= i; -1 where its pattern has none. */
static int find(const Drive *e, int i, int j) {
  int k = e->start[i] + e->length[i] - 1;
  while (k >= e->start[i] && e->column[k] > j) --k;
  return k >= e->start[i] && e->column[k] == j ? k : -1;
}

/* Finds a place in the matrix for all that the drives couple. 0 where it has none, or there is no room for the list. */
static int settle(Drive *e) {
  size_t entries = 0;
  for (int a = 0; a < e->n; ++a)
    for (int b = a / NM * NM; b < a / NM * NM + NM; ++b)
      entries += (size_t)(e->first[a + 1] - e->first[a]) * (e->first[b + 1] - e->first[b]);
  free(e->place);
  int *to = e->place = (int *)malloc((entries + 1) * sizeof(int));
  for (int a = 0; to && a < e->n; ++a)
    for (int b = a / NM * NM; b < a / NM * NM + NM; ++b)
      for (int k = e->first[a]; k < e->first[a + 1]; ++k)
        for (int l = e->first[b]; l < e->first[b + 1]; ++l) {
          const int i = e->at[k], j = e->at[l];
          if ((*to++ = find(e, i > j ? i : j, i > j ? j : i)) < 0) return 0;
        }
  return to != 0;
}

/* For a new pattern of J: the degrees of freedom of the trees that the drives move, and the matrix's pattern, which has
   all that they couple: MuJoCo's, or, where an actuator couples branches, a full one. 0 where there is no room. */
static int arrange(const mjModel *m, Drive *e) {
  e->single = 1, e->dofs = 0;
  for (int k = 0; k < e->n; ++k) e->single &= e->first[k] == k && e->first[k + 1] == k + 1;
  for (int p = 0; p < e->first[e->n]; ++p)
    for (int i = 0; i < e->nv; ++i) e->has[i] |= m->dof_treeid[i] == m->dof_treeid[e->at[p]];
  for (int i = 0; i < e->nv; ++i)
    if (e->has[i]) e->dof[e->dofs++] = i;
  if (e->full || !settle(e)) {
    e->full = 1;
    if (!room(e, (size_t)e->dofs * (e->dofs + 1) / 2)) return 0;
    for (int i = 0, at = 0; i < e->dofs; ++i) {
      e->length[e->dof[i]] = i + 1, e->start[e->dof[i]] = at;
      for (int j = 0; j <= i; ++j) e->column[at++] = e->dof[j];
    }
    if (!settle(e)) return 0;
  }
  for (int i = 1; i < e->dofs; ++i) /* branches side by side: what does not wait for each other is worked out at once */
    for (int k = i; k > 0 && e->length[e->dof[k]] < e->length[e->dof[k - 1]]; --k) {
      const int dof = e->dof[k];
      e->dof[k] = e->dof[k - 1], e->dof[k - 1] = dof;
    }
  return 1;
}

/* The matrix M - h J' tau' J. */
INLINE void assemble(const mjModel *m, const mjData *d, Drive *e, double h) {
  if (!e->full) memcpy(e->lower, d->M, m->nC * sizeof(double));
  else memset(e->lower, 0, (size_t)e->dofs * (e->dofs + 1) / 2 * sizeof(double));
  for (int at = 0; e->full && at < e->dofs; ++at) {
    const int i = e->dof[at], last = m->M_rowadr[i] + m->M_rownnz[i];
    for (int k = m->M_rowadr[i]; k < last; ++k) e->lower[find(e, i, m->M_colind[k])] = d->M[k];
  }
  if (NM > 1) memcpy(e->upper, e->lower, (size_t)(e->upper - e->lower) * sizeof(double));
  const int *to = e->place;
  if (NM == 1 && e->single) {
    for (int k = 0; k < e->n; ++k) e->lower[to[k]] -= h * e->slope[k] * e->by[k] * e->by[k];
    return;
  }
  for (int a = 0; a < e->n; ++a) { /* torque of actuator a over the speed of actuator b */
    for (int c = 0; c < NM; ++c) {
      const int b = a / NM * NM + c;
      const double by = h * e->slope[b * NM + a % NM];
      for (int k = e->first[a]; k < e->first[a + 1]; ++k) {
        for (int l = e->first[b]; l < e->first[b + 1]; ++l) {
          const double entry = by * e->by[k] * e->by[l];
          if (e->at[k] >= e->at[l]) e->lower[*to] -= entry;
          if (NM > 1 && e->at[k] <= e->at[l]) e->upper[*to] -= entry;
          ++to;
        }
      }
    }
  }
}

/* Its factors, from the leaves of the tree to its root, and the first half of the solution x, in whose place the right
   side was; no pivots are needed, as torque falls with speed. */
APART void factorise(Drive *e, double *restrict x) {
  for (int at = e->dofs - 1; at >= 0; --at) {
    const int i = e->dof[at], many = e->length[i] - 1, *of = e->column + e->start[i];
    const double *row = e->lower + e->start[i], *column = e->upper + e->start[i];
    const double inverse = e->inverse[i] = 1 / row[many], right = x[i];
    for (int k = 0; k < many; ++k) {
      double *restrict above = e->lower + e->start[of[k]], *restrict left = e->upper + e->start[of[k]];
      const double by = column[k] * inverse, across = row[k] * inverse;
      x[of[k]] -= by * right;
      for (int l = 0; l <= k; ++l) above[l] -= by * row[l];
      for (int l = 0; NM > 1 && l <= k; ++l) left[l] -= across * column[l];
    }
  }
}

/* The first half with the factors as they are. */
APART void descend(const Drive *e, double *restrict x) {
  for (int at = e->dofs - 1; at >= 0; --at) {
    const int i = e->dof[at], many = e->length[i] - 1, *of = e->column + e->start[i];
    const double *column = e->upper + e->start[i], by = x[i] * e->inverse[i];
    for (int k = 0; k < many; ++k) x[of[k]] -= column[k] * by;
  }
}

/* The second half. */
APART void ascend(const Drive *e, double *restrict x) {
  for (int at = 0; at < e->dofs; ++at) {
    const int i = e->dof[at], many = e->length[i] - 1, *of = e->column + e->start[i];
    const double *row = e->lower + e->start[i];
    double sum = x[i];
    for (int k = 0; k < many; ++k) sum -= row[k] * x[of[k]];
    x[i] = sum * e->inverse[i];
  }
}

/* --- a step */

/* Where the step starts. */
INLINE void begin(const mjModel *m, const mjData *d, Drive *e) {
  for (int k = 0; k < e->n; ++k) {
    e->phi[k] = d->actuator_length[e->output[k]];
    e->w[k] = d->actuator_velocity[e->output[k]];
    e->u[k] = d->ctrl[e->control[k]];
  }
  e->time = d->time;
  e->begun = 1, e->stages = m->opt.integrator == mjINT_RK4;
  if (!e->stages) return;
  memcpy(e->phi_start, e->phi, e->n * sizeof(double));
  memcpy(e->w_start, e->w, e->n * sizeof(double));
  memcpy(e->qpos, d->qpos, m->nq * sizeof(double));
  memcpy(e->qvel, d->qvel, e->nv * sizeof(double));
}

/* Whether this is a later stage of the step that was begun: RK4 made its time, and its speed by the last qacc. */
INLINE int later(const mjModel *m, const mjData *d, const Drive *e) {
  const double t = d->time - e->time;
  if (m->opt.integrator != mjINT_RK4 || !e->stages || t <= 0 || t > m->opt.timestep * (1 + SAME)) return 0;
  for (int i = 0; i < e->nv; ++i)
    if (!(fabs(d->qvel[i] - e->qvel[i] - t * d->qacc[i]) <= SAME * (1 + fabs(d->qvel[i])))) return 0;
  return 1;
}

/* Back to the start from a later stage. */
INLINE void return_to_start(Drive *e) {
  memcpy(e->phi, e->phi_start, e->n * sizeof(double));
  memcpy(e->w, e->w_start, e->n * sizeof(double));
}

/* Whether any is not zero: all bits but the sign's, taken together. */
INLINE int any(const double *x, int n) {
  uint64_t found = 0, bits;
#pragma GCC unroll 4
  for (int i = 0; i < n; ++i) {
    memcpy(&bits, x + i, sizeof(bits));
    found |= bits;
  }
  return found << 1 != 0;
}

/* Forces on the bodies but for the drives'. */
INLINE void see_bodies(const mjModel *m, mjData *d, int instance, Drive *e, const double *constrained) {
  for (int i = 0; i < e->nv; ++i)
    e->push[i] = d->qfrc_passive[i] - d->qfrc_bias[i] + d->qfrc_applied[i] + constrained[i];
  if (any(d->xfrc_applied, 6 * m->nbody)) {
    for (int i = 1; i < m->nbody; ++i) {
      const mjtNum *f = d->xfrc_applied + 6 * i;
      if (any(f, 6)) mj_applyFT(m, d, f, f + 3, d->xipos + 3 * i, i, e->push);
    }
  }
  for (int i = 0; e->n < m->nactuator && i < m->nactuator; ++i) {
    if (m->actuator_plugin[i] == instance) continue;
    for (int k = m->actuator_outadr[i]; k < m->actuator_outadr[i] + m->actuator_outnum[i]; ++k) {
      const int from = d->moment_rowadr[k], to = from + d->moment_rownnz[k];
      for (int p = from; p < to; ++p) e->push[d->moment_colind[p]] += d->actuator_force[k] * d->actuator_moment[p];
    }
  }
}

/* Torques and their slopes at speeds. */
INLINE void ask(const Drive *e, const double *states, double t, double h, const double *v, double *tau,
                double *slope) {
  drive_implicit(e->n / NM, v, states, e->phi, e->w, e->u, t, h, e->q, tau, slope);
}

/* The largest size of n numbers; what is no number counts as the largest. Without their signs, numbers are ordered as
   their bits are, which a compiler compares several at a time. */
INLINE double largest(const double *x, int n) {
  int64_t most = 0, bits;
  double size;
  for (int i = 0; i < n; ++i) {
    memcpy(&bits, x + i, sizeof(bits));
    bits &= INT64_MAX;
    most = bits > most ? bits : most;
  }
  memcpy(&size, &most, sizeof(size));
  return size;
}

/* What correction x of the bodies' speeds turns the actuators by; the largest, relative to the speed. */
INLINE double turned(const Drive *e, const double *x, double *restrict turn) {
  turn_of(e, x, turn);
  for (int k = 0; k < e->n; ++k) {
    turn[k] -= e->ahead[k];
    e->ratio[k] = turn[k] / (1 + fabs(e->v[k]));
  }
  return largest(e->ratio, e->n);
}

/* A correction, of what is left, by a new matrix. Its size. */
INLINE double correct(const mjModel *m, const mjData *d, Drive *e, double h) {
  memcpy(e->change, e->left, e->nv * sizeof(double));
  assemble(m, d, e, h);
  factorise(e, e->change);
  ascend(e, e->change);
  return turned(e, e->change, e->turn);
}

/* The same by the matrix of the last one. */
INLINE double correct_again(Drive *e, const double *left, double *turn) {
  memcpy(e->change, left, e->nv * sizeof(double));
  descend(e, e->change);
  ascend(e, e->change);
  return turned(e, e->change, turn);
}

/* What a correction changes the torques by, along the line with these slopes. */
INLINE void along_line(const Drive *e, const double *slope, double *restrict line) {
  for (int i = 0; i < e->n; i += NM) {
    for (int k = 0; k < NM; ++k) {
      double sum = 0;
      for (int c = 0; c < NM; ++c) sum += slope[i * NM + c * NM + k] * e->turn[i + c];
      line[i + k] = sum;
    }
  }
}

/* Torques after a share of the correction, and what is left then. How far off the line they are. */
INLINE double attempt(Drive *e, const double *states, double share, double t, double h) {
  for (int k = 0; k < e->n; ++k) e->trial[k] = e->v[k] + share * e->turn[k];
  ask(e, states, t, h, e->trial, e->trial_tau, e->trial_slope);
  for (int i = 0; i < e->nv; ++i) e->next[i] = (1 - share) * e->left[i];
  for (int k = 0; k < e->n; ++k) e->spare[k] = e->trial_tau[k] - e->tau[k] - share * e->line[k];
  push_by(e, h, e->spare, e->next);
  return largest(e->spare, e->n);
}

INLINE void swap(double **a, double **b) {
  double *c = *a;
  *a = *b, *b = c;
}

/* Whether a small correction by the matrix of the last one, whose slopes were other ones, is the last. */
INLINE int settles(Drive *e, double allowed) {
  if (!(correct_again(e, e->left, e->turn) <= SMALL)) return 0;
  along_line(e, e->slope, e->line);
  along_line(e, e->trial_slope, e->spare);
  for (int k = 0; k < e->n; ++k) e->spare[k] -= e->line[k];
  return largest(e->spare, e->n) <= allowed;
}

/* Along the last, small correction torque is straight. */
INLINE void finish(Drive *e) {
  for (int k = 0; k < e->n; ++k) e->tau[k] += e->line[k], e->v[k] += e->turn[k];
}

/* The first correction, of a guess that is ahead of the speed at the start. Its size, or a negative one where the start
   is nearer to what it leads to than the guess was. */
INLINE double correct_guess(const mjModel *m, const mjData *d, Drive *e, const double *states, double t, double h) {
  for (int k = 0; k < e->n; ++k) e->v[k] = e->w[k] + (e->turn[k] = e->ahead[k]);
  ask(e, states, t, h, e->v, e->tau, e->slope);
  along_line(e, e->slope, e->line);
  for (int k = 0; k < e->n; ++k) e->spare[k] = e->tau[k] - e->line[k];
  for (int i = 0; i < e->nv; ++i) e->left[i] = h * e->push[i];
  push_by(e, h, e->spare, e->left);
  const double size = correct(m, d, e, h);
  if (size <= SMALL || !any(e->ahead, e->n)) return size;
  for (int k = 0; k < e->n; ++k) {
    e->spare[k] = e->ahead[k] + e->turn[k];
    e->ahead[k] = 0;
  }
  return largest(e->turn, e->n) <= largest(e->spare, e->n) ? size : -1;
}

/* Torques at the speeds that they lead to in a time of h from t on, from where phi and w are. The first guess continues
   the accelerations that were found in the last steps; where none would have been nearer, none. (The bodies' own
   accelerations would not do: they have what the constraints did anew, which the solution leaves to the next step.) */
INLINE void solve(const mjModel *m, const mjData *d, Drive *e, const double *states, double t, double h) {
  for (int k = 0; k < e->n; ++k) e->ahead[k] = h * e->guess[k];
  double size = correct_guess(m, d, e, states, t, h);
  if (size < 0) size = correct_guess(m, d, e, states, t, h);
  for (int k = 0; k < MOST; ++k) {
    double share = 1, off, allowed;
    if (k > 0) size = correct(m, d, e, h);
    along_line(e, e->slope, e->line);
    if (size <= SMALL) {
      finish(e);
      break;
    }
    for (;;) {
      off = attempt(e, states, share, t, h);
      if (k < PLAIN || share < 0.01 || correct_again(e, e->next, e->spare) < size) break;
      share /= 2;
    }
    swap(&e->v, &e->trial), swap(&e->tau, &e->trial_tau), swap(&e->slope, &e->trial_slope), swap(&e->left, &e->next);
    allowed = STRAIGHT * largest(e->tau, e->n);
    if (share == 1 && off <= allowed) break;
    if (settles(e, allowed)) {
      finish(e);
      break;
    }
  }
  for (int k = 0; k < e->n; ++k) e->rate[k] = (e->v[k] - e->w[k]) / h;
}

/* Mean torques over a step of order two. */
INLINE void solve_twice(const mjModel *m, const mjData *d, Drive *e, const double *states) {
  const double first = (1 - GAMMA) * m->opt.timestep, h = GAMMA * m->opt.timestep;
  solve(m, d, e, states, e->time, h);
  memcpy(e->mean, e->tau, e->n * sizeof(double));
  drive_follow(e->n / NM, e->v, states, first, e->q, e->after);
  for (int k = 0; k < e->n; ++k) {
    e->phi[k] += first * e->v[k];
    e->w[k] += (1 - GAMMA) / GAMMA * (e->v[k] - e->w[k]);
  }
  solve(m, d, e, e->after, e->time + first, h);
  for (int k = 0; k < e->n; ++k) e->tau[k] = (1 - GAMMA) * e->mean[k] + GAMMA * e->tau[k];
}

/* The acceleration that continues those of the last steps: the sum of their backward differences, as many as get
   smaller. */
INLINE void guess_from(Drive *e, const double *past) {
  double size = HUGE_VAL, before = size;
  memset(e->guess, 0, e->n * sizeof(double));
  for (int order = 0; order < PAST; ++order, past += e->n, before = size) {
    size = largest(past, e->n);
    if (!(size < before)) return;
    for (int k = 0; k < e->n; ++k) e->guess[k] += past[k];
  }
}

INLINE void step(const mjModel *m, mjData *d, int instance) {
  Drive *e = (Drive *)d->plugin_data[instance];
  const double *states = d->plugin_state + m->plugin_stateadr[instance], *constrained = states + e->n / NM * NX;
  const double *past = constrained + e->nv;
  if (!gather(d, e) && !arrange(m, e)) mju_error("%s: no memory", DRIVE_NAME);
  if (later(m, d, e)) return_to_start(e);
  else begin(m, d, e);
  guess_from(e, past);
  see_bodies(m, d, instance, e, constrained);
  if (m->opt.integrator == mjINT_RK4) solve_twice(m, d, e, states);
  else solve(m, d, e, states, e->time, m->opt.timestep);
  for (int k = 0; k < e->n; ++k) d->actuator_force[e->output[k]] = e->tau[k];
}

static void compute(const mjModel *m, mjData *d, int instance, int capability) {
  (void)capability;
  step(m, d, instance);
}

WIDE static void compute_wide(const mjModel *m, mjData *d, int instance, int capability) {
  (void)capability;
  step(m, d, instance);
}

/* Friction states follow what the step moved; what the constraints did is kept for the next. */
static void advance(const mjModel *m, mjData *d, int instance) {
  Drive *e = (Drive *)d->plugin_data[instance];
  const int drives = e->n / NM;
  const double *speed = d->qvel; /* over the step, of the integrators of order one */
  double *states = d->plugin_state + m->plugin_stateadr[instance], *constrained = states + drives * NX;
  double *past = constrained + e->nv;
  if (m->opt.integrator == mjINT_RK4 && e->stages) {
    mj_differentiatePos(m, e->change, m->opt.timestep, e->qpos, d->qpos);
    speed = e->change;
  }
  if (!e->begun && !gather(d, e) && !arrange(m, e)) mju_error("%s: no memory", DRIVE_NAME);
  turn_of(e, speed, e->v);
  drive_follow(drives, e->v, states, m->opt.timestep, e->q, e->after);
  memcpy(states, e->after, (size_t)drives * NX * sizeof(double));
  if (d->nefc) memcpy(constrained, d->qfrc_constraint, e->nv * sizeof(double));
  else memset(constrained, 0, e->nv * sizeof(double));
  for (int order = 0; order < PAST; ++order, past += e->n) {
    for (int k = 0; k < e->n; ++k) {
      const double last = past[k];
      past[k] = e->rate[k];
      e->rate[k] -= last;
    }
  }
  e->begun = e->stages = 0;
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
  plugin.compute = HAS_WIDE ? compute_wide : compute;
  plugin.advance = advance;
  mjp_registerPlugin(&plugin);
}
