/* What a channel does with its samples: rest, smoothing, peaks, encoding, messages. */
#ifndef CHANNEL_H
#define CHANNEL_H

#include "rounding.h"

typedef struct {
    double lo, hi;
    int known;
} baseline_t;

int calibrate(baseline_t *rest, const double *lows, const double *highs, int n);
int stays(baseline_t *rest, const double *lows, const double *highs, int n, double threshold);

typedef struct {
    double lo, hi, weight;
    int fresh;
} smoothing_t;

void smooth(smoothing_t *past, double *lows, double *highs, int n);

enum { MOST_REGIONS = 8, MOST_EVENTS = 64 };

typedef struct {
    int first, last, peaks;
    double lowest, floor, ceiling, prominence;
} span_t;

typedef struct {
    double prominence, valley, crest;
    int rising, begun;
    span_t span;
} hysteresis_t;

enum { IMPOSSIBLE, POSSIBLE, CERTAIN };

typedef struct {
    int verdict, first, last, peaks;
    bounds_t height, prominence;
} event_t;

typedef struct {
    int longest, index, waiting;
    hysteresis_t certain, optimistic;
    span_t undecided[MOST_REGIONS + 1];
    int events;
    event_t event[MOST_EVENTS];
} detector_t;

void begin_detector(detector_t *detector, double prominence, int longest, int first);
void feed(detector_t *detector, const double *lows, const double *highs, int n);
void end_detector(detector_t *detector);

typedef struct {
    int exponent, length;
    int64_t offset;
} encoded_t;

/* Writes samples of a patch in which each row has all columns; gives their scale and their bytes. */
encoded_t encode_samples(const double *lows, const double *highs, int rows, int columns, int finest,
                         uint8_t *out);

#endif
