"""A particle's map as a dictionary of cells, copied whole for every child."""

import math

import numpy as np


class NaiveMap:
    """Log odds and surfels (hits, x, y, normal x, normal y) by (row, column)."""

    def __init__(self, resolution, rule):
        self.resolution = resolution
        self.rule = rule
        self.odds = {}
        self.surfels = {}

    def cell(self, x, y):
        return math.floor(y / self.resolution), math.floor(x / self.resolution)

    def copy(self):
        twin = NaiveMap(self.resolution, self.rule)
        twin.odds = dict(self.odds)
        twin.surfels = {cell: surfel.copy() for cell, surfel in self.surfels.items()}
        return twin

    def clear(self, start, end, begin):
        (x, y), (u, v) = start, end
        steps = int(max(abs(u - x), abs(v - y)) / self.resolution) + 1
        length = math.hypot(u - x, v - y)
        passed = []
        for s in range(math.ceil(begin / length * steps) if length > 0.0 else steps, steps):
            cell = self.cell(x + s / steps * (u - x), y + s / steps * (v - y))
            if cell != self.cell(u, v) and (not passed or passed[-1] != cell):
                passed.append(cell)
        for cell in passed:
            self.odds[cell] = max(-self.rule.most, self.odds.get(cell, 0.0) - self.rule.free)

    def hit(self, end, normal):
        cell = self.cell(*end)
        self.odds[cell] = min(self.rule.most, self.odds.get(cell, 0.0) + self.rule.occupied)
        if not np.any(normal):
            return
        surfel = self.surfels.setdefault(cell, np.zeros(5))
        surfel[0] = min(surfel[0] + 1.0, self.rule.memory)
        surfel[1:] += (np.concatenate([end, normal]) - surfel[1:]) / surfel[0]
