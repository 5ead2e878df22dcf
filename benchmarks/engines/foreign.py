"""A name in, an FMU that this program did not make out: small machines in C against the standard's headers, and others.

The C is written for these tests: a mass on a spring, and a tank with an outlet, each with three tunable parameters, for
FMI 2 and 3, co-simulation (classical Runge-Kutta inside) or model exchange, with directional derivatives or without.
"""

from __future__ import annotations

import re
import subprocess
import tempfile
import zipfile
from dataclasses import dataclass
from pathlib import Path

from pycosim.export import build
from pycosim.export.source import headers


@dataclass(frozen=True)
class Machine:
    """A small model: states x, input u, parameters p, output y; C expressions.

    Attributes
    ----------
    rates, output : str
    by_state, by_parameter : str
        C expressions of the derivatives of rates and output along ``dx`` and ``dp``.
    parameters : dict of str to (float, float, float)
        Start, least and greatest value.
    starts : list of float
    """

    rates: list
    output: str
    along: list
    output_along: str
    parameters: dict
    starts: list


MACHINES = {
    "spring": Machine(
        ["x[1]", "(u - p[1]*x[1] - p[2]*x[0])/p[0]"], "x[0]",
        ["dx[1]", "(-p[1]*dx[1] - dp[1]*x[1] - p[2]*dx[0] - dp[2]*x[0])/p[0]"
                  " - (u - p[1]*x[1] - p[2]*x[0])/(p[0]*p[0])*dp[0]"],
        "dx[0]", {"mass": (1.0, 0.05, 20.0), "damping": (0.6, 0.0, 10.0), "stiffness": (8.0, 0.1, 100.0)}, [0.3, 0.0]),
    "tank": Machine(
        ["(p[1]*(1.0 + u) - p[2]*sqrt(fabs(x[0])))/p[0]"], "x[0]",
        ["(dp[1]*(1.0 + u) - dp[2]*sqrt(fabs(x[0])) - p[2]*0.5/sqrt(fabs(x[0]) + 1e-12)*dx[0])/p[0]"
         " - (p[1]*(1.0 + u) - p[2]*sqrt(fabs(x[0])))/(p[0]*p[0])*dp[0]"],
        "dx[0]", {"area": (1.5, 0.1, 20.0), "pump": (0.8, 0.05, 10.0), "outlet": (0.7, 0.05, 10.0)}, [1.2])}

_BODY = r"""
#include <math.h>
#include <stdlib.h>
#include <string.h>
#define N %(n)d
#define P %(p)d
typedef struct { double x[N], p[P], u, t; } Instance;
static void start(Instance *i) {
  static const double x[] = {%(x)s}, p[] = {%(values)s};
  memset(i, 0, sizeof *i); memcpy(i->x, x, sizeof x); memcpy(i->p, p, sizeof p);
}
static void rates(const Instance *i, const double *x, double *d) {
  const double *p = i->p, u = i->u; (void)u; (void)p;
%(rates)s}
static double output(const Instance *i) { const double *x = i->x, *p = i->p; (void)p; return %(output)s; }
/* value references: 0 time, 1.. states, then derivatives, input, output, parameters */
static int get(const Instance *i, unsigned r, double *v) {
  double d[N];
  rates(i, i->x, d);
  if (r == 0) *v = i->t; else if (r <= N) *v = i->x[r - 1]; else if (r <= 2 * N) *v = d[r - N - 1];
  else if (r == 2 * N + 1) *v = i->u; else if (r == 2 * N + 2) *v = output(i);
  else if (r <= 2 * N + 2 + P) *v = i->p[r - 2 * N - 3]; else return 3;
  return 0;
}
static int set(Instance *i, unsigned r, double v) {
  if (r >= 1 && r <= N) i->x[r - 1] = v; else if (r == 2 * N + 1) i->u = v;
  else if (r >= 2 * N + 3 && r <= 2 * N + 2 + P) i->p[r - 2 * N - 3] = v; else return 3;
  return 0;
}
static void step(Instance *i, double h) {
  int parts = (int)ceil(h / 1e-2 - 1e-9);
  if (parts < 1) parts = 1;
  h /= parts;
  for (int k = 0; k < parts; ++k) {
    double a[N], b[N], c[N], d[N], x[N];
    rates(i, i->x, a);
    for (int j = 0; j < N; ++j) x[j] = i->x[j] + h / 2 * a[j];
    rates(i, x, b);
    for (int j = 0; j < N; ++j) x[j] = i->x[j] + h / 2 * b[j];
    rates(i, x, c);
    for (int j = 0; j < N; ++j) x[j] = i->x[j] + h * c[j];
    rates(i, x, d);
    for (int j = 0; j < N; ++j) i->x[j] += h / 6 * (a[j] + 2 * b[j] + 2 * c[j] + d[j]);
  }
}
static int along(const Instance *i, const unsigned *unknown, size_t n, const unsigned *known, size_t m,
                 const double *seed, double *found) {
  const double *x = i->x, *p = i->p, u = i->u;
  double dx[N] = {0}, dp[P] = {0}, d[N];
  (void)u; (void)x; (void)p;
  for (size_t k = 0; k < m; ++k) {
    if (known[k] >= 1 && known[k] <= N) dx[known[k] - 1] += seed[k];
    else if (known[k] >= 2 * N + 3) dp[known[k] - 2 * N - 3] += seed[k];
    else return 3;
  }
%(along)s  for (size_t k = 0; k < n; ++k) {
    if (unknown[k] > N && unknown[k] <= 2 * N) found[k] = d[unknown[k] - N - 1];
    else if (unknown[k] == 2 * N + 2) found[k] = %(output_along)s;
    else return 3;
  }
  return 0;
}
"""

_TWO = r"""
#include "fmi2Functions.h"
#define ME (Instance *)c
const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }
fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean b, size_t n, const fmi2String s[]) { return 0; }
fmi2Component fmi2Instantiate(fmi2String a, fmi2Type b, fmi2String d, fmi2String e, const fmi2CallbackFunctions *f,
                              fmi2Boolean g, fmi2Boolean h) {
  Instance *i = malloc(sizeof *i); if (i) start(i); return i; }
void fmi2FreeInstance(fmi2Component c) { free(c); }
fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean a, fmi2Real b, fmi2Real t, fmi2Boolean d, fmi2Real e) {
  (ME)->t = t; return 0; }
fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return 0; }
fmi2Status fmi2ExitInitializationMode(fmi2Component c) { return 0; }
fmi2Status fmi2Terminate(fmi2Component c) { return 0; }
fmi2Status fmi2Reset(fmi2Component c) { start(ME); return 0; }
fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Real v[]) {
  for (size_t k = 0; k < n; ++k) if (get(ME, r[k], v + k)) return 3; return 0; }
fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Real v[]) {
  for (size_t k = 0; k < n; ++k) if (set(ME, r[k], v[k])) return 3; return 0; }
fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference u[], size_t n,
    const fmi2ValueReference k[], size_t m, const fmi2Real s[], fmi2Real f[]) {
  return DD ? along(ME, u, n, k, m, s, f) : 3; }
fmi2Status fmi2DoStep(fmi2Component c, fmi2Real t, fmi2Real h, fmi2Boolean b) {
  step(ME, h); (ME)->t = t + h; return 0; }
fmi2Status fmi2EnterEventMode(fmi2Component c) { return 0; }
fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *e) { memset(e, 0, sizeof *e); return 0; }
fmi2Status fmi2EnterContinuousTimeMode(fmi2Component c) { return 0; }
fmi2Status fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean a, fmi2Boolean *b, fmi2Boolean *d) {
  *b = *d = 0; return 0; }
fmi2Status fmi2SetTime(fmi2Component c, fmi2Real t) { (ME)->t = t; return 0; }
fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real x[], size_t n) {
  memcpy((ME)->x, x, n * sizeof *x); return 0; }
fmi2Status fmi2GetContinuousStates(fmi2Component c, fmi2Real x[], size_t n) {
  memcpy(x, (ME)->x, n * sizeof *x); return 0; }
fmi2Status fmi2GetDerivatives(fmi2Component c, fmi2Real d[], size_t n) { rates(ME, (ME)->x, d); return 0; }
fmi2Status fmi2GetEventIndicators(fmi2Component c, fmi2Real d[], size_t n) { return 0; }
fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component c, fmi2Real d[], size_t n) {
  for (size_t k = 0; k < n; ++k) d[k] = 1; return 0; }
"""

_THREE = r"""
#include "fmi3Functions.h"
#define ME ((Instance *)c)
const char *fmi3GetVersion(void) { return fmi3Version; }
fmi3Status fmi3SetDebugLogging(fmi3Instance c, fmi3Boolean b, size_t n, const fmi3String s[]) { return 0; }
static Instance *fresh(void) { Instance *i = malloc(sizeof *i); if (i) start(i); return i; }
fmi3Instance fmi3InstantiateCoSimulation(fmi3String a, fmi3String b, fmi3String d, fmi3Boolean e, fmi3Boolean f,
    fmi3Boolean g, fmi3Boolean h, const fmi3ValueReference r[], size_t n, fmi3InstanceEnvironment i,
    fmi3LogMessageCallback l, fmi3IntermediateUpdateCallback m) { return fresh(); }
fmi3Instance fmi3InstantiateModelExchange(fmi3String a, fmi3String b, fmi3String d, fmi3Boolean e, fmi3Boolean f,
    fmi3InstanceEnvironment i, fmi3LogMessageCallback l) { return fresh(); }
void fmi3FreeInstance(fmi3Instance c) { free(c); }
fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean a, fmi3Float64 b, fmi3Float64 t, fmi3Boolean d,
    fmi3Float64 e) { ME->t = t; return 0; }
fmi3Status fmi3ExitInitializationMode(fmi3Instance c) { return 0; }
fmi3Status fmi3EnterEventMode(fmi3Instance c) { return 0; }
fmi3Status fmi3Terminate(fmi3Instance c) { return 0; }
fmi3Status fmi3Reset(fmi3Instance c) { start(ME); return 0; }
fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference r[], size_t n, fmi3Float64 v[], size_t m) {
  for (size_t k = 0; k < n; ++k) if (get(ME, r[k], v + k)) return 3; return 0; }
fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference r[], size_t n, const fmi3Float64 v[], size_t m) {
  for (size_t k = 0; k < n; ++k) if (set(ME, r[k], v[k])) return 3; return 0; }
fmi3Status fmi3GetDirectionalDerivative(fmi3Instance c, const fmi3ValueReference u[], size_t n,
    const fmi3ValueReference k[], size_t m, const fmi3Float64 s[], size_t o, fmi3Float64 f[], size_t q) {
  return DD ? along(ME, u, n, k, m, s, f) : 3; }
fmi3Status fmi3UpdateDiscreteStates(fmi3Instance c, fmi3Boolean *a, fmi3Boolean *b, fmi3Boolean *d, fmi3Boolean *e,
    fmi3Boolean *f, fmi3Float64 *g) { *a = *b = *d = *e = *f = 0; *g = 0; return 0; }
fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance c) { return 0; }
fmi3Status fmi3CompletedIntegratorStep(fmi3Instance c, fmi3Boolean a, fmi3Boolean *b, fmi3Boolean *d) {
  *b = *d = 0; return 0; }
fmi3Status fmi3SetTime(fmi3Instance c, fmi3Float64 t) { ME->t = t; return 0; }
fmi3Status fmi3SetContinuousStates(fmi3Instance c, const fmi3Float64 x[], size_t n) {
  memcpy(ME->x, x, n * sizeof *x); return 0; }
fmi3Status fmi3GetContinuousStates(fmi3Instance c, fmi3Float64 x[], size_t n) {
  memcpy(x, ME->x, n * sizeof *x); return 0; }
fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance c, fmi3Float64 d[], size_t n) {
  rates(ME, ME->x, d); return 0; }
fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance c, size_t *n) { *n = 0; return 0; }
fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance c, size_t *n) { *n = N; return 0; }
fmi3Status fmi3GetEventIndicators(fmi3Instance c, fmi3Float64 d[], size_t n) { return 0; }
fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance c, fmi3Float64 d[], size_t n) {
  for (size_t k = 0; k < n; ++k) d[k] = 1; return 0; }
fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 t, fmi3Float64 h, fmi3Boolean a, fmi3Boolean *b, fmi3Boolean *d,
    fmi3Boolean *e, fmi3Float64 *l) { step(ME, h); ME->t = *l = t + h; *b = *d = *e = 0; return 0; }
"""


def c_fmu(folder, machine, fmi, kind, directional=False):
    """An FMU in C.

    Parameters
    ----------
    folder : path
    machine : str
        Of `MACHINES`.
    fmi : int
        2 or 3.
    kind : str
        ``cs`` or ``me``.
    directional : bool
        Whether it has directional derivatives.

    Returns
    -------
    Path
    """
    m, name = MACHINES[machine], f"{machine}{fmi}{kind}{'d' * directional}"
    text = f"#define DD {int(directional)}\n" + _BODY % {
        "n": len(m.rates), "p": len(m.parameters), "x": ", ".join(map(repr, m.starts)),
        "values": ", ".join(repr(v[0]) for v in m.parameters.values()), "output": m.output,
        "rates": "".join(f"  d[{k}] = {e};\n" for k, e in enumerate(m.rates)),
        "along": "".join(f"  d[{k}] = {e};\n" for k, e in enumerate(m.along)), "output_along": m.output_along,
    } + (_TWO if fmi == 2 else _THREE)
    target = build.host()
    with tempfile.TemporaryDirectory() as temporary:
        own = headers(fmi)
        every = re.findall(r"FullName\((fmi[23]\w+)\)", own[f"fmi{fmi}Functions.h"].decode("latin-1"))
        rest = "".join(f"int {f}() {{ return 3; }}\n" for f in dict.fromkeys(every) if f"{f}(" not in text)
        for file, content in {**own, "model.c": text.encode(), "rest.c": rest.encode()}.items():
            (Path(temporary) / file).write_bytes(content)
        subprocess.run([*build.compiler(target)[0], "-O2", "-shared", "-fPIC", "-w", "model.c", "rest.c", "-o",
                        f"{name}{target.suffix}", "-lm"], cwd=temporary, check=True)
        library = (Path(temporary) / f"{name}{target.suffix}").read_bytes()
    path = Path(folder) / f"{name}.fmu"
    where = target.fmi2 if fmi == 2 else target.name
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", (_described2 if fmi == 2 else _described3)(m, name, kind, directional))
        archive.writestr(f"binaries/{where}/{name}{target.suffix}", library)
    return path


def _described2(m, name, kind, directional):
    n, lines = len(m.rates), []
    flag = f' providesDirectionalDerivative="{"true" if directional else "false"}"'
    interface = "CoSimulation" if kind == "cs" else "ModelExchange"
    extra = ' canHandleVariableCommunicationStepSize="true"' if kind == "cs" else ""

    def variable(number, name, attributes, real):
        lines.append(f'<ScalarVariable name="{name}" valueReference="{number}" {attributes}><Real {real}/>'
                     "</ScalarVariable>")
    variable(0, "time", 'causality="independent" variability="continuous"', "")
    for k in range(n):
        variable(1 + k, f"x{k}", 'causality="local" variability="continuous" initial="exact"', f'start="{m.starts[k]}"')
    for k in range(n):
        variable(1 + n + k, f"der(x{k})", 'causality="local" variability="continuous"', f'derivative="{2 + k}"')
    variable(2 * n + 1, "u", 'causality="input" variability="continuous"', 'start="0"')
    variable(2 * n + 2, "y", 'causality="output" variability="continuous"', "")
    for k, (p, (v, low, high)) in enumerate(m.parameters.items()):
        variable(2 * n + 3 + k, p, 'causality="parameter" variability="tunable" initial="exact"',
                 f'start="{v}" min="{low}" max="{high}"')
    unknowns = "".join(f'<Unknown index="{2 + n + k}"/>' for k in range(n))
    output = f'<Unknown index="{2 * n + 3}"/>'
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="{name}" guid="{{{name}}}" numberOfEventIndicators="0">
<{interface} modelIdentifier="{name}"{extra}{flag}/><DefaultExperiment stepSize="0.01"/>
<ModelVariables>{"".join(lines)}</ModelVariables><ModelStructure><Outputs>{output}</Outputs>
<Derivatives>{unknowns}</Derivatives><InitialUnknowns>{unknowns}{output}</InitialUnknowns></ModelStructure>
</fmiModelDescription>"""


def _described3(m, name, kind, directional):
    n, lines = len(m.rates), []
    flag = f' providesDirectionalDerivatives="{"true" if directional else "false"}"'
    interface = "CoSimulation" if kind == "cs" else "ModelExchange"
    extra = ' canHandleVariableCommunicationStepSize="true"' if kind == "cs" else ""

    def variable(number, name, attributes):
        lines.append(f'<Float64 name="{name}" valueReference="{number}" {attributes}/>')
    variable(0, "time", 'causality="independent" variability="continuous"')
    for k in range(n):
        variable(1 + k, f"x{k}", f'causality="local" variability="continuous" initial="exact" start="{m.starts[k]}"')
    for k in range(n):
        variable(1 + n + k, f"der(x{k})", f'causality="local" variability="continuous" derivative="{1 + k}"')
    variable(2 * n + 1, "u", 'causality="input" variability="continuous" start="0"')
    variable(2 * n + 2, "y", 'causality="output" variability="continuous"')
    for k, (p, (v, low, high)) in enumerate(m.parameters.items()):
        variable(2 * n + 3 + k, p, 'causality="parameter" variability="tunable" initial="exact" '
                 f'start="{v}" min="{low}" max="{high}"')
    unknowns = "".join(f'<ContinuousStateDerivative valueReference="{1 + n + k}"/>' for k in range(n))
    initial = "".join(f'<InitialUnknown valueReference="{r}"/>' for r in (*range(1 + n, 1 + 2 * n), 2 * n + 2))
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="{name}" instantiationToken="{{{name}}}">
<{interface} modelIdentifier="{name}"{extra}{flag}/><DefaultExperiment stepSize="0.01"/>
<ModelVariables>{"".join(lines)}</ModelVariables><ModelStructure><Output valueReference="{2 * n + 2}"/>
{unknowns}{initial}</ModelStructure></fmiModelDescription>"""
