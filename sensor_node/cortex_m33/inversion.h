/* From ADC codes back to quantities: sensor_node/eskin_sensor_node/firmware/inversion, function by function. */
#ifndef INVERSION_H
#define INVERSION_H

#include "rounding.h"

typedef struct {
    double step_lo, step_hi, offset_lo, offset_hi, nonlinearity;
} adc_t;

typedef struct {
    bounds_t base, change, damping;
} coil_t;

typedef struct {
    bounds_t plates, rest, elasticity;
} pad_t;

typedef struct {
    double share;
    int doubtful;
    double most_handed;
} crosstalk_t;

/* What every inversion is given of its input. */
typedef struct {
    const int32_t *codes;
    int n, last;
    adc_t adc;
    double reach;
} input_t;

/* What remembers a sensor's codes: as many slots as there is room for. */
typedef struct {
    int slots;
    int32_t *known;
    double *lows, *highs;
} memory_t;

/* Lower and upper bounds of a quantity, sample by sample. */
typedef struct {
    double *lo, *hi;
} buffer_t;

bounds_t code_bounds(int code, int last, const adc_t *adc, double reach);
bounds_t scaled(bounds_t x, bounds_t factor);
bounds_t capacitance_bounds(bounds_t current, bounds_t factor);
bounds_t logarithm(double x);
bounds_t arctangent(double x);
bounds_t temperature_bounds(int code, int last, const adc_t *adc, double reach, bounds_t divider,
                            bounds_t tolerance);
bounds_t moisture_bounds(int code, int last, const adc_t *adc, double reach, bounds_t factor,
                         bounds_t rest, bounds_t sensitivity, double error);

void measure_amplified(const input_t *in, bounds_t gain, buffer_t x);
void measure_capacitive(const input_t *in, bounds_t factor, buffer_t c, buffer_t i);
void measure_touch(const input_t *in, bounds_t reaches, bounds_t factor, bounds_t area_factor,
                   bounds_t energy_factor, buffer_t a, buffer_t c, buffer_t e);
void measure_inductive(const input_t *in, bounds_t reference, bounds_t capacitance,
                       const coil_t *coil, buffer_t f, buffer_t l, buffer_t d);
void measure_eddy(const input_t *in, const int32_t *quadrature, bounds_t modulus, bounds_t lag,
                  buffer_t a, buffer_t p);
void measure_temperature(const input_t *in, bounds_t divider, bounds_t tolerance, buffer_t t);
void measure_humidity(const input_t *in, bounds_t factor, bounds_t rest, bounds_t sensitivity,
                      double error, buffer_t h);
void measure_permittivity(int n, bounds_t stated, buffer_t k);
int measure_thermal_change(const input_t *in, bounds_t divider, bounds_t tolerance, bounds_t slope,
                 const memory_t *memory, buffer_t k);
int measure_humidity_change(const input_t *in, bounds_t factor, bounds_t rest, bounds_t sensitivity,
                  double error, bounds_t slope, const memory_t *memory, buffer_t k);
void measure_felt(const input_t *in, bounds_t factor, const pad_t *pad, buffer_t c, buffer_t i,
                  buffer_t d, buffer_t p);
void measure_unknown(int n, double most, int missing, double *total, double *least);
void measure_neighbour(int n, double most, const double *felt_lo, const double *felt_hi,
                       double *total, double *least);
void measure_pressure(int n, bounds_t area, double most, const crosstalk_t *crosstalk, buffer_t a,
                      buffer_t p);

#endif
