/* Peaks of a tube, certain and possible: sensor_node/eskin_sensor_node/firmware/peaks.py. */
#include "channel.h"

static int is_no_number(double x) { return bits_of(x) << 1 > bits_of(INFINITY) << 1; }

static span_t span_of(int index, double lo, double hi)
{
    return (span_t){index, index, 0, lo, lo, hi, 0.0};
}

static void extend(span_t *span, int index, double lo, double hi)
{
    span->last = index;
    if (less(lo, span->lowest))
        span->lowest = lo;
    else if (less(span->floor, lo))
        span->floor = lo;
    span->ceiling = most_of(span->ceiling, hi);
}

static void merge(span_t *span, const span_t *later)
{
    span->last = later->last;
    span->lowest = least_of(span->lowest, later->lowest);
    span->floor = most_of(span->floor, later->floor);
    span->ceiling = most_of(span->ceiling, later->ceiling);
    span->peaks += later->peaks;
}

static int reaches(double high, double low, double prominence)
{
    double difference = high - low;
    if (difference != prominence)
        return difference > prominence;
    double back = difference - high;
    return (high - (difference - back)) - (low + back) >= 0.0;
}

static void begin(hysteresis_t *pass, int index, double valley, double lo, double hi)
{
    pass->valley = valley, pass->rising = 0, pass->begun = 1;
    pass->span = span_of(index, lo, hi);
}

static void forget(hysteresis_t *pass)
{
    pass->valley = INFINITY, pass->crest = -INFINITY, pass->rising = pass->begun = 0;
}

/* Takes the next sample; gives whether it completes a peak, and then its stretch. */
static int take(hysteresis_t *pass, int index, double valley, double crest, double lo, double hi,
                span_t *found)
{
    if (!pass->begun) {
        begin(pass, index, valley, lo, hi);
        return 0;
    }
    extend(&pass->span, index, lo, hi);
    if (pass->rising) {
        if (reaches(pass->crest, valley, pass->prominence)) {
            pass->span.peaks = 1;
            pass->span.prominence = down(pass->crest - most_of(pass->valley, valley));
            *found = pass->span;
            begin(pass, index, valley, lo, hi);
            return 1;
        }
        pass->crest = most_of(pass->crest, crest);
    } else if (reaches(crest, pass->valley, pass->prominence)) {
        pass->rising = 1, pass->crest = crest;
    } else if (!less(pass->valley, valley)) {
        begin(pass, index, valley, lo, hi);
    }
    return 0;
}

static void tell(detector_t *detector, int verdict, const span_t *span)
{
    detector->event[detector->events++] =
        (event_t){verdict, span->first, span->last, span->peaks, {span->floor, span->ceiling},
                  {span->prominence, up(span->ceiling - span->lowest)}};
}

static void drop(detector_t *detector, int place)
{
    detector->waiting -= 1;
    memmove(detector->undecided + place, detector->undecided + place + 1,
            (detector->waiting - place) * sizeof(span_t));
}

static void remember(detector_t *detector, span_t *span)
{
    span->prominence = 0.0;
    span_t *waiting = detector->undecided, *newest = waiting + detector->waiting - 1;
    if (detector->waiting && span->first <= newest->last) {
        merge(newest, span);
        return;
    }
    waiting[detector->waiting++] = *span;
    if (detector->waiting > MOST_REGIONS) {
        merge(waiting, waiting + 1);
        drop(detector, 1);
    }
}

static void match(detector_t *detector, const span_t *certain)
{
    int best = -1;
    for (int k = 0; k < detector->waiting; k++) {
        const span_t *span = detector->undecided + k;
        if (span->last > certain->first &&
            (best < 0 || span->ceiling > detector->undecided[best].ceiling))
            best = k;
    }
    if (best >= 0 && --detector->undecided[best].peaks == 0)
        drop(detector, best);
}

static void tell_waiting(detector_t *detector)
{
    for (int k = 0; k < detector->waiting; k++)
        tell(detector, POSSIBLE, detector->undecided + k);
    detector->waiting = 0;
}

static void settle(detector_t *detector)
{
    const span_t *oldest = detector->undecided;
    if (detector->index - oldest->first >= detector->longest) {
        tell_waiting(detector);
        return;
    }
    const hysteresis_t *certain = &detector->certain, *growing = &detector->optimistic;
    while (detector->waiting) {
        if (!certain->begun || oldest->last > certain->span.first)
            return;
        if (!growing->begun || oldest->last >= growing->span.first)
            return;
        tell(detector, POSSIBLE, oldest);
        drop(detector, 0);
    }
}

void begin_detector(detector_t *detector, double prominence, int longest, int first)
{
    detector->longest = longest, detector->index = first;
    detector->waiting = detector->events = 0;
    detector->certain.prominence = detector->optimistic.prominence = prominence;
    forget(&detector->certain);
    forget(&detector->optimistic);
}

void end_detector(detector_t *detector)
{
    tell_waiting(detector);
    forget(&detector->certain);
    forget(&detector->optimistic);
}

void feed(detector_t *detector, const double *lows, const double *highs, int n)
{
    for (int k = 0; k < n; k++, detector->index++) {
        double lo = lows[k], hi = highs[k];
        if (is_no_number(lo) || is_no_number(hi)) {
            end_detector(detector);
            continue;
        }
        span_t possible, certain;
        if (take(&detector->optimistic, detector->index, lo, hi, lo, hi, &possible))
            remember(detector, &possible);
        int found = take(&detector->certain, detector->index, hi, lo, lo, hi, &certain);
        if (found)
            match(detector, &certain);
        if (detector->waiting)
            settle(detector);
        if (found)
            tell(detector, CERTAIN, &certain);
    }
}
