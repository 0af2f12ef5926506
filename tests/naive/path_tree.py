"""Paths kept in full, one tuple of names per particle; the tree is the set of their prefixes."""

from __future__ import annotations


class Paths:
    """All particles' paths; every vertex is named by (depth, particle that made it)."""

    def __init__(self, n_particles, root):
        self.paths = [((0, 0),)] * n_particles
        self.poses = {(0, 0): tuple(root)}

    def extend(self, poses):
        """A vertex for every particle."""
        depth = len(self.paths[0])
        self.paths = [(*path, (depth, particle)) for particle, path in enumerate(self.paths)]
        self.poses |= {(depth, particle): tuple(pose) for particle, pose in enumerate(poses)}

    def resample(self, ancestors):
        """Copies of the chosen paths."""
        self.paths = [self.paths[ancestor] for ancestor in ancestors]

    def path(self, particle):
        """Poses from the root to the leaf."""
        return [self.poses[name] for name in self.paths[particle]]

    def prefixes(self, depth):
        """Different paths up to a depth."""
        return {path[: depth + 1] for path in self.paths}

    def levels(self):
        """Number of different prefixes at each depth."""
        return [len(self.prefixes(depth)) for depth in range(len(self.paths[0]))]

    def fixed_depth(self):
        """The deepest depth with one prefix."""
        return max(depth for depth, count in enumerate(self.levels()) if count == 1)

    def box(self, depth):
        """min x, min y, max x, max y of the places at a depth."""
        places = [self.poses[prefix[-1]] for prefix in self.prefixes(depth)]
        bounds = [(min(axis), max(axis)) for axis in zip(*places, strict=True)]
        return [bounds[0][0], bounds[1][0], bounds[0][1], bounds[1][1]]
