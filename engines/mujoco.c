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
#include <stdlib.h>
#include <string.h>
#include <mujoco/mujoco.h>

#define SMALL 1e-6      /* of a correction of a speed, relative and of 1 rad/s; its square is what it leaves */
#define STRAIGHT 1e-10  /* over the largest torque: as far off the line of a correction, that was the last one; the
                           FMU's own solver leaves as much */
#define PLAIN 8         /* corrections taken whole */
#define MOST 30         /* then shortened ones, as far as the next one gets smaller */
#define GAMMA 0.29289321881345248 /* 1 - sqrt(1/2), of the L-stable method of order two with two stages */
#define SAME 1e-9       /* relative and of 1 rad/s; as near is a speed that RK4 made to where it should be */

typedef struct {
  int n, nv, dofs, full;                 /* actuators, degrees of freedom: MuJoCo's, the drives' trees'; own pattern? */
  int *output, *control, *dof, *has;     /* of each actuator; the trees' degrees of freedom, which they are */
  int *length, *start, *column;          /* the matrix by rows up to the diagonal, as MuJoCo stores M */
  double q[NQ];
  double *lower, *upper, *inverse;       /* the matrix, then its factors; columns up to the diagonal; 1 / pivots */
  double *push, *left, *change, *next;   /* forces; what x still misses, its correction, what the next misses */
  double *phi, *w;                       /* of the actuators at the start of a step, or of a part: angle, speed */
  double *v, *tau, *slope;               /* at its end: speed, torque, slope (n x NM) */
  double *turn, *line;                   /* their correction of the speed, and of the torque along a straight line */
  double *trial, *trial_tau, *trial_slope, *spare, *mean, *after;
  double *guess, *ahead;                 /* acceleration; what it makes of the speed, until the first correction */
  double *rate;                          /* acceleration that was found */
  int begun;                             /* whether a step is: these are of its start */
  double time, *qpos, *qvel, *phi_start, *w_start, *u_start;
} Drive;

static int count(const mjModel *m, int instance) {
  int n = 0;
  for (int i = 0; i < m->nactuator; ++i) n += m->actuator_plugin[i] == instance;
  return n;
}

static int nstate(const mjModel *m, int instance) {
  const int n = count(m, instance);
  return n / NM * NX + m->nv + 2 * n; /* friction states; what constraints did; accelerations found, twice */
}

static void destroy(mjData *d, int instance) {
  Drive *e = (Drive *)d->plugin_data[instance];
  if (e) {
    free(e->output);
    free(e->push);
    free(e->qpos);
    free(e->column);
    free(e->lower);
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
  if (e) e->output = (int *)calloc(2 * (size_t)n + 4 * (size_t)nv + 1, sizeof(int));
  if (e) e->push = (double *)calloc(5 * (size_t)nv + (13 + 2 * NM + NX) * (size_t)n + 1, sizeof(double));
  if (e) e->qpos = (double *)calloc((size_t)m->nq + nv + 3 * (size_t)n + 1, sizeof(double));
  if (!e || !e->output || !e->push || !e->qpos || !room(e, m->nC) || !configure(m, instance, e)) {
    destroy(d, instance);
    return -1;
  }
  e->n = n, e->nv = nv;
  e->control = e->output + n, e->dof = e->control + n, e->has = e->dof + nv, e->length = e->has + nv;
  e->start = e->length + nv;
  e->left = e->push + nv, e->change = e->left + nv, e->next = e->change + nv, e->inverse = e->next + nv;
  e->v = e->inverse + nv, e->tau = e->v + n, e->turn = e->tau + n, e->line = e->turn + n, e->trial = e->line + n;
  e->trial_tau = e->trial + n, e->spare = e->trial_tau + n, e->slope = e->spare + n;
  e->trial_slope = e->slope + n * NM, e->phi = e->trial_slope + n * NM, e->w = e->phi + n, e->mean = e->w + n;
  e->ahead = e->mean + n, e->guess = e->ahead + n, e->rate = e->guess + n, e->after = e->rate + n;
  e->qvel = e->qpos + m->nq, e->phi_start = e->qvel + nv, e->w_start = e->phi_start + n, e->u_start = e->w_start + n;
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
  if (data) ((Drive *)data)->begun = 0;
  memset(state, 0, m->plugin_statenum[instance] * sizeof(mjtNum));
}

/* --- the actuators' moments, J */

static void add_moment(const mjData *d, int output, double by, double *x) {
  const int first = d->moment_rowadr[output], last = first + d->moment_rownnz[output];
  for (int k = first; k < last; ++k) x[d->moment_colind[k]] += by * d->actuator_moment[k];
}

static double along(const mjData *d, int output, const double *x) {
  const int first = d->moment_rowadr[output], last = first + d->moment_rownnz[output];
  double sum = 0;
  for (int k = first; k < last; ++k) sum += d->actuator_moment[k] * x[d->moment_colind[k]];
  return sum;
}

/* --- the matrix */

/* Where row i of the matrix has column j <= i; -1 where its pattern has none. */
static int place(const Drive *e, int i, int j) {
  int k = e->start[i] + e->length[i] - 1;
  while (k >= e->start[i] && e->column[k] > j) --k;
  return k >= e->start[i] && e->column[k] == j ? k : -1;
}

/* Whether all that the drives couple has a place in the matrix. */
static int fits(const mjData *d, const Drive *e) {
  for (int a = 0; a < e->n; ++a) {
    const int *of = d->moment_colind + d->moment_rowadr[e->output[a]], many = d->moment_rownnz[e->output[a]];
    for (int k = 0; k < many; ++k)
      if (!e->has[of[k]]) return 0;
    if (NM == 1 && many < 2) continue;
    for (int b = a / NM * NM; b <= a; ++b) {
      const int *to = d->moment_colind + d->moment_rowadr[e->output[b]], more = d->moment_rownnz[e->output[b]];
      for (int k = 0; k < many; ++k)
        for (int l = 0; l < more; ++l)
          if (place(e, of[k] > to[l] ? of[k] : to[l], of[k] > to[l] ? to[l] : of[k]) < 0) return 0;
    }
  }
  return 1;
}

/* The degrees of freedom of the trees that the drives move, and a pattern that has all that they couple: MuJoCo's, or,
   where an actuator couples branches, a full one. 0 where there is no room. */
static int arrange(const mjModel *m, const mjData *d, Drive *e) {
  for (int a = 0; a < e->n; ++a) {
    const int *of = d->moment_colind + d->moment_rowadr[e->output[a]], many = d->moment_rownnz[e->output[a]];
    for (int k = 0; k < many; ++k)
      for (int i = 0; i < e->nv; ++i) e->has[i] |= m->dof_treeid[i] == m->dof_treeid[of[k]];
  }
  e->dofs = 0;
  for (int i = 0; i < e->nv; ++i)
    if (e->has[i]) e->dof[e->dofs++] = i;
  if (!e->full && fits(d, e)) return 1;
  e->full = 1;
  if (!room(e, (size_t)e->dofs * (e->dofs + 1) / 2)) return 0;
  for (int i = 0, at = 0; i < e->dofs; ++i) {
    e->length[e->dof[i]] = i + 1, e->start[e->dof[i]] = at;
    for (int j = 0; j <= i; ++j) e->column[at++] = e->dof[j];
  }
  return 1;
}

/* The matrix M - h J' tau' J. */
static void assemble(const mjModel *m, const mjData *d, Drive *e, double h) {
  if (!e->full) memcpy(e->lower, d->M, m->nC * sizeof(double));
  else memset(e->lower, 0, (size_t)e->dofs * (e->dofs + 1) / 2 * sizeof(double));
  for (int at = 0; e->full && at < e->dofs; ++at) {
    const int i = e->dof[at], last = m->M_rowadr[i] + m->M_rownnz[i];
    for (int k = m->M_rowadr[i]; k < last; ++k) e->lower[place(e, i, m->M_colind[k])] = d->M[k];
  }
  if (NM > 1) memcpy(e->upper, e->lower, (size_t)(e->upper - e->lower) * sizeof(double));
  for (int a = 0; a < e->n; ++a) { /* torque of actuator a over the speed of actuator b */
    const int of = d->moment_rowadr[e->output[a]], many = d->moment_rownnz[e->output[a]];
    for (int c = 0; c < NM; ++c) {
      const int b = a / NM * NM + c, to = d->moment_rowadr[e->output[b]], more = d->moment_rownnz[e->output[b]];
      const double by = h * e->slope[b * NM + a % NM];
      for (int k = of; k < of + many; ++k) {
        for (int l = to; l < to + more; ++l) {
          const int i = d->moment_colind[k], j = d->moment_colind[l];
          const double entry = by * d->actuator_moment[k] * d->actuator_moment[l];
          if (i >= j) e->lower[place(e, i, j)] -= entry;
          if (NM > 1 && i <= j) e->upper[place(e, j, i)] -= entry;
        }
      }
    }
  }
}

/* Its factors, from the leaves of the tree to its root, and the first half of the solution x, in whose place the right
   side was; no pivots are needed, as torque falls with speed. */
static void factorise(Drive *e, double *restrict x) {
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
static void descend(const Drive *e, double *restrict x) {
  for (int at = e->dofs - 1; at >= 0; --at) {
    const int i = e->dof[at], many = e->length[i] - 1, *of = e->column + e->start[i];
    const double *column = e->upper + e->start[i], by = x[i] * e->inverse[i];
    for (int k = 0; k < many; ++k) x[of[k]] -= column[k] * by;
  }
}

/* The second half. */
static void ascend(const Drive *e, double *restrict x) {
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
static void begin(const mjModel *m, const mjData *d, Drive *e) {
  for (int k = 0; k < e->n; ++k) {
    e->phi_start[k] = d->actuator_length[e->output[k]];
    e->w_start[k] = d->actuator_velocity[e->output[k]];
    e->u_start[k] = d->ctrl[e->control[k]];
  }
  memcpy(e->qpos, d->qpos, m->nq * sizeof(double));
  memcpy(e->qvel, d->qvel, e->nv * sizeof(double));
  e->time = d->time;
  e->begun = 1;
}

/* Whether this is a later stage of the step that was begun: RK4 made its time, and its speed by the last qacc. */
static int later(const mjModel *m, const mjData *d, const Drive *e) {
  const double t = d->time - e->time;
  if (m->opt.integrator != mjINT_RK4 || !e->begun || t <= 0 || t > m->opt.timestep * (1 + SAME)) return 0;
  for (int i = 0; i < e->nv; ++i)
    if (!(fabs(d->qvel[i] - e->qvel[i] - t * d->qacc[i]) <= SAME * (1 + fabs(d->qvel[i])))) return 0;
  return 1;
}

static int any(const double *x, int n) {
  int found = 0;
  for (int i = 0; i < n; ++i) found |= x[i] != 0;
  return found;
}

/* Forces on the bodies but for the drives'. */
static void see_bodies(const mjModel *m, mjData *d, int instance, Drive *e, const double *constrained) {
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
    for (int k = m->actuator_outadr[i]; k < m->actuator_outadr[i] + m->actuator_outnum[i]; ++k)
      add_moment(d, k, d->actuator_force[k], e->push);
  }
}

/* Torques and their slopes at speeds. */
static void ask(const Drive *e, const double *states, double t, double h, const double *v, double *tau,
                double *slope) {
  drive_implicit(e->n / NM, v, states, e->phi, e->w, e->u_start, t, h, e->q, tau, slope);
}

/* The larger of a size and that of x. */
static double larger(double size, double x) { return fabs(x) <= size ? size : fabs(x); }

/* What correction x of the bodies' speeds turns the actuators by; the largest, relative to the speed. */
static double turned(const mjData *d, const Drive *e, const double *x, double *turn) {
  double largest = 0;
  for (int k = 0; k < e->n; ++k) {
    turn[k] = along(d, e->output[k], x) - e->ahead[k];
    largest = larger(largest, turn[k] / (1 + fabs(e->v[k])));
  }
  return largest;
}

/* A correction, of what is left, by a new matrix. Its size. */
static double correct(const mjModel *m, const mjData *d, Drive *e, double h) {
  memcpy(e->change, e->left, e->nv * sizeof(double));
  assemble(m, d, e, h);
  factorise(e, e->change);
  ascend(e, e->change);
  return turned(d, e, e->change, e->turn);
}

/* The same by the matrix of the last one. */
static double correct_again(const mjData *d, Drive *e, const double *left, double *turn) {
  memcpy(e->change, left, e->nv * sizeof(double));
  descend(e, e->change);
  ascend(e, e->change);
  return turned(d, e, e->change, turn);
}

/* What a correction changes the torques by, along the line with these slopes. */
static void along_line(const Drive *e, const double *slope, double *line) {
  for (int i = 0; i < e->n; i += NM) {
    for (int k = 0; k < NM; ++k) {
      double sum = 0;
      for (int c = 0; c < NM; ++c) sum += slope[i * NM + c * NM + k] * e->turn[i + c];
      line[i + k] = sum;
    }
  }
}

/* Torques after a share of the correction, the largest of them, and what is left then. How far off the line. */
static double attempt(const mjData *d, Drive *e, const double *states, double share, double t, double h,
                      double *largest) {
  double off = 0;
  for (int k = 0; k < e->n; ++k) e->trial[k] = e->v[k] + share * e->turn[k];
  ask(e, states, t, h, e->trial, e->trial_tau, e->trial_slope);
  for (int i = 0; i < e->nv; ++i) e->next[i] = (1 - share) * e->left[i];
  *largest = 0;
  for (int k = 0; k < e->n; ++k) {
    e->spare[k] = e->trial_tau[k] - e->tau[k] - share * e->line[k];
    off = larger(off, e->spare[k]);
    *largest = larger(*largest, e->trial_tau[k]);
  }
  for (int k = 0; k < e->n; ++k) add_moment(d, e->output[k], h * e->spare[k], e->next);
  return off;
}

static void swap(double **a, double **b) {
  double *c = *a;
  *a = *b, *b = c;
}

/* Whether a small correction by the matrix of the last one, whose slopes were other ones, is the last. */
static int settles(const mjData *d, Drive *e, double largest) {
  double off = 0;
  if (!(correct_again(d, e, e->left, e->turn) <= SMALL)) return 0;
  along_line(e, e->slope, e->line);
  along_line(e, e->trial_slope, e->spare);
  for (int k = 0; k < e->n; ++k) off = larger(off, e->line[k] - e->spare[k]);
  return off <= STRAIGHT * largest;
}

/* Along the last, small correction torque is straight. */
static void finish(Drive *e) {
  for (int k = 0; k < e->n; ++k) e->tau[k] += e->line[k], e->v[k] += e->turn[k];
}

/* The first correction, of a guess that is ahead of the speed at the start. Its size, or a negative one where the guess
   was no better than none. */
static double correct_guess(const mjModel *m, const mjData *d, Drive *e, const double *states, double t, double h) {
  double guess = 0, change = 0;
  for (int k = 0; k < e->n; ++k) e->v[k] = e->w[k] + (e->turn[k] = e->ahead[k]);
  ask(e, states, t, h, e->v, e->tau, e->slope);
  along_line(e, e->slope, e->line);
  for (int i = 0; i < e->nv; ++i) e->left[i] = h * e->push[i];
  for (int k = 0; k < e->n; ++k) add_moment(d, e->output[k], h * (e->tau[k] - e->line[k]), e->left);
  const double size = correct(m, d, e, h);
  for (int k = 0; k < e->n; ++k) {
    guess = larger(guess, e->ahead[k]);
    change = larger(change, e->turn[k]);
    e->ahead[k] = 0;
  }
  return size <= SMALL || guess == 0 || change < guess ? size : -1;
}

/* Torques at the speeds that they lead to in a time of h from t on, from where phi and w are. The first guess continues
   the accelerations that were found in the last two steps; where that was no better than none, none. (The bodies' own
   accelerations would not do: they have what the constraints did anew, which the solution leaves to the next step.) */
static void solve(const mjModel *m, const mjData *d, Drive *e, const double *states, double t, double h) {
  for (int k = 0; k < e->n; ++k) e->ahead[k] = h * e->guess[k];
  double size = correct_guess(m, d, e, states, t, h);
  if (size < 0) size = correct_guess(m, d, e, states, t, h);
  for (int k = 0; k < MOST; ++k) {
    double share = 1, off, largest;
    if (k > 0) size = correct(m, d, e, h);
    along_line(e, e->slope, e->line);
    if (size <= SMALL) {
      finish(e);
      break;
    }
    for (;;) {
      off = attempt(d, e, states, share, t, h, &largest);
      if (k < PLAIN || share < 0.01 || correct_again(d, e, e->next, e->spare) < size) break;
      share /= 2;
    }
    swap(&e->v, &e->trial), swap(&e->tau, &e->trial_tau), swap(&e->slope, &e->trial_slope), swap(&e->left, &e->next);
    if (share == 1 && off <= STRAIGHT * largest) break;
    if (settles(d, e, largest)) {
      finish(e);
      break;
    }
  }
  for (int k = 0; k < e->n; ++k) e->rate[k] = (e->v[k] - e->w[k]) / h;
}

/* Mean torques over a step of order two. */
static void solve_twice(const mjModel *m, const mjData *d, Drive *e, const double *states) {
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

static void compute(const mjModel *m, mjData *d, int instance, int capability) {
  Drive *e = (Drive *)d->plugin_data[instance];
  const double *states = d->plugin_state + m->plugin_stateadr[instance], *constrained = states + e->n / NM * NX;
  const double *last = constrained + e->nv, *before = last + e->n;
  (void)capability;
  if (!fits(d, e) && !arrange(m, d, e)) mju_error("%s: no memory", DRIVE_NAME);
  if (!later(m, d, e)) begin(m, d, e);
  memcpy(e->phi, e->phi_start, e->n * sizeof(double));
  memcpy(e->w, e->w_start, e->n * sizeof(double));
  for (int k = 0; k < e->n; ++k) e->guess[k] = 2 * last[k] - before[k];
  see_bodies(m, d, instance, e, constrained);
  if (m->opt.integrator == mjINT_RK4) solve_twice(m, d, e, states);
  else solve(m, d, e, states, e->time, m->opt.timestep);
  for (int k = 0; k < e->n; ++k) d->actuator_force[e->output[k]] = e->tau[k];
}

/* Friction states follow what the step moved; what the constraints did is kept for the next. */
static void advance(const mjModel *m, mjData *d, int instance) {
  Drive *e = (Drive *)d->plugin_data[instance];
  const int drives = e->n / NM;
  const double *speed = d->qvel; /* over the step, of the integrators of order one */
  double *states = d->plugin_state + m->plugin_stateadr[instance], *constrained = states + drives * NX;
  double *last = constrained + e->nv, *before = last + e->n;
  if (m->opt.integrator == mjINT_RK4 && e->begun) {
    mj_differentiatePos(m, e->change, m->opt.timestep, e->qpos, d->qpos);
    speed = e->change;
  }
  for (int k = 0; k < e->n; ++k) e->v[k] = along(d, e->output[k], speed);
  drive_follow(drives, e->v, states, m->opt.timestep, e->q, e->after);
  memcpy(states, e->after, (size_t)drives * NX * sizeof(double));
  if (d->nefc) memcpy(constrained, d->qfrc_constraint, e->nv * sizeof(double));
  else memset(constrained, 0, e->nv * sizeof(double));
  memcpy(before, last, e->n * sizeof(double));
  memcpy(last, e->rate, e->n * sizeof(double));
  e->begun = 0;
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
