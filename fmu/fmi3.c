/* The functions of FMI 3.0, on top of instance.c. The only file to compile. */

#include "fmi3Functions.h"

#include "instance.c"

#define CHECK(phases) do { if (allowed(instance, phases, __func__) != OK) return fmi3Error; } while (0)
#define SETTABLE (CREATED | INITIALIZING | RUNNING | UPDATING)

static void send_log(const Instance *m, Status status, const char *category, const char *message) {
    fmi3LogMessageCallback log;
    memcpy(&log, &m->callback, sizeof log);
    log(m->environment, (fmi3Status)status, category, message);
}

const char *fmi3GetVersion(void) { return fmi3Version; }

fmi3Status fmi3SetDebugLogging(fmi3Instance instance, fmi3Boolean loggingOn, size_t nCategories,
                               const fmi3String categories[]) {
    CHECK(ANY);
    return (fmi3Status)set_logging(instance, loggingOn, nCategories, categories);
}

/* --- life -------------------------------------------------------------------------------------------------------- */

static Instance *instantiate(Kind kind, const char *name, const char *token, const char *why, bool logging,
                             void *environment, fmi3LogMessageCallback log) {
    if (!why) why = refusal(kind, name, token);
    Instance *m = why ? NULL : create(kind, name);
    if (!m) {
        if (log) log(environment, fmi3Error, "logStatusError", why ? why : "no memory for an instance");
        return NULL;
    }
    memcpy(&m->callback, &log, sizeof log);
    m->environment = environment;
    m->log = log ? send_log : NULL;
    m->logging = logging;
    return m;
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String instanceName, fmi3String instantiationToken,
                                          fmi3String resourcePath, fmi3Boolean visible, fmi3Boolean loggingOn,
                                          fmi3InstanceEnvironment instanceEnvironment,
                                          fmi3LogMessageCallback logMessage) {
    (void)resourcePath, (void)visible; /* nothing is read from the resources, nothing is shown */
    return instantiate(MODEL_EXCHANGE, instanceName, instantiationToken, NULL, loggingOn, instanceEnvironment,
                       logMessage);
}

/* What may be read, and inputs set, in the middle of a step: what the description marks. */
static bool intermediate(fmi3ValueReference v) {
    return !MODEL_SAMPLED && ((v >= VR_U && v < VR_P) || (v >= VR_X && v < VR_DX) || (v >= VR_Y && v < VR_STILL));
}

static bool ask(Instance *m, double time, double *end) {
    fmi3IntermediateUpdateCallback update;
    fmi3Boolean wanted = fmi3False;
    fmi3Float64 when = time;
    memcpy(&update, &m->callback_update, sizeof update);
    update(m->environment, time, fmi3True, fmi3True, fmi3True, m->may_return, &wanted, &when);
    *end = when;
    return m->may_return && wanted && isfinite(when);
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String instanceName, fmi3String instantiationToken,
                                         fmi3String resourcePath, fmi3Boolean visible, fmi3Boolean loggingOn,
                                         fmi3Boolean eventModeUsed,
                                         fmi3Boolean earlyReturnAllowed,
                                         const fmi3ValueReference requiredIntermediateVariables[],
                                         size_t nRequiredIntermediateVariables,
                                         fmi3InstanceEnvironment instanceEnvironment, fmi3LogMessageCallback logMessage,
                                         fmi3IntermediateUpdateCallback intermediateUpdate) {
    (void)resourcePath, (void)visible;
    const char *why = eventModeUsed ? "this FMU has no event mode in co-simulation" : NULL;
    for (size_t k = 0; !why && k < nRequiredIntermediateVariables; k++)
        if (!intermediateUpdate || !requiredIntermediateVariables || !intermediate(requiredIntermediateVariables[k]))
            why = "an intermediate variable is asked for that this FMU does not have, or without a callback";
    Instance *m = instantiate(CO_SIMULATION, instanceName, instantiationToken, why, loggingOn, instanceEnvironment,
                              logMessage);
    if (m && intermediateUpdate && !MODEL_SAMPLED) {
        memcpy(&m->callback_update, &intermediateUpdate, sizeof intermediateUpdate);
        m->update = ask;
        m->may_return = earlyReturnAllowed;
    }
    return m;
}

fmi3Instance fmi3InstantiateScheduledExecution(fmi3String instanceName, fmi3String instantiationToken,
                                               fmi3String resourcePath, fmi3Boolean visible, fmi3Boolean loggingOn,
                                               fmi3InstanceEnvironment instanceEnvironment,
                                               fmi3LogMessageCallback logMessage, fmi3ClockUpdateCallback clockUpdate,
                                               fmi3LockPreemptionCallback lockPreemption,
                                               fmi3UnlockPreemptionCallback unlockPreemption) {
    (void)resourcePath, (void)visible, (void)clockUpdate, (void)lockPreemption, (void)unlockPreemption;
    return instantiate(CO_SIMULATION, instanceName, instantiationToken, "this FMU has no scheduled execution",
                       loggingOn, instanceEnvironment, logMessage);
}

void fmi3FreeInstance(fmi3Instance instance) { free(instance); }

fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean toleranceDefined, fmi3Float64 tolerance,
                                       fmi3Float64 startTime, fmi3Boolean stopTimeDefined, fmi3Float64 stopTime) {
    (void)toleranceDefined, (void)tolerance; /* accuracy is set by the parameter solver.step */
    CHECK(CREATED);
    Status status = set_up(instance, startTime, stopTimeDefined, stopTime);
    if (status == OK) ((Instance *)instance)->s.phase = INITIALIZING;
    return (fmi3Status)status;
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance instance) {
    CHECK(INITIALIZING);
    return (fmi3Status)exit_initialization(instance);
}

fmi3Status fmi3EnterEventMode(fmi3Instance instance) {
    CHECK(CONTINUOUS | EVENT);
    ((Instance *)instance)->s.phase = EVENT;
    return fmi3OK;
}

fmi3Status fmi3Terminate(fmi3Instance instance) {
    CHECK(RUNNING);
    ((Instance *)instance)->s.phase = TERMINATED;
    return fmi3OK;
}

fmi3Status fmi3Reset(fmi3Instance instance) {
    CHECK(ANY);
    to_start(instance);
    return fmi3OK;
}

/* --- values ------------------------------------------------------------------------------------------------------ */

fmi3Status fmi3GetFloat64(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                          fmi3Float64 values[], size_t nValues) {
    CHECK(READABLE | UPDATING);
    if (nValues != nValueReferences) return (fmi3Status)unsupported(instance, __func__);
    return (fmi3Status)get_values(instance, valueReferences, nValueReferences, values, __func__);
}

fmi3Status fmi3SetFloat64(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                          const fmi3Float64 values[], size_t nValues) {
    CHECK(SETTABLE);
    if (nValues != nValueReferences) return (fmi3Status)unsupported(instance, __func__);
    return (fmi3Status)set_values(instance, valueReferences, nValueReferences, values, __func__);
}

fmi3Status fmi3GetBoolean(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                          fmi3Boolean values[], size_t nValues) {
    CHECK(READABLE);
    if (nValues != nValueReferences) return (fmi3Status)unsupported(instance, __func__);
    if (nValues && (!valueReferences || !values)) return (fmi3Status)null_pointer(instance, __func__);
    for (size_t k = 0; k < nValues; k++) {
        Status status = get_still(instance, valueReferences[k], &values[k], __func__);
        if (status != OK) return (fmi3Status)status;
    }
    return fmi3OK;
}

/* Types without variables, and Booleans, which are all computed: fine with nothing, an error with anything. */
#define NO_VARIABLES(name, phases, type)                                                                             \
    fmi3Status name(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,      \
                    type values[], size_t nValues) {                                                                 \
        (void)valueReferences, (void)values;                                                                         \
        CHECK(phases);                                                                                               \
        return nValueReferences || nValues ? (fmi3Status)unsupported(instance, __func__) : fmi3OK;                   \
    }
#define NO_TYPE(name) \
    NO_VARIABLES(fmi3Get##name, READABLE, fmi3##name) NO_VARIABLES(fmi3Set##name, SETTABLE, const fmi3##name)
NO_TYPE(Float32)
NO_TYPE(Int8)
NO_TYPE(UInt8)
NO_TYPE(Int16)
NO_TYPE(UInt16)
NO_TYPE(Int32)
NO_TYPE(UInt32)
NO_TYPE(Int64)
NO_TYPE(UInt64)
NO_TYPE(String)
NO_VARIABLES(fmi3SetBoolean, SETTABLE, const fmi3Boolean)

#define NO_BINARY(name, phases, sizes_type, type)                                                                    \
    fmi3Status name(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,      \
                    sizes_type valueSizes[], type values[], size_t nValues) {                                        \
        (void)valueReferences, (void)valueSizes, (void)values;                                                       \
        CHECK(phases);                                                                                               \
        return nValueReferences || nValues ? (fmi3Status)unsupported(instance, __func__) : fmi3OK;                   \
    }
NO_BINARY(fmi3GetBinary, READABLE, size_t, fmi3Binary)
NO_BINARY(fmi3SetBinary, SETTABLE, const size_t, const fmi3Binary)

/* Clocks: there are none. */
#define NO_CLOCK(name, parameters, ...)                                                                              \
    fmi3Status name parameters {                                                                                     \
        (void)valueReferences, __VA_ARGS__;                                                                          \
        CHECK(ANY);                                                                                                  \
        return nValueReferences ? (fmi3Status)unsupported(instance, __func__) : fmi3OK;                              \
    }
#define CLOCKS fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences
NO_CLOCK(fmi3GetClock, (CLOCKS, fmi3Clock values[]), (void)values)
NO_CLOCK(fmi3SetClock, (CLOCKS, const fmi3Clock values[]), (void)values)
NO_CLOCK(fmi3GetIntervalDecimal, (CLOCKS, fmi3Float64 intervals[], fmi3IntervalQualifier qualifiers[]), (void)intervals,
         (void)qualifiers)
NO_CLOCK(fmi3GetIntervalFraction,
         (CLOCKS, fmi3UInt64 counters[], fmi3UInt64 resolutions[], fmi3IntervalQualifier qualifiers[]), (void)counters,
         (void)resolutions, (void)qualifiers)
NO_CLOCK(fmi3GetShiftDecimal, (CLOCKS, fmi3Float64 shifts[]), (void)shifts)
NO_CLOCK(fmi3GetShiftFraction, (CLOCKS, fmi3UInt64 counters[], fmi3UInt64 resolutions[]), (void)counters,
         (void)resolutions)
NO_CLOCK(fmi3SetIntervalDecimal, (CLOCKS, const fmi3Float64 intervals[]), (void)intervals)
NO_CLOCK(fmi3SetIntervalFraction, (CLOCKS, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[]),
         (void)counters, (void)resolutions)
NO_CLOCK(fmi3SetShiftDecimal, (CLOCKS, const fmi3Float64 shifts[]), (void)shifts)
NO_CLOCK(fmi3SetShiftFraction, (CLOCKS, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[]),
         (void)counters, (void)resolutions)

fmi3Status fmi3GetNumberOfVariableDependencies(fmi3Instance instance, fmi3ValueReference valueReference,
                                               size_t *nDependencies) {
    (void)valueReference, (void)nDependencies;
    return (fmi3Status)unsupported(instance, __func__);
}

fmi3Status fmi3GetVariableDependencies(fmi3Instance instance, fmi3ValueReference dependent,
                                       size_t elementIndicesOfDependent[], fmi3ValueReference independents[],
                                       size_t elementIndicesOfIndependents[], fmi3DependencyKind dependencyKinds[],
                                       size_t nDependencies) {
    (void)dependent, (void)elementIndicesOfDependent, (void)independents, (void)elementIndicesOfIndependents;
    (void)dependencyKinds, (void)nDependencies;
    return (fmi3Status)unsupported(instance, __func__);
}

/* --- saved states ------------------------------------------------------------------------------------------------ */

fmi3Status fmi3GetFMUState(fmi3Instance instance, fmi3FMUState *FMUState) {
    CHECK(ANY);
    return (fmi3Status)save(instance, FMUState, __func__);
}

fmi3Status fmi3SetFMUState(fmi3Instance instance, fmi3FMUState FMUState) {
    CHECK(ANY);
    return (fmi3Status)restore(instance, FMUState, __func__);
}

fmi3Status fmi3FreeFMUState(fmi3Instance instance, fmi3FMUState *FMUState) {
    CHECK(ANY);
    release(FMUState);
    return fmi3OK;
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance instance, fmi3FMUState FMUState, size_t *size) {
    CHECK(ANY);
    if (!size || check_saved(instance, FMUState, __func__) != OK) return fmi3Error;
    *size = sizeof(Serialized);
    return fmi3OK;
}

fmi3Status fmi3SerializeFMUState(fmi3Instance instance, fmi3FMUState FMUState, fmi3Byte serializedState[],
                                 size_t size) {
    CHECK(ANY);
    return (fmi3Status)serialize(instance, FMUState, serializedState, size, __func__);
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance instance, const fmi3Byte serializedState[], size_t size,
                                   fmi3FMUState *FMUState) {
    CHECK(ANY);
    return (fmi3Status)deserialize(instance, serializedState, size, FMUState, __func__);
}

/* --- derivatives ------------------------------------------------------------------------------------------------- */

fmi3Status fmi3GetDirectionalDerivative(fmi3Instance instance, const fmi3ValueReference unknowns[], size_t nUnknowns,
                                        const fmi3ValueReference knowns[], size_t nKnowns, const fmi3Float64 seed[],
                                        size_t nSeed, fmi3Float64 sensitivity[], size_t nSensitivity) {
    CHECK(READABLE);
    if (nSeed != nKnowns || nSensitivity != nUnknowns) return (fmi3Status)unsupported(instance, __func__);
    return (fmi3Status)directional(instance, unknowns, nUnknowns, knowns, nKnowns, seed, sensitivity, __func__);
}

/* sensitivity = (d unknown / d known)^T seed */
static Status adjoint(Instance *m, const uint32_t *unknown, size_t n_unknown, const uint32_t *known, size_t n_known,
                      const double *seed, double *sensitivity, const char *function) {
    Status status = check_derivative(m, unknown, n_unknown, known, n_known, seed, n_unknown, sensitivity, function);
    if (status != OK) return status;
    clear_slots(m);
    const bool held = holding(m); /* outputs that nothing moves before the next sample */
    double own[DIM(NX)] = {0}; /* seeds on outputs that are states pass straight through */
    for (size_t k = 0; k < n_unknown; k++) {
        uint32_t v = unknown[k];
        *(v >= VR_X && v < VR_DX ? &own[v - VR_X] : unknown_slot(m, v)) += seed[k];
    }
    if (held) memset(m->dy, 0, sizeof m->dy);
    arguments(m, m->s.z_now);
    m->arg[5] = m->dxdot, m->arg[6] = m->dy;
    m->res[0] = m->dx, m->res[1] = m->du, m->res[2] = m->dp, m->res[3] = &m->dt;
    if (model_reverse(m->arg, m->res, m->iw, m->w, 0))
        return fail(m, ERROR, "%s: the equations are singular at t = %g s", function, m->s.time);
    for (size_t k = 0; k < NX; k++) m->dx[k] += own[k];
    for (size_t k = 0; k < n_known; k++) sensitivity[k] = *known_slot(m, known[k]);
    return OK;
}

fmi3Status fmi3GetAdjointDerivative(fmi3Instance instance, const fmi3ValueReference unknowns[], size_t nUnknowns,
                                    const fmi3ValueReference knowns[], size_t nKnowns, const fmi3Float64 seed[],
                                    size_t nSeed, fmi3Float64 sensitivity[], size_t nSensitivity) {
    CHECK(READABLE);
    if (nSeed != nUnknowns || nSensitivity != nKnowns) return (fmi3Status)unsupported(instance, __func__);
    return (fmi3Status)adjoint(instance, unknowns, nUnknowns, knowns, nKnowns, seed, sensitivity, __func__);
}

/* --- modes ------------------------------------------------------------------------------------------------------- */

/* There are no structural parameters to configure. */
fmi3Status fmi3EnterConfigurationMode(fmi3Instance instance) { return (fmi3Status)unsupported(instance, __func__); }
fmi3Status fmi3ExitConfigurationMode(fmi3Instance instance) { return (fmi3Status)unsupported(instance, __func__); }

fmi3Status fmi3EvaluateDiscreteStates(fmi3Instance instance) {
    CHECK(INITIALIZING | EVENT);
    return (fmi3Status)evaluate(instance);
}

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance instance, fmi3Boolean *discreteStatesNeedUpdate,
                                    fmi3Boolean *terminateSimulation, fmi3Boolean *nominalsOfContinuousStatesChanged,
                                    fmi3Boolean *valuesOfContinuousStatesChanged, fmi3Boolean *nextEventTimeDefined,
                                    fmi3Float64 *nextEventTime) {
    fmi3Boolean *flags[] = {discreteStatesNeedUpdate, terminateSimulation, nominalsOfContinuousStatesChanged,
                            valuesOfContinuousStatesChanged, nextEventTimeDefined};
    CHECK(EVENT);
    for (size_t k = 0; k < sizeof flags / sizeof *flags; k++)
        if (flags[k]) *flags[k] = fmi3False;
    if (nextEventTime) *nextEventTime = 0;
    return (fmi3Status)update_discrete(instance);
}

/* --- model exchange ---------------------------------------------------------------------------------------------- */

fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance instance) {
    CHECK(EVENT);
    ((Instance *)instance)->s.phase = CONTINUOUS;
    return fmi3OK;
}

fmi3Status fmi3CompletedIntegratorStep(fmi3Instance instance, fmi3Boolean noSetFMUStatePriorToCurrentPoint,
                                       fmi3Boolean *enterEventMode, fmi3Boolean *terminateSimulation) {
    (void)noSetFMUStatePriorToCurrentPoint;
    CHECK(CONTINUOUS);
    if (!enterEventMode || !terminateSimulation) return (fmi3Status)null_pointer(instance, __func__);
    *enterEventMode = *terminateSimulation = fmi3False;
    return (fmi3Status)commit(instance);
}

fmi3Status fmi3SetTime(fmi3Instance instance, fmi3Float64 time) {
    CHECK(EVENT | CONTINUOUS);
    return (fmi3Status)set_time(instance, time, __func__);
}

fmi3Status fmi3SetContinuousStates(fmi3Instance instance, const fmi3Float64 continuousStates[],
                                   size_t nContinuousStates) {
    CHECK(CONTINUOUS);
    return (fmi3Status)set_states(instance, continuousStates, nContinuousStates, __func__);
}

fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance instance, fmi3Float64 derivatives[],
                                             size_t nContinuousStates) {
    return (fmi3Status)read_vector(instance, VR_DX, NX, derivatives, nContinuousStates, __func__);
}

fmi3Status fmi3GetEventIndicators(fmi3Instance instance, fmi3Float64 eventIndicators[], size_t nEventIndicators) {
    return (fmi3Status)read_vector(instance, VR_Y, NE, eventIndicators, nEventIndicators, __func__);
}

fmi3Status fmi3GetContinuousStates(fmi3Instance instance, fmi3Float64 continuousStates[], size_t nContinuousStates) {
    return (fmi3Status)read_vector(instance, VR_X, NX, continuousStates, nContinuousStates, __func__);
}

fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance instance, fmi3Float64 nominals[], size_t nContinuousStates) {
    CHECK(ANY);
    return (fmi3Status)get_vector(instance, model_x_nominal, NX, nominals, nContinuousStates, __func__);
}

static fmi3Status count(Instance *m, size_t n, size_t *value, const char *function) {
    if (allowed(m, ANY, function) != OK) return fmi3Error;
    if (!value) return (fmi3Status)null_pointer(m, function);
    *value = n;
    return fmi3OK;
}

fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance instance, size_t *nEventIndicators) {
    return count(instance, NE, nEventIndicators, __func__);
}

fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance instance, size_t *nContinuousStates) {
    return count(instance, NX, nContinuousStates, __func__);
}

/* --- co-simulation ----------------------------------------------------------------------------------------------- */

fmi3Status fmi3EnterStepMode(fmi3Instance instance) { return (fmi3Status)unsupported(instance, __func__); }

fmi3Status fmi3GetOutputDerivatives(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                    size_t nValueReferences, const fmi3Int32 orders[], fmi3Float64 values[],
                                    size_t nValues) {
    CHECK(STEPPING | TERMINATED | FAILED);
    if (nValues != nValueReferences) return (fmi3Status)unsupported(instance, __func__);
    return (fmi3Status)time_derivatives(instance, valueReferences, nValueReferences, orders, values, __func__);
}

fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 currentCommunicationPoint, fmi3Float64 communicationStepSize,
                      fmi3Boolean noSetFMUStatePriorToCurrentPoint, fmi3Boolean *eventHandlingNeeded,
                      fmi3Boolean *terminateSimulation, fmi3Boolean *earlyReturn, fmi3Float64 *lastSuccessfulTime) {
    fmi3Boolean *flags[] = {eventHandlingNeeded, terminateSimulation, earlyReturn};
    (void)noSetFMUStatePriorToCurrentPoint;
    CHECK(STEPPING);
    Status status = do_step(instance, currentCommunicationPoint, communicationStepSize);
    for (size_t k = 0; k < sizeof flags / sizeof *flags; k++)
        if (flags[k]) *flags[k] = fmi3False;
    if (earlyReturn && status == OK) *earlyReturn = ((Instance *)instance)->returned;
    if (lastSuccessfulTime) *lastSuccessfulTime = ((Instance *)instance)->s.time;
    return (fmi3Status)status;
}

/* --- scheduled execution: not offered ---------------------------------------------------------------------------- */

fmi3Status fmi3ActivateModelPartition(fmi3Instance instance, fmi3ValueReference clockReference,
                                      fmi3Float64 activationTime) {
    (void)clockReference, (void)activationTime;
    return (fmi3Status)unsupported(instance, __func__);
}
