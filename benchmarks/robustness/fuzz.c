/* Random calls of every kind, in any order, with good and bad values, on a few instances; or a long run ("soak").
   Compile with -DFMI=2 or 3 beside the sources of an FMU, for the first with -fsanitize=address,undefined. */

#if FMI == 2
#include "fmi2.c"
#define F(name) fmi2##name
#define COUNT(n)
typedef fmi2FMUstate Handle;
#else
#include "fmi3.c"
#define F(name) fmi3##name
#define COUNT(n) , n
#define fmi3GetFMUstate fmi3GetFMUState
#define fmi3SetFMUstate fmi3SetFMUState
#define fmi3FreeFMUstate fmi3FreeFMUState
#define fmi3SerializedFMUstateSize fmi3SerializedFMUStateSize
#define fmi3SerializeFMUstate fmi3SerializeFMUState
#define fmi3DeSerializeFMUstate fmi3DeserializeFMUState
#define fmi3GetReal fmi3GetFloat64
#define fmi3SetReal fmi3SetFloat64
#define fmi3GetDerivatives fmi3GetContinuousStateDerivatives
typedef fmi3FMUState Handle;
#endif

enum { INSTANCES = 4, MOST = 6, BYTES = 65536 };
static uint64_t seed = 1;
static long messages, fine, steps;
static void *instance[INSTANCES];
static Handle saved[INSTANCES];
static char bytes[BYTES];
static size_t length;

static unsigned dice(unsigned n) { /* 64-bit congruential generator, upper half */
    seed = seed * 6364136223846793005u + 1442695040888963407u;
    return (unsigned)(seed >> 33) % n;
}

static double number(void) {
    static const double odd[] = {0, 1, -1, NAN, INFINITY, -INFINITY, 1e308, -1e308, 5e-324, 1e-3, 1e9};
    return dice(4) ? dice(2001) / 1000.0 - 1 : odd[dice(sizeof odd / sizeof *odd)];
}

#if FMI == 2
static void hear(fmi2ComponentEnvironment e, fmi2String n, fmi2Status s, fmi2String c, fmi2String f, ...) {
    (void)e, (void)n, (void)s, (void)c, (void)f, messages++;
}
static const fmi2CallbackFunctions callbacks = {hear, NULL, NULL, NULL, NULL};
#else
static void hear(fmi3InstanceEnvironment e, fmi3Status s, fmi3String c, fmi3String m) {
    (void)e, (void)s, (void)c, (void)m, messages++;
}
#endif

static void *make(bool me) {
    const char *token = dice(20) ? MODEL_TOKEN : "{other}", *name = dice(20) ? "fuzz" : NULL;
#if FMI == 2
    return fmi2Instantiate(name, me ? fmi2ModelExchange : fmi2CoSimulation, token, NULL,
                           dice(20) ? &callbacks : NULL, 0, (int)dice(2));
#else
    if (me) return fmi3InstantiateModelExchange(name, token, NULL, false, dice(2), NULL, dice(9) ? hear : NULL);
    return fmi3InstantiateCoSimulation(name, token, NULL, false, dice(2), !dice(30), false, NULL, 0, NULL,
                                       dice(9) ? hear : NULL, NULL);
#endif
}

static int enter(void *m) {
    double start = dice(9) ? 0 : number(), stop = number();
#if FMI == 2
    return fmi2SetupExperiment(m, 0, 0, start, (int)!dice(5), stop) | fmi2EnterInitializationMode(m);
#else
    return fmi3EnterInitializationMode(m, false, 0, start, !dice(5), stop);
#endif
}

static int step(void *m, double t, double h) {
#if FMI == 2
    return fmi2DoStep(m, t, h, 1);
#else
    bool a, b, c;
    double last;
    return fmi3DoStep(m, t, h, true, &a, &b, &c, &last);
#endif
}

static int discrete(void *m) {
#if FMI == 2
    fmi2EventInfo info;
    return fmi2NewDiscreteStates(m, &info);
#else
    bool b[5];
    double next;
    return fmi3UpdateDiscreteStates(m, &b[0], &b[1], &b[2], &b[3], &b[4], &next);
#endif
}

static int derivatives(void *m, const uint32_t *a, size_t n, const uint32_t *b, size_t k, const double *from,
                       double *to) {
#if FMI == 2
    return fmi2GetDirectionalDerivative(m, a, n, b, k, from, to);
#else
    return dice(2) ? fmi3GetDirectionalDerivative(m, a, n, b, k, from, k, to, n)
                   : fmi3GetAdjointDerivative(m, b, k, a, n, from, k, to, n);
#endif
}

static int once(unsigned i) {
    void *m = instance[i];
    uint32_t vr[MOST], other[MOST];
    double v[DIM(NX) + MOST], out[DIM(NX) + DIM(NE) + MOST], t = m ? ((Instance *)m)->s.time : 0;
    size_t n = dice(MOST + 1), size = 0;
    for (int k = 0; k < MOST; k++) vr[k] = dice(20) ? dice(VR_END) : dice(1u << 31), other[k] = dice(VR_Y);
    for (int k = 0; k < NX + MOST; k++) v[k] = number();
    if (m && ((Instance *)m)->s.p[NP - 1] < 1e-4) F(Reset)(m); /* steps of a microsecond would take all day */
    switch (dice(26)) {
    case 0:
        if (m && dice(4)) return 0;
        F(FreeInstance)(m);
        instance[i] = make(dice(2));
        return 0;
    case 1: return enter(m);
    case 2: return F(ExitInitializationMode)(m);
    case 3: return dice(8) ? 0 : F(Terminate)(m);
    case 4: return dice(8) ? 0 : F(Reset)(m);
    case 5: case 6: return F(GetReal)(m, dice(30) ? vr : NULL, n, out COUNT(n));
    case 7: case 8: return F(SetReal)(m, vr, n, dice(30) ? v : NULL COUNT(n));
    case 9: vr[0] = VR_U + dice(DIM(NU)); return F(SetReal)(m, vr, 1, v COUNT(1));
    case 10: case 11: case 12: case 13:
        steps++;
        return step(m, dice(20) ? t : number(), dice(12) ? 1e-3 * (1 + dice(4)) : dice(2) ? number() : -1e-3);
    case 14: return derivatives(m, vr, n, other, n, v, out);
    case 15: vr[0] = VR_DX + dice(DIM(NX)); return derivatives(m, vr, 1, other, n, v, out);
    case 16: return F(GetFMUstate)(m, &saved[i]);
    case 17: return F(SetFMUstate)(m, saved[dice(5) ? i : dice(INSTANCES)]);
    case 18: return F(FreeFMUstate)(m, &saved[i]);
    case 19:
        if (F(SerializedFMUstateSize)(m, saved[i], &size) || size > BYTES) return 1;
        length = size;
        return F(SerializeFMUstate)(m, saved[i], (void *)bytes, dice(20) ? size : size / 2);
    case 20:
        if (!dice(4) && length) bytes[dice((unsigned)length)] ^= 1;
        return F(DeSerializeFMUstate)(m, (const void *)bytes, dice(9) ? length : length / 2, &saved[i]);
    case 21: return dice(2) ? F(EnterEventMode)(m) : F(EnterContinuousTimeMode)(m);
    case 22: return discrete(m);
    case 23: return F(SetContinuousStates)(m, v, dice(9) ? NX : n) | F(GetDerivatives)(m, out, dice(9) ? NX : n);
    case 24: return F(GetEventIndicators)(m, out, NE) | F(SetTime)(m, dice(3) ? t + 1e-3 : number());
    default: {
#if FMI == 2
        fmi2Boolean b[MOST], event, end;
        for (int k = 0; k < MOST; k++) vr[k] = VR_STILL + dice(DIM(NE) + 1);
        return fmi2GetBoolean(m, vr, n, b) | fmi2CompletedIntegratorStep(m, 1, &event, &end);
#else
        bool b[MOST], event, end;
        for (int k = 0; k < MOST; k++) vr[k] = VR_STILL + dice(DIM(NE) + 1);
        return fmi3GetBoolean(m, vr, n, b, n) | fmi3CompletedIntegratorStep(m, true, &event, &end);
#endif
    }
    }
}

static long resident(void) { /* KiB */
    long pages = 0, kept = 0;
    FILE *f = fopen("/proc/self/statm", "r");
    if (f && fscanf(f, "%ld %ld", &pages, &kept) != 2) kept = 0;
    if (f) fclose(f);
    return 4 * kept;
}

/* Two million steps with everything that could leak in between. */
static int soak(long n) {
    long before = 0;
    void *m = NULL;
    uint32_t input = VR_U;
    for (long k = 0; k < n; k++) {
        if (k % 20000 == 0) {
            F(FreeInstance)(m);
            while (!(m = make(false))) continue;
            enter(m);
            F(Reset)(m);
#if FMI == 2
            fmi2SetupExperiment(m, 0, 0, 0, 0, 0), fmi2EnterInitializationMode(m);
#else
            fmi3EnterInitializationMode(m, false, 0, 0, false, 0);
#endif
            F(ExitInitializationMode)(m);
        }
        double u = 0.5 * sin(2e-3 * k), t = ((Instance *)m)->s.time;
        if (F(SetReal)(m, &input, 1, &u COUNT(1)) || step(m, t, 1e-3)) return 1;
        if (k % 100 == 0) {
            Handle state = NULL;
            if (F(GetFMUstate)(m, &state) || F(SetFMUstate)(m, state) || F(FreeFMUstate)(m, &state)) return 1;
        }
        if (k == n / 10) before = resident();
    }
    F(FreeInstance)(m);
    printf("{\"steps\": %ld, \"grown_KiB\": %ld}\n", n, resident() - before);
    return 0;
}

int main(int argc, char **argv) {
    long n = argc > 2 ? atol(argv[2]) : 1000;
    if (argc > 1 && !strcmp(argv[1], "soak")) return soak(n);
    if (argc > 3) seed = (uint64_t)atol(argv[3]);
    for (long k = 0; k < n; k++) fine += once(dice(INSTANCES)) == 0;
    for (int i = 0; i < INSTANCES; i++) {
        void *m = instance[i] ? instance[i] : make(false);
        while (!m) m = make(false);
        F(FreeFMUstate)(m, &saved[i]);
        F(FreeInstance)(m);
    }
    printf("{\"calls\": %ld, \"fine\": %ld, \"steps\": %ld, \"messages\": %ld}\n", n, fine, steps, messages);
    return 0;
}
