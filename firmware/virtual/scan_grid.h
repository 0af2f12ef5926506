/* SPDX-License-Identifier: Apache-2.0
 *
 * Counting, per cell of a grid, how many laser beams ended in it and how many went through.
 */
#ifndef CRUNCH_VIRTUAL_SCAN_GRID_H
#define CRUNCH_VIRTUAL_SCAN_GRID_H

#include <stdint.h>

struct scan_grid {
    double x, y, resolution; /* corner of cell (0, 0); m per cell */
    int32_t columns, rows;
    uint16_t *hits;          /* (rows, columns) */
    uint16_t *visits;        /* beams that ended in the cell or went through it */
};

/* Adds one scan: ranges[i] at bearings[i] from a pose; ranges that are not in (0, max_range) are skipped. */
void scan_grid_add(struct scan_grid *grid, const double pose[3], const double *ranges, const double *bearings,
                   int32_t count, double max_range);

#endif
