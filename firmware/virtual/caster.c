/* SPDX-License-Identifier: Apache-2.0 */
#include "caster.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#define BIN 0.25
#define MAX_BINS 4000000.0
#define MARGIN 1e-6 /* m: walls on a bin's border belong to both sides */

static int32_t clamp_index(double value, int32_t count)
{
    if (value < 0.0)
        return 0;
    return value >= (double)count ? count - 1 : (int32_t)value;
}

static int32_t column_of(const struct caster *caster, double x)
{
    return clamp_index((x - caster->x) / caster->bin, caster->columns);
}

static int32_t row_of(const struct caster *caster, double y)
{
    return clamp_index((y - caster->y) / caster->bin, caster->rows);
}

/* Visits, row by row, the bins that a segment touches: counts them in `starts`, or with `members` files the segment. */
static void file_segment(struct caster *caster, int32_t index, int32_t *cursor)
{
    struct segment s = caster->segments[index];
    if (s.y1 > s.y2) {
        const struct segment turned = {s.x2, s.y2, s.x1, s.y1};
        s = turned;
    }
    const double slope = s.y2 > s.y1 ? (s.x2 - s.x1) / (s.y2 - s.y1) : 0.0;
    const int32_t last = row_of(caster, s.y2 + MARGIN);
    for (int32_t row = row_of(caster, s.y1 - MARGIN); row <= last; row++) {
        double xa = s.x1, xb = s.x2;
        if (s.y2 > s.y1) { /* the part of it within this row */
            const double low = fmax(s.y1, caster->y + row * caster->bin - MARGIN);
            const double high = fmin(s.y2, caster->y + (row + 1) * caster->bin + MARGIN);
            xa = s.x1 + slope * (low - s.y1);
            xb = s.x1 + slope * (high - s.y1);
        }
        const int32_t end = column_of(caster, fmax(xa, xb) + MARGIN);
        for (int32_t column = column_of(caster, fmin(xa, xb) - MARGIN); column <= end; column++) {
            const int32_t bin = row * caster->columns + column;
            if (caster->members)
                caster->members[cursor[bin]] = index;
            cursor[bin]++;
        }
    }
}

static void lay_out(struct caster *caster)
{
    double x = 0.0, y = 0.0, right = 1.0, top = 1.0;
    for (int32_t i = 0; i < caster->count; i++) {
        const struct segment *s = &caster->segments[i];
        x = i ? fmin(x, fmin(s->x1, s->x2)) : fmin(s->x1, s->x2);
        y = i ? fmin(y, fmin(s->y1, s->y2)) : fmin(s->y1, s->y2);
        right = i ? fmax(right, fmax(s->x1, s->x2)) : fmax(s->x1, s->x2);
        top = i ? fmax(top, fmax(s->y1, s->y2)) : fmax(s->y1, s->y2);
    }
    caster->x = x - BIN;
    caster->y = y - BIN;
    const double area = (right - caster->x + BIN) * (top - caster->y + BIN);
    caster->bin = fmax(BIN, sqrt(area / MAX_BINS));
    caster->columns = (int32_t)ceil((right - caster->x + BIN) / caster->bin);
    caster->rows = (int32_t)ceil((top - caster->y + BIN) / caster->bin);
}

static bool fill_bins(struct caster *caster)
{
    const size_t bins = (size_t)caster->columns * (size_t)caster->rows;
    int32_t *cursor = calloc(bins + 1, sizeof *cursor);
    caster->starts = calloc(bins + 1, sizeof *caster->starts);
    if (!cursor || !caster->starts) {
        free(cursor);
        return false;
    }
    for (int32_t i = 0; i < caster->count; i++)
        file_segment(caster, i, cursor);
    for (size_t bin = 0; bin < bins; bin++)
        caster->starts[bin + 1] = caster->starts[bin] + cursor[bin];
    memcpy(cursor, caster->starts, (bins + 1) * sizeof *cursor);
    caster->members = malloc(((size_t)caster->starts[bins] + 1) * sizeof *caster->members);
    for (int32_t i = 0; caster->members && i < caster->count; i++)
        file_segment(caster, i, cursor);
    free(cursor);
    return caster->members != NULL;
}

struct caster *caster_new(const struct segment *segments, int32_t count)
{
    struct caster *caster = calloc(1, sizeof *caster);
    struct segment *own = malloc(((size_t)count + 1) * sizeof *own);
    if (!caster || !own) {
        free(caster);
        free(own);
        return NULL;
    }
    if (count > 0)
        memcpy(own, segments, (size_t)count * sizeof *own);
    caster->segments = own;
    caster->count = count;
    lay_out(caster);
    if (fill_bins(caster))
        return caster;
    caster_free(caster);
    return NULL;
}

void caster_free(struct caster *caster)
{
    if (!caster)
        return;
    free((void *)(uintptr_t)caster->segments);
    free(caster->starts);
    free(caster->members);
    free(caster);
}

/* Cuts the part (from, to) of the ray that lies within one pair of parallel borders. */
static void clip(double origin, double direction, double low, double high, double *from, double *to)
{
    if (direction == 0.0) {
        if (origin < low || origin > high)
            *to = -1.0;
        return;
    }
    const double a = (low - origin) / direction, b = (high - origin) / direction;
    *from = fmax(*from, fmin(a, b));
    *to = fmin(*to, fmax(a, b));
}

static void test_bin(const struct caster *caster, int32_t bin, double x, double y, double dx, double dy,
                     struct hit *best)
{
    for (int32_t k = caster->starts[bin]; k < caster->starts[bin + 1]; k++) {
        const struct segment *s = &caster->segments[caster->members[k]];
        const double ex = s->x2 - s->x1, ey = s->y2 - s->y1;
        const double ax = s->x1 - x, ay = s->y1 - y;
        const double across = dx * ey - dy * ex;
        if (across == 0.0)
            continue;
        const double range = (ax * ey - ay * ex) / across;
        const double along = (ax * dy - ay * dx) / across;
        if (range < 0.0 || range >= best->range || along < 0.0 || along > 1.0)
            continue;
        best->range = range;
        best->cosine = across; /* finished once for the winner */
        best->segment = caster->members[k];
    }
}

struct hit caster_ray(const struct caster *caster, double x, double y, double dx, double dy, double reach)
{
    struct hit best = {reach, 0.0, -1};
    double from = 0.0, to = reach;
    clip(x, dx, caster->x, caster->x + caster->columns * caster->bin, &from, &to);
    clip(y, dy, caster->y, caster->y + caster->rows * caster->bin, &from, &to);
    if (from <= to) { /* walk from bin to bin (Amanatides & Woo 1987) */
        int32_t column = column_of(caster, x + from * dx), row = row_of(caster, y + from * dy);
        const int32_t step_x = dx > 0.0 ? 1 : -1, step_y = dy > 0.0 ? 1 : -1;
        const double per_x = dx != 0.0 ? caster->bin / fabs(dx) : INFINITY;
        const double per_y = dy != 0.0 ? caster->bin / fabs(dy) : INFINITY;
        double next_x = dx != 0.0 ? (caster->x + (column + (dx > 0.0)) * caster->bin - x) / dx : INFINITY;
        double next_y = dy != 0.0 ? (caster->y + (row + (dy > 0.0)) * caster->bin - y) / dy : INFINITY;
        for (;;) {
            test_bin(caster, row * caster->columns + column, x, y, dx, dy, &best);
            const double leave = fmin(next_x, next_y);
            if (leave > to || leave > best.range)
                break;
            if (next_x < next_y) {
                column += step_x;
                next_x += per_x;
            } else {
                row += step_y;
                next_y += per_y;
            }
            if (column < 0 || column >= caster->columns || row < 0 || row >= caster->rows)
                break;
        }
    }
    if (best.segment < 0) {
        best.range = INFINITY;
        return best;
    }
    const struct segment *s = &caster->segments[best.segment];
    best.cosine = fabs(best.cosine) / hypot(s->x2 - s->x1, s->y2 - s->y1);
    return best;
}

void caster_rays(const struct caster *caster, const double *rays, int32_t count, double reach, double *ranges)
{
    for (int32_t i = 0; i < count; i++) {
        const double *ray = rays + 3 * (size_t)i;
        ranges[i] = caster_ray(caster, ray[0], ray[1], cos(ray[2]), sin(ray[2]), reach).range;
    }
}

static double squared_distance(const struct segment *s, double x, double y, double *px, double *py)
{
    const double ex = s->x2 - s->x1, ey = s->y2 - s->y1;
    const double length = ex * ex + ey * ey;
    double along = length > 0.0 ? ((x - s->x1) * ex + (y - s->y1) * ey) / length : 0.0;
    along = fmax(0.0, fmin(1.0, along));
    *px = s->x1 + along * ex;
    *py = s->y1 + along * ey;
    return (x - *px) * (x - *px) + (y - *py) * (y - *py);
}

double caster_nearest(const struct caster *caster, double x, double y, double reach, double *px, double *py)
{
    double best = reach * reach;
    bool is_found = false;
    const int32_t left = column_of(caster, x - reach), right = column_of(caster, x + reach);
    const int32_t top = row_of(caster, y + reach);
    for (int32_t row = row_of(caster, y - reach); row <= top; row++)
        for (int32_t column = left; column <= right; column++) {
            const int32_t bin = row * caster->columns + column;
            for (int32_t k = caster->starts[bin]; k < caster->starts[bin + 1]; k++) {
                double nx, ny;
                const double d = squared_distance(&caster->segments[caster->members[k]], x, y, &nx, &ny);
                if (d >= best)
                    continue;
                best = d;
                *px = nx;
                *py = ny;
                is_found = true;
            }
        }
    return is_found ? sqrt(best) : INFINITY;
}

void caster_clearances(const struct caster *caster, const double *points, int32_t count, double reach, double *out)
{
    double px, py;
    for (int32_t i = 0; i < count; i++)
        out[i] = caster_nearest(caster, points[2 * (size_t)i], points[2 * (size_t)i + 1], reach, &px, &py);
}
