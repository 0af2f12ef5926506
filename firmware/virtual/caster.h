/* SPDX-License-Identifier: Apache-2.0
 *
 * Walls as segments on the floor, kept in the square bins of a uniform grid: rays and nearest points look only into the
 * bins that they touch. Lengths in m.
 */
#ifndef CRUNCH_VIRTUAL_CASTER_H
#define CRUNCH_VIRTUAL_CASTER_H

#include <stdint.h>

struct segment {
    double x1, y1, x2, y2;
};

struct caster {
    const struct segment *segments; /* owned by the caster, like the two arrays below */
    int32_t count;
    double x, y, bin; /* corner of bin (0, 0) and a bin's side */
    int32_t columns, rows;
    int32_t *starts;  /* (columns * rows + 1) where each bin's list begins in `members` */
    int32_t *members; /* segments that touch a bin */
};

struct hit {
    double range;  /* INFINITY: nothing within reach */
    double cosine; /* of the angle between ray and wall normal, 0 to 1 */
    int32_t segment; /* -1: none */
};

/* Copies the segments; NULL when memory is out. A bin is about 0.25 m, larger in worlds of more than 4 million bins. */
struct caster *caster_new(const struct segment *segments, int32_t count);
void caster_free(struct caster *caster);

/* First wall along the direction (cos, sin) of a unit vector. */
struct hit caster_ray(const struct caster *caster, double x, double y, double dx, double dy, double reach);

/* Many rays: (x, y, bearing) each; writes ranges. For tests and for pictures. */
void caster_rays(const struct caster *caster, const double *rays, int32_t count, double reach, double *ranges);

/* Nearest point of any wall within `reach`: its distance, or INFINITY; the point in *px, *py. */
double caster_nearest(const struct caster *caster, double x, double y, double reach, double *px, double *py);

/* Nearest distances of many points (x, y). */
void caster_clearances(const struct caster *caster, const double *points, int32_t count, double reach, double *out);

#endif
