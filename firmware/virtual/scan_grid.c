/* SPDX-License-Identifier: Apache-2.0 */
#include "scan_grid.h"

#include <math.h>

static void count_up(uint16_t *cell)
{
    if (*cell < UINT16_MAX)
        (*cell)++;
}

/* Steps of at most one cell along the beam's longer axis, its end left out. */
static void visit_beam(struct scan_grid *grid, double x0, double y0, double x1, double y1)
{
    const double length = fmax(fabs(x1 - x0), fabs(y1 - y0));
    const int32_t steps = (int32_t)length;
    const double dx = steps > 0 ? (x1 - x0) / length : 0.0, dy = steps > 0 ? (y1 - y0) / length : 0.0;
    for (int32_t i = 0; i < steps; i++) {
        const int32_t column = (int32_t)floor(x0 + i * dx), row = (int32_t)floor(y0 + i * dy);
        if (column >= 0 && column < grid->columns && row >= 0 && row < grid->rows)
            count_up(&grid->visits[row * grid->columns + column]);
    }
}

void scan_grid_add(struct scan_grid *grid, const double pose[3], const double *ranges, const double *bearings,
                   int32_t count, double max_range)
{
    const double x0 = (pose[0] - grid->x) / grid->resolution, y0 = (pose[1] - grid->y) / grid->resolution;
    for (int32_t i = 0; i < count; i++) {
        if (!(ranges[i] > 0.0 && ranges[i] < max_range))
            continue;
        const double range = ranges[i] / grid->resolution, angle = pose[2] + bearings[i];
        const double x1 = x0 + range * cos(angle), y1 = y0 + range * sin(angle);
        visit_beam(grid, x0, y0, x1, y1);
        const int32_t column = (int32_t)floor(x1), row = (int32_t)floor(y1);
        if (column < 0 || column >= grid->columns || row < 0 || row >= grid->rows)
            continue;
        count_up(&grid->visits[row * grid->columns + column]);
        count_up(&grid->hits[row * grid->columns + column]);
    }
}
