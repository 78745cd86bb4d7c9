/* Monitors: sensor_node/eskin_sensor_node/firmware/monitor.py. */
#include "monitor.h"

enum { ATOM, NOT, AT_LEAST, FEWER, IMPLIES, HISTORICALLY = 7, ONCE, SINCE = 10, RISE, FALL };
enum { IMPOSSIBLE, POSSIBLE, CERTAIN };
static const tick_t BEGIN = 1 - ((tick_t)1 << 62);
static const tick_t BILLION = 1000000000;

static tick_t least(tick_t a, tick_t b) { return a < b ? a : b; }
static tick_t most(tick_t a, tick_t b) { return a > b ? a : b; }

static void add(runs_t *runs, tick_t first, tick_t last)
{
    tick_t *end = runs->edge + runs->n;
    if (runs->n > 0 && first - 1 <= end[-1]) {
        end[-1] = most(end[-1], last);
    } else if (runs->n + 2 <= MOST_EDGES) {
        end[0] = first, end[1] = last;
        runs->n += 2;
    }
}

static void take(runs_t *runs, tick_t begin, tick_t end, runs_t *found)
{
    int gone = 0;
    while (gone < runs->n && runs->edge[gone + 1] < begin)
        gone += 2;
    if (gone > 0) {
        for (int k = gone; k < runs->n; k++)
            runs->edge[k - gone] = runs->edge[k];
        runs->n -= gone;
    }
    found->n = 0;
    for (int k = 0; k < runs->n && runs->edge[k] <= end; k += 2) {
        found->edge[found->n++] = most(runs->edge[k], begin);
        found->edge[found->n++] = least(runs->edge[k + 1], end);
    }
}

static void complement(const runs_t *runs, tick_t begin, tick_t end, runs_t *found)
{
    found->n = 0;
    for (int k = 0; k < runs->n; k += 2) {
        if (begin < runs->edge[k]) {
            found->edge[found->n++] = begin;
            found->edge[found->n++] = runs->edge[k] - 1;
        }
        begin = runs->edge[k + 1] + 1;
    }
    if (begin <= end) {
        found->edge[found->n++] = begin;
        found->edge[found->n++] = end;
    }
}

/* Each edge is a tick and a change; of one tick, ends come first. */
static void at_least(const runs_t *const *lists, int count, int number, tick_t begin, tick_t end,
                     runs_t *found)
{
    static tick_t ticks[MOST_OPERANDS * MOST_EDGES];
    static int changes[MOST_OPERANDS * MOST_EDGES];
    int n = 0, inside = 0;
    tick_t first = 0;
    found->n = 0;
    if (number <= 0) {
        add(found, begin, end);
        return;
    }
    for (int j = 0; j < count; j++)
        for (int k = 0; k < lists[j]->n; k++) {
            tick_t tick = lists[j]->edge[k] + (k & 1);
            int change = k & 1 ? -1 : 1, at = n++;
            while (at > 0 && (ticks[at - 1] > tick || (ticks[at - 1] == tick && changes[at - 1] > change))) {
                ticks[at] = ticks[at - 1], changes[at] = changes[at - 1];
                at--;
            }
            ticks[at] = tick, changes[at] = change;
        }
    for (int k = 0; k < n; k++) {
        if (inside == number && changes[k] < 0)
            add(found, first, ticks[k] - 1);
        inside += changes[k];
        if (inside == number && changes[k] > 0)
            first = ticks[k];
    }
}

static void two(const runs_t *one, const runs_t *other, int number, tick_t begin, tick_t end,
                runs_t *found)
{
    const runs_t *const lists[] = {one, other};
    at_least(lists, 2, number, begin, end, found);
}

static int holds(const runs_t *runs, tick_t end)
{
    return runs->n > 0 && runs->edge[runs->n - 1] == end;
}

static void just_before(const runs_t *runs, runs_t *found)
{
    found->n = 0;
    for (int k = 0; k < runs->n; k += 2) {
        tick_t first = runs->edge[k] | 1, last = runs->edge[k + 1];
        if ((last & 1) == 0)
            last--;
        if (first <= last)
            add(found, first, last + 1);
    }
}

static void windows(line_t *line, tick_t a, tick_t b, tick_t drift)
{
    line->from[0] = line->from[1] = a, line->to[0] = line->to[1] = b;
    if (drift == 0)
        return;
    tick_t fast = BILLION + drift, slow = BILLION - drift;
    line->from[0] = a == 0 ? 0 : (a * BILLION + slow - 1) / slow + 1;
    line->from[1] = a == 0 ? 0 : most(0, a * BILLION / fast - 1);
    line->to[0] = b * BILLION / fast - 1;
    line->to[1] = (b * BILLION + slow - 1) / slow + 1;
}

void begin_monitor(monitor_t *made, const int32_t *lines, int count, const int32_t *atoms, int many,
                   int drift)
{
    made->lines = count, made->atoms = many, made->begin = BEGIN;
    for (int k = 0; k < count; k++, lines += 5) {
        line_t *line = &made->line[k];
        line->op = lines[0], line->taken = lines[1];
        line->number = lines[0] == ATOM ? lines[2] : lines[4];
        windows(line, lines[2], lines[3], drift);
        line->result[0].n = line->result[1].n = 0;
        line->kept[0] = line->kept[1] = line->was[0] = line->was[1] = 0;
    }
    for (int k = 0; k < many; k++, atoms += 5) {
        tick_t period = atoms[4];
        tick_t lasting = drift == 0 ? period : period * BILLION / (BILLION + drift) - 1;
        made->atom[k] = (atom_t){{atoms[0], atoms[1]}, {atoms[2], atoms[3]}, 2 * period, 2 * lasting - 1,
                                 BEGIN - 1, BEGIN - 1, BEGIN - 1, POSSIBLE, POSSIBLE, 0};
    }
}

static void compare(atom_t *atom, tick_t now, int32_t code)
{
    atom->former = atom->verdict, atom->fresh = 1;
    atom->before = 2 * now == atom->expected ? 2 * now - 1 : atom->until;
    atom->expected = 2 * now + atom->period, atom->until = 2 * now + atom->lasting;
    if (atom->certain[0] <= code && code <= atom->certain[1])
        atom->verdict = CERTAIN;
    else
        atom->verdict = atom->possible[0] <= code && code <= atom->possible[1] ? POSSIBLE : IMPOSSIBLE;
}

static void mark(pair_t *pair, int verdict, tick_t first, tick_t last)
{
    if (first > last)
        return;
    if (verdict == CERTAIN)
        add(&pair->side[0], first, last);
    if (verdict != IMPOSSIBLE)
        add(&pair->side[1], first, last);
}

static void look(const atom_t *atom, tick_t begin, tick_t end, pair_t *pair)
{
    tick_t until = atom->until, last = end;
    int held = atom->verdict;
    pair->side[0].n = pair->side[1].n = 0;
    if (atom->fresh)
        held = atom->former, until = atom->before, last = end - 1;
    until = least(until, last);
    mark(pair, held, begin, until);
    mark(pair, POSSIBLE, most(begin, until + 1), last);
    if (atom->fresh)
        mark(pair, atom->verdict, end, end);
}

static void of_past(line_t *line, const pair_t *part, tick_t begin, tick_t end, pair_t *found)
{
    static runs_t turned, taken;
    int negated = line->op == HISTORICALLY;
    for (int side = 0; side < 2; side++) {
        const runs_t *runs = &part->side[side];
        int window = negated ? 1 - side : side;
        if (negated)
            complement(runs, begin, end, &turned), runs = &turned;
        if (line->from[window] <= line->to[window])
            for (int k = 0; k < runs->n; k += 2)
                add(&line->result[side], runs->edge[k] + 2 * line->from[window],
                    runs->edge[k + 1] + 2 * line->to[window]);
        take(&line->result[side], begin, end, negated ? &taken : &found->side[side]);
        if (negated)
            complement(&taken, begin, end, &found->side[side]);
    }
}

static void of_since(line_t *line, const runs_t *ours, const runs_t *theirs, int side, tick_t begin,
                     tick_t end, runs_t *found)
{
    static runs_t out, taken;
    tick_t a = line->from[side], b = line->to[side];
    runs_t *result = &line->result[side];
    int was = line->was[side];
    int continues = line->kept[side] && ours->n > 0 && ours->edge[0] == begin;
    line->kept[side] = holds(ours, end), line->was[side] = holds(theirs, end);
    out.n = 0;
    if (!continues)
        result->n = 0;
    for (int k = 0; k < ours->n; k += 2) {
        tick_t first = ours->edge[k], last = ours->edge[k + 1];
        tick_t reach = first & 1 ? first - 1 : first;
        if (k > 0)
            result->n = 0;
        if (a > b)
            continue;
        if (reach < begin && was && !continues)
            add(result, reach + 2 * a, reach + 2 * b);
        continues = 0;
        for (int j = 0; j < theirs->n; j += 2) {
            tick_t low = most(theirs->edge[j], reach), high = least(theirs->edge[j + 1], last);
            if (low <= high)
                add(result, low + 2 * a, high + 2 * b);
        }
        take(result, first, last, &taken);
        for (int j = 0; j < taken.n; j += 2)
            add(&out, taken.edge[j], taken.edge[j + 1]);
    }
    if (a > 0 || a > b)
        *found = out;
    else
        two(&out, theirs, 1, begin, end, found);
}

static void combine(line_t *line, const pair_t *parts, tick_t begin, tick_t end, pair_t *found)
{
    static runs_t never, not_surely, before;
    const runs_t *lists[2][MOST_OPERANDS];
    if (line->op == ONCE || line->op == HISTORICALLY) {
        of_past(line, parts, begin, end, found);
        return;
    }
    if (line->op == SINCE) {
        for (int side = 0; side < 2; side++)
            of_since(line, &parts[0].side[side], &parts[1].side[side], side, begin, end,
                     &found->side[side]);
        return;
    }
    if (line->op == AT_LEAST || line->op == FEWER) {
        for (int k = 0; k < line->taken; k++)
            lists[0][k] = &parts[k].side[0], lists[1][k] = &parts[k].side[1];
        at_least(lists[0], line->taken, line->number, begin, end, &never);
        at_least(lists[1], line->taken, line->number, begin, end, &not_surely);
        if (line->op == AT_LEAST) {
            found->side[0] = never, found->side[1] = not_surely;
        } else {
            complement(&not_surely, begin, end, &found->side[0]);
            complement(&never, begin, end, &found->side[1]);
        }
        return;
    }
    complement(&parts->side[1], begin, end, &never);
    complement(&parts->side[0], begin, end, &not_surely);
    if (line->op == NOT) {
        found->side[0] = never, found->side[1] = not_surely;
    } else if (line->op == IMPLIES) {
        two(&never, &parts[1].side[0], 1, begin, end, &found->side[0]);
        two(&not_surely, &parts[1].side[1], 1, begin, end, &found->side[1]);
    } else {
        const runs_t *now[] = {&parts->side[0], &parts->side[1]}, *then[] = {&never, &not_surely};
        for (int side = 0; side < 2; side++) {
            const runs_t *own = line->op == FALL ? then[side] : now[side];
            just_before(line->op == FALL ? now[side] : then[side], &before);
            two(own, &before, 2, begin, end, &found->side[side]);
        }
    }
}

int step(monitor_t *monitor, tick_t now, const int32_t *codes)
{
    static pair_t stack[MOST_LINES], made;
    tick_t begin = monitor->begin, end = 2 * now;
    int height = 0;
    for (int k = 0; k < monitor->atoms; k++)
        if (codes[k] != NEVER_SEEN)
            compare(&monitor->atom[k], now, codes[k]);
    for (int k = 0; k < monitor->lines; k++) {
        line_t *line = &monitor->line[k];
        if (line->op == ATOM) {
            look(&monitor->atom[line->number], begin, end, &stack[height++]);
            continue;
        }
        height -= line->taken;
        combine(line, &stack[height], begin, end, &made);
        for (int side = 0; side < 2; side++) {
            stack[height].side[side].n = made.side[side].n;
            for (int j = 0; j < made.side[side].n; j++)
                stack[height].side[side].edge[j] = made.side[side].edge[j];
        }
        height++;
    }
    for (int k = 0; k < monitor->atoms; k++)
        monitor->atom[k].fresh = 0;
    monitor->begin = end + 1;
    if (holds(&stack->side[0], end))
        return CERTAIN;
    return holds(&stack->side[1], end) ? POSSIBLE : IMPOSSIBLE;
}
