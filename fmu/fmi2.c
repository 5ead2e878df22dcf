/* The functions of FMI 2.0, on top of instance.c. The only file to compile. */

#include "fmi2Functions.h"

#include "instance.c"

#define CHECK(phases) do { if (allowed(c, phases, __func__) != OK) return fmi2Error; } while (0)

static void send_log(const Instance *m, Status status, const char *category, const char *message) {
    fmi2CallbackLogger logger;
    memcpy(&logger, &m->callback, sizeof logger);
    logger(m->environment, m->name, (fmi2Status)status, category, "%s", message);
}

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean loggingOn, size_t nCategories,
                               const fmi2String categories[]) {
    CHECK(ANY);
    return (fmi2Status)set_logging(c, loggingOn, nCategories, categories);
}

/* --- life -------------------------------------------------------------------------------------------------------- */

fmi2Component fmi2Instantiate(fmi2String instanceName, fmi2Type fmuType, fmi2String fmuGUID,
                              fmi2String fmuResourceLocation, const fmi2CallbackFunctions *functions,
                              fmi2Boolean visible, fmi2Boolean loggingOn) {
    (void)fmuResourceLocation, (void)visible; /* nothing is read from the resources, nothing is shown */
    if (!functions) return NULL;
    Kind kind = fmuType == fmi2CoSimulation ? CO_SIMULATION : MODEL_EXCHANGE;
    const char *why = refusal(kind, instanceName, fmuGUID);
    Instance *m = why ? NULL : create(kind, instanceName);
    if (!m) {
        if (functions->logger)
            functions->logger(functions->componentEnvironment, instanceName ? instanceName : "", fmi2Error,
                              "logStatusError", "%s", why ? why : "no memory for an instance");
        return NULL;
    }
    fmi2CallbackLogger logger = functions->logger;
    memcpy(&m->callback, &logger, sizeof logger);
    m->environment = functions->componentEnvironment;
    m->log = logger ? send_log : NULL;
    m->logging = loggingOn;
    return m;
}

void fmi2FreeInstance(fmi2Component c) { free(c); }

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean toleranceDefined, fmi2Real tolerance, fmi2Real startTime,
                               fmi2Boolean stopTimeDefined, fmi2Real stopTime) {
    (void)toleranceDefined, (void)tolerance; /* accuracy is set by the parameter solver.step */
    CHECK(CREATED);
    return (fmi2Status)set_up(c, startTime, stopTimeDefined, stopTime);
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c) {
    CHECK(CREATED);
    ((Instance *)c)->s.phase = INITIALIZING;
    return fmi2OK;
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
    CHECK(INITIALIZING);
    return (fmi2Status)exit_initialization(c);
}

fmi2Status fmi2Terminate(fmi2Component c) {
    CHECK(RUNNING);
    ((Instance *)c)->s.phase = TERMINATED;
    return fmi2OK;
}

fmi2Status fmi2Reset(fmi2Component c) {
    CHECK(ANY);
    to_start(c);
    return fmi2OK;
}

/* --- values ------------------------------------------------------------------------------------------------------ */

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Real value[]) {
    CHECK(READABLE);
    return (fmi2Status)get_values(c, vr, nvr, value, __func__);
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Real value[]) {
    CHECK(CREATED | INITIALIZING | RUNNING);
    return (fmi2Status)set_values(c, vr, nvr, value, __func__);
}

fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Boolean value[]) {
    CHECK(READABLE);
    if (nvr && (!vr || !value)) return (fmi2Status)null_pointer(c, __func__);
    for (size_t k = 0; k < nvr; k++) {
        bool still = false;
        Status status = get_still(c, vr[k], &still, __func__);
        if (status != OK) return (fmi2Status)status;
        value[k] = still;
    }
    return fmi2OK;
}

/* Types without variables, and Booleans, which are all computed: fine with nothing, an error with anything. */
#define NO_VARIABLES(name, phases, type)                                                                             \
    fmi2Status name(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, type value[]) {                      \
        (void)vr, (void)value;                                                                                       \
        CHECK(phases);                                                                                               \
        return nvr ? (fmi2Status)unsupported(c, __func__) : fmi2OK;                                                  \
    }
NO_VARIABLES(fmi2GetInteger, READABLE, fmi2Integer)
NO_VARIABLES(fmi2GetString, READABLE, fmi2String)
NO_VARIABLES(fmi2SetInteger, CREATED | INITIALIZING | RUNNING, const fmi2Integer)
NO_VARIABLES(fmi2SetBoolean, CREATED | INITIALIZING | RUNNING, const fmi2Boolean)
NO_VARIABLES(fmi2SetString, CREATED | INITIALIZING | RUNNING, const fmi2String)

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference vUnknown_ref[], size_t nUnknown,
                                        const fmi2ValueReference vKnown_ref[], size_t nKnown, const fmi2Real dvKnown[],
                                        fmi2Real dvUnknown[]) {
    CHECK(READABLE);
    return (fmi2Status)directional(c, vUnknown_ref, nUnknown, vKnown_ref, nKnown, dvKnown, dvUnknown, __func__);
}

/* --- saved states ------------------------------------------------------------------------------------------------ */

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *FMUstate) {
    CHECK(ANY);
    return (fmi2Status)save(c, FMUstate, __func__);
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate FMUstate) {
    CHECK(ANY);
    return (fmi2Status)restore(c, FMUstate, __func__);
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *FMUstate) {
    CHECK(ANY);
    release(FMUstate);
    return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate FMUstate, size_t *size) {
    CHECK(ANY);
    if (!size || check_saved(c, FMUstate, __func__) != OK) return fmi2Error;
    *size = sizeof(Serialized);
    return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate FMUstate, fmi2Byte serializedState[], size_t size) {
    CHECK(ANY);
    return (fmi2Status)serialize(c, FMUstate, serializedState, size, __func__);
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte serializedState[], size_t size,
                                   fmi2FMUstate *FMUstate) {
    CHECK(ANY);
    return (fmi2Status)deserialize(c, serializedState, size, FMUstate, __func__);
}

/* --- model exchange ---------------------------------------------------------------------------------------------- */

fmi2Status fmi2EnterEventMode(fmi2Component c) {
    CHECK(CONTINUOUS | EVENT);
    ((Instance *)c)->s.phase = EVENT;
    return fmi2OK;
}

fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *eventInfo) {
    CHECK(EVENT);
    if (!eventInfo) return (fmi2Status)null_pointer(c, __func__);
    *eventInfo = (fmi2EventInfo){0};
    return (fmi2Status)update_discrete(c);
}

fmi2Status fmi2EnterContinuousTimeMode(fmi2Component c) {
    CHECK(EVENT);
    ((Instance *)c)->s.phase = CONTINUOUS;
    return fmi2OK;
}

fmi2Status fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean noSetFMUStatePriorToCurrentPoint,
                                       fmi2Boolean *enterEventMode, fmi2Boolean *terminateSimulation) {
    (void)noSetFMUStatePriorToCurrentPoint;
    CHECK(CONTINUOUS);
    if (!enterEventMode || !terminateSimulation) return (fmi2Status)null_pointer(c, __func__);
    *enterEventMode = *terminateSimulation = fmi2False;
    return (fmi2Status)commit(c);
}

fmi2Status fmi2SetTime(fmi2Component c, fmi2Real time) {
    CHECK(EVENT | CONTINUOUS);
    return (fmi2Status)set_time(c, time, __func__);
}

fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real x[], size_t nx) {
    CHECK(CONTINUOUS);
    return (fmi2Status)set_states(c, x, nx, __func__);
}

fmi2Status fmi2GetDerivatives(fmi2Component c, fmi2Real derivatives[], size_t nx) {
    return (fmi2Status)read_vector(c, VR_DX, NX, derivatives, nx, __func__);
}

fmi2Status fmi2GetEventIndicators(fmi2Component c, fmi2Real eventIndicators[], size_t ni) {
    return (fmi2Status)read_vector(c, VR_Y, NE, eventIndicators, ni, __func__);
}

fmi2Status fmi2GetContinuousStates(fmi2Component c, fmi2Real x[], size_t nx) {
    return (fmi2Status)read_vector(c, VR_X, NX, x, nx, __func__);
}

fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component c, fmi2Real x_nominal[], size_t nx) {
    CHECK(ANY);
    return (fmi2Status)get_vector(c, model_x_nominal, NX, x_nominal, nx, __func__);
}

/* --- co-simulation ----------------------------------------------------------------------------------------------- */

static Status set_slope(Instance *m, uint32_t v, int order, double value, const char *function) {
    if (v < VR_U || v >= VR_P) return fail(m, ERROR, "%s: value reference %u is not an input", function, v);
    if (order != 1) return fail(m, ERROR, "%s: order %d of '%s'; only the first derivative is used", function, order,
                                model_names[v - VR_TIME]);
    if (!isfinite(value))
        return fail(m, ERROR, "%s: the derivative of '%s' is not finite", function, model_names[v - VR_TIME]);
    m->s.du[v - VR_U] = value;
    return OK;
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                                       const fmi2Integer order[], const fmi2Real value[]) {
    CHECK(INITIALIZING | STEPPING);
    if (nvr && (!vr || !order || !value)) return (fmi2Status)null_pointer(c, __func__);
    for (size_t k = 0; k < nvr; k++) {
        Status status = set_slope(c, vr[k], order[k], value[k], __func__);
        if (status != OK) return (fmi2Status)status;
    }
    return fmi2OK;
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                                        const fmi2Integer order[], fmi2Real value[]) {
    CHECK(STEPPING | TERMINATED | FAILED);
    return (fmi2Status)time_derivatives(c, vr, nvr, order, value, __func__);
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real currentCommunicationPoint, fmi2Real communicationStepSize,
                      fmi2Boolean noSetFMUStatePriorToCurrentPoint) {
    (void)noSetFMUStatePriorToCurrentPoint;
    CHECK(STEPPING);
    return (fmi2Status)do_step(c, currentCommunicationPoint, communicationStepSize);
}

/* Steps are done when fmi2DoStep returns, so nothing is ever pending or to be cancelled. */
fmi2Status fmi2CancelStep(fmi2Component c) { return (fmi2Status)unsupported(c, __func__); }

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind s, fmi2Real *value) {
    CHECK(STEPPING | TERMINATED | FAILED);
    if (s != fmi2LastSuccessfulTime || !value) return (fmi2Status)unsupported(c, __func__);
    *value = ((Instance *)c)->s.time;
    return fmi2OK;
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind s, fmi2Boolean *value) {
    CHECK(STEPPING | TERMINATED | FAILED);
    if (s != fmi2Terminated || !value) return (fmi2Status)unsupported(c, __func__);
    *value = fmi2False;
    return fmi2OK;
}

#define NO_STATUS(name, type)                                                                                        \
    fmi2Status name(fmi2Component c, const fmi2StatusKind s, type *value) {                                          \
        (void)s, (void)value;                                                                                        \
        CHECK(STEPPING | TERMINATED | FAILED);                                                                       \
        return (fmi2Status)unsupported(c, __func__);                                                                 \
    }
NO_STATUS(fmi2GetStatus, fmi2Status)
NO_STATUS(fmi2GetIntegerStatus, fmi2Integer)
NO_STATUS(fmi2GetStringStatus, fmi2String)
