/* The operations by name: each takes its items in the order of the firmware's Python function. */
#include "cases.h"
#include "inversion.h"
#include "machine.h"
#include "message.h"
#include "monitor.h"

static buffer_t buffer(void)
{
    double *lo = reals();
    return (buffer_t){lo, reals()};
}

static adc_t adc(void)
{
    bounds_t step = bounds(), offset = bounds();
    return (adc_t){step.lo, step.hi, offset.lo, offset.hi, real()};
}

static input_t input(void)
{
    input_t in = {.codes = integers()};
    in.n = integer(), in.last = integer(), in.adc = adc(), in.reach = real();
    return in;
}

static memory_t memory(void)
{
    memory_t found = {.known = integers()};
    found.slots = length(found.known), found.lows = reals(), found.highs = reals();
    return found;
}

static void nothing(void) { COUNT(); }

static void loop(void)
{
    uint32_t rounds = (uint32_t)integer();
    COUNT(__asm volatile("1: subs %0, #1\n bne 1b" : "+r"(rounds) : : "cc"));
}

static void rounding(void)
{
    double *x = reals();
    COUNT(x[1] = down(x[0]));
    x[2] = up(x[0]);
}

static void product(void)
{
    double *x = reals();
    COUNT(x[4] = down(x[0] * x[2]), x[5] = up(x[1] * x[3]));
}

static void quotient(void)
{
    double *x = reals();
    COUNT(x[4] = down(divide(x[0], x[3])), x[5] = up(divide(x[1], x[2])));
}

static void amplified(void)
{
    input_t in = input();
    bounds_t gain = bounds();
    buffer_t x = buffer();
    COUNT(measure_amplified(&in, gain, x));
}

static void capacitive(void)
{
    input_t in = input();
    bounds_t factor = bounds();
    buffer_t c = buffer(), i = buffer();
    COUNT(measure_capacitive(&in, factor, c, i));
}

static void touch(void)
{
    input_t in = {.codes = integers()};
    in.n = integer(), in.last = integer(), in.adc = adc();
    bounds_t reaches = bounds(), factor = bounds(), area = bounds(), energy = bounds();
    buffer_t a = buffer(), c = buffer(), e = buffer();
    COUNT(measure_touch(&in, reaches, factor, area, energy, a, c, e));
}

static void inductive(void)
{
    input_t in = input();
    bounds_t reference = bounds(), capacitance = bounds();
    coil_t coil;
    coil.base = bounds(), coil.change = bounds(), coil.damping = bounds();
    buffer_t f = buffer(), l = buffer(), d = buffer();
    COUNT(measure_inductive(&in, reference, capacitance, &coil, f, l, d));
}

static void eddy(void)
{
    const int32_t *codes = integers(), *quadrature = integers();
    input_t in = {.codes = codes, .n = integer()};
    in.last = integer(), in.adc = adc(), in.reach = real();
    bounds_t modulus = bounds(), lag = bounds();
    buffer_t a = buffer(), p = buffer();
    COUNT(measure_eddy(&in, quadrature, modulus, lag, a, p));
}

static void temperature(void)
{
    input_t in = input();
    bounds_t divider = bounds(), tolerance = bounds();
    buffer_t t = buffer();
    COUNT(measure_temperature(&in, divider, tolerance, t));
}

static void humidity(void)
{
    input_t in = input();
    bounds_t factor = bounds(), rest = bounds(), sensitivity = bounds();
    double error = real();
    buffer_t h = buffer();
    COUNT(measure_humidity(&in, factor, rest, sensitivity, error, h));
}

static void permittivity(void)
{
    int n = integer();
    bounds_t stated = bounds();
    buffer_t k = buffer();
    COUNT(measure_permittivity(n, stated, k));
}

static void thermal_change(void)
{
    input_t in = input();
    bounds_t divider = bounds(), tolerance = bounds();
    bounds_t slope = bounds();
    memory_t known = memory();
    buffer_t k = buffer();
    COUNT(measure_thermal_change(&in, divider, tolerance, slope, &known, k));
}

static void humidity_change(void)
{
    input_t in = input();
    bounds_t factor = bounds(), rest = bounds(), sensitivity = bounds();
    double error = real();
    bounds_t slope = bounds();
    memory_t known = memory();
    buffer_t k = buffer();
    COUNT(measure_humidity_change(&in, factor, rest, sensitivity, error, slope, &known, k));
}

static void felt(void)
{
    input_t in = input();
    bounds_t factor = bounds();
    pad_t pad;
    pad.plates = bounds(), pad.rest = bounds(), pad.elasticity = bounds();
    buffer_t c = buffer(), i = buffer(), d = buffer(), p = buffer();
    COUNT(measure_felt(&in, factor, &pad, c, i, d, p));
}

static void unknown(void)
{
    int n = integer();
    double most = real();
    int missing = integer();
    double *total = reals(), *least = reals();
    COUNT(measure_unknown(n, most, missing, total, least));
}

static void neighbour(void)
{
    int n = integer();
    double most = real();
    buffer_t felt = buffer();
    double *total = reals(), *least = reals();
    COUNT(measure_neighbour(n, most, felt.lo, felt.hi, total, least));
}

static void pressure(void)
{
    int n = integer();
    bounds_t area = bounds();
    double most = real(), share = real();
    int doubtful = integer();
    crosstalk_t crosstalk = {share, doubtful, real()};
    buffer_t a = buffer(), p = buffer();
    COUNT(measure_pressure(n, area, most, &crosstalk, a, p));
}

static void rest(void)
{
    double *state = reals(), threshold = real();
    buffer_t x = buffer();
    baseline_t found = {state[0], state[1], state[2] != 0.0};
    int stayed;
    COUNT(stayed = stays(&found, x.lo, x.hi, length(x.lo), threshold));
    state[0] = found.lo, state[1] = found.hi, state[2] = stayed;
}

static void smoothing(void)
{
    double *state = reals();
    buffer_t x = buffer();
    smoothing_t past = {state[0], state[1], state[2], state[3] != 0.0};
    COUNT(smooth(&past, x.lo, x.hi, length(x.lo)));
    state[0] = past.lo, state[1] = past.hi, state[3] = past.fresh;
}

static void peaks(void)
{
    static detector_t detector;
    double prominence = real();
    int longest = integer();
    double *events = reals();
    buffer_t x = buffer();
    begin_detector(&detector, prominence, longest, 0);
    COUNT(feed(&detector, x.lo, x.hi, length(x.lo)));
    end_detector(&detector);
    *events++ = detector.events;
    for (const event_t *e = detector.event; e < detector.event + detector.events; e++) {
        const double told[] = {e->verdict,   e->first,     e->last,          e->peaks,
                               e->height.lo, e->height.hi, e->prominence.lo, e->prominence.hi};
        memcpy(events, told, sizeof told);
        events += sizeof told / sizeof *told;
    }
}

static void encode_frame(void)
{
    int rows = integer(), columns = integer(), finest = integer();
    buffer_t x = buffer();
    uint8_t *codes = bytes();
    double *told = reals();
    encoded_t found;
    COUNT(found = encode_samples(x.lo, x.hi, rows, columns, finest, codes));
    told[0] = found.exponent, told[1] = (double)found.offset, told[2] = found.length;
}

static head_t head(void)
{
    head_t found = {.layout = bytes()};
    const int64_t *numbers = (int64_t *)bytes();
    found.boot = numbers[0], found.sequence = numbers[1];
    found.earliest = numbers[2], found.latest = numbers[3];
    found.coverage = real();
    return found;
}

static void peak(void)
{
    head_t told = head();
    const double *values = reals();
    uint8_t *message = bytes();
    event_t event = {(int)values[0], 0, 0, (int)values[1], {values[2], values[3]},
                     {values[4], values[5]}};
    COUNT(write_peak(message, &told, &event));
}

static void sealing(void)
{
    static key_t key;
    const uint8_t *secret = bytes(), *nonce = bytes(), *aad = bytes();
    uint8_t *text = bytes(), *tag = bytes();
    expand_key(&key, secret);
    COUNT(seal(&key, nonce, aad, length(aad), text, length(text), tag));
}

static void monitor(void)
{
    static monitor_t made;
    const int32_t *lines = integers(), *atoms = integers();
    int drift = integer(), dt = integer();
    const int32_t *codes = integers();
    int32_t *verdicts = integers();
    int many = length(atoms) / 5;
    begin_monitor(&made, lines, length(lines) / 5, atoms, many, drift);
    COUNT(for (int k = 0; k < length(verdicts); k++)
              verdicts[k] = step(&made, (tick_t)k * dt, codes + k * many));
}

static const struct {
    const char *name;
    void (*run)(void);
} CASES[] = {
    {"nothing", nothing},         {"loop", loop},
    {"rounding", rounding},       {"product", product},
    {"quotient", quotient},       {"amplified", amplified},
    {"capacitive", capacitive},   {"touch", touch},
    {"inductive", inductive},     {"eddy", eddy},
    {"temperature", temperature}, {"humidity", humidity},
    {"permittivity", permittivity},
    {"thermal_change", thermal_change},
    {"humidity_change", humidity_change},
    {"felt", felt},
    {"unknown", unknown},         {"neighbour", neighbour},
    {"pressure", pressure},       {"rest", rest},
    {"smoothing", smoothing},     {"peaks", peaks},
    {"encode_frame", encode_frame}, {"peak", peak},
    {"sealing", sealing},         {"monitor", monitor},
};

void run_case(const char *name)
{
    for (unsigned k = 0; k < sizeof CASES / sizeof *CASES; k++)
        if (strcmp(CASES[k].name, name) == 0) {
            CASES[k].run();
            return;
        }
    leave("a case has a name that is not known\n");
}
