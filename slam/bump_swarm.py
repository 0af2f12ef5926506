"""Kernels of the map from bumps: particles that each carry a pose, biases of the odometry, and the walls they felt.

A wall is a line, felt from inside: its direction and place are a Gaussian (Rao-Blackwellized as in FastSLAM). A bump
tells one number of it: the point of the bumper that is farthest out lies on the line. With the bumper's half width w,
its distance a ahead of the axle at p, heading psi and the wall's outward direction phi that number is
n(phi) . p + a cos(psi - phi) + w |sin(psi - phi)|, the support of the bumper.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from slam.cart_odometry import TURN, turn_variance, way_variance
from slam.counter_random import gaussian_of, nth_output, vertex_key

# columns of a line: anchor, outward direction and how far beyond the anchor, their covariance, felt from where to where
X, Y, PHI, BEYOND, VAR_PHI, COVARIANCE, VAR_BEYOND, LOW, HIGH, HITS = range(10)
COLUMNS = 10
PIECES = 2  # straight pieces that stand for the arc of a drive
STEEPEST = math.cos(math.radians(80.0))  # of the angle at which a bumper meets a wall
NEW, STRAY = -1, -2  # what a bump may be told of besides a known line


class Swarm(NamedTuple):
    """State of n particles.

    `poses` (n, 3); `biases` (n, 2): how much shorter the wheelbase is as a share, and rad turned per m driven beyond
    the veer; `lines` (n, k, 10) of which `n_lines` (n,) are; `pieces` (n, 2 t, 4) float32, x1 y1 x2 y2 of the bumper's
    middle on t drives; `begun` and `bumped` (n, t, 3) float32, the poses at their starts and ends; `felt` (n, t) int8,
    the line that each bump was told of; `log_weights` (n,) since the last resampling and `scores` (n,) since the start.
    """

    poses: np.ndarray
    biases: np.ndarray
    lines: np.ndarray
    n_lines: np.ndarray
    pieces: np.ndarray
    begun: np.ndarray
    bumped: np.ndarray
    felt: np.ndarray
    log_weights: np.ndarray
    scores: np.ndarray


class Model(NamedTuple):
    """Numbers that the kernels go by; lengths in m, angles in rad, rates per m."""

    wheelbase: float
    tick: float
    veer: float  # rad/m that the cart turns when its counters say straight on, as far as that is known
    half_width: float
    ahead: float
    distance_noise: float
    turn_noise: float
    rotation_noise: float
    slip_length: float
    slip_share: float
    slip_distance: float
    slip_turn: float
    drag_share: float  # of bumps that the bumper does not feel at once, so that the cart pushes on
    drag_tried: float  # and of those that are drawn so, whose weights make up for it
    drag_distance: float  # by so much, in the mean,
    drag_turn: float  # and turns by so much, until it stands square to the wall or nearly so
    contact: float  # standard deviation of where a felt wall is
    direction: float  # standard deviation of a new wall's direction about the heading
    new_walls: float  # of a way through the unknown, per m
    strays: float  # bumps that nothing explains, per m
    reach: float  # by which a wall may go on beyond where it was felt
    missed: float  # probability that a drive passes where a wall was felt
    again: float  # probability of a bump where a drive passed before
    stuck_share: float  # of turns that a wall hinders
    stuck_tried: float  # and of those that are drawn so, whose weights make up for it
    settled: float  # bumps after which a new wall is half as likely as at first
    flat: float  # angle to the wall below which a bump may turn the cart square to it
    flat_share: float  # of such bumps that do
    tries: int  # of the odometry's errors that each particle draws, of which it keeps one


@njit(cache=True)
def uniform_of(key, particle, stream):
    """Uniform number in [0, 1) from a vertex's key."""
    return np.float64(nth_output(nth_output(key, particle), stream) >> np.uint64(11)) * 2.0**-53


@njit(cache=True, inline="always")
def support(delta, model):
    """How far the bumper reaches from the axle towards a wall that the heading is off by `delta`; its derivative."""
    cos, sin = math.cos(delta), math.sin(delta)
    side = 1.0 if sin >= 0.0 else -1.0
    return model.ahead * cos + model.half_width * abs(sin), -model.ahead * sin + side * model.half_width * cos


@njit(cache=True)
def moved(pose, biases, stage, at_wall, key, particle, stream, model, out):
    """Fill `out` (3,) with a pose after a `stage` (3,) of kind and ticks, drawn from the odometry's errors.

    Returns the log of how much more likely it is than it was drawn, and whether the cart was dragged along a wall.
    """
    log_weight, is_dragged, slid, pivoted = 0.0, False, 0.0, 0.0
    left, right = model.tick * stage[1], model.tick * stage[2]
    way = 0.5 * (left + right)
    turn = (right - left) / model.wheelbase * (1.0 + biases[0])
    blur = 0.4 * model.tick  # of counts of whole ticks
    swing = turn_variance(way, turn, model) + 2.0 * (blur / model.wheelbase) ** 2
    spread = way_variance(way, model) + blur * blur
    if at_wall:
        how = uniform_of(key, particle, stream + 2)
        beyond = -math.log(1.0 - uniform_of(key, particle, stream + 3))
        if how < model.drag_tried:
            is_dragged = True
            log_weight = math.log(model.drag_share / model.drag_tried)
            beyond = min(model.drag_distance * beyond, 0.95 * way)
            way -= beyond
            pivoted = model.drag_turn * gaussian_of(key, particle, 1)
            slid = beyond * uniform_of(key, particle, 2)
        else:
            log_weight = math.log((1.0 - model.drag_share) / (1.0 - model.drag_tried))
            if how < model.drag_tried + (1.0 - model.drag_tried) * model.slip_share:  # the wheels went on at the wall
                swing += model.slip_turn**2
                way -= model.slip_distance * beyond
    if stage[0] == TURN:
        if uniform_of(key, particle, stream + 2) < model.stuck_tried:
            turn *= uniform_of(key, particle, stream + 3)
            spread += model.slip_distance**2
            log_weight = math.log(model.stuck_share / model.stuck_tried)
        else:
            log_weight = math.log((1.0 - model.stuck_share) / (1.0 - model.stuck_tried))
    turn += (model.veer + biases[1]) * way + math.sqrt(swing) * gaussian_of(key, particle, stream)
    way += math.sqrt(spread) * gaussian_of(key, particle, stream + 1)
    chord = way * (math.sin(0.5 * turn) / (0.5 * turn) if abs(turn) > 1e-9 else 1.0)
    out[0] = pose[0] + chord * math.cos(pose[2] + 0.5 * turn)
    out[1] = pose[1] + chord * math.sin(pose[2] + 0.5 * turn)
    out[2] = pose[2] + turn + pivoted
    if is_dragged:  # along the wall, which is across the way that it faces now
        side = -1.0 if pivoted >= 0.0 else 1.0
        out[0] -= side * slid * math.sin(out[2])
        out[1] += side * slid * math.cos(out[2])
    return log_weight, is_dragged


@njit(cache=True)
def extrapolated(line, t, model):
    """Log of the chance that a wall felt between two places goes on to place `t` along it."""
    gap = max(line[LOW] - t, t - line[HIGH], 0.0)
    return -gap / model.reach


@njit(cache=True)
def innovation(line, pose, model):
    """How far the bumper is beyond a line, its derivative by the line's direction, its variance, and where along it."""
    dx, dy = pose[0] - line[X], pose[1] - line[Y]
    cos, sin = math.cos(line[PHI]), math.sin(line[PHI])
    reach, slope = support(pose[2] - line[PHI], model)
    along = -sin * dx + cos * dy
    by_phi = along - slope
    off = cos * dx + sin * dy + reach - line[BEYOND]
    variance = by_phi * by_phi * line[VAR_PHI] - 2.0 * by_phi * line[COVARIANCE] + line[VAR_BEYOND]
    delta = pose[2] - line[PHI]
    side = 1.0 if math.sin(delta) >= 0.0 else -1.0
    # the end of the bumper that touches, along the wall
    place = along + model.ahead * math.sin(delta) - side * model.half_width * math.cos(delta)
    return off, by_phi, variance + model.contact**2, place


@njit(cache=True)
def learn(line, pose, model):
    """A bump at a pose corrects a line: an iterated extended Kalman filter's step."""
    phi, beyond = line[PHI], line[BEYOND]
    a, b, c = line[VAR_PHI], line[COVARIANCE], line[VAR_BEYOND]
    gain_phi, gain_beyond, by_phi = 0.0, 0.0, 0.0
    for _ in range(3 if a > 0.01 else 1):
        off, by_phi, _, _ = innovation(line, pose, model)
        off += by_phi * (phi - line[PHI]) - (beyond - line[BEYOND])
        variance = by_phi * by_phi * a - 2.0 * by_phi * b + c + model.contact**2
        gain_phi = (a * by_phi - b) / variance
        gain_beyond = (b * by_phi - c) / variance
        line[PHI] = phi - gain_phi * off
        line[BEYOND] = beyond - gain_beyond * off
    line[VAR_PHI] = a - gain_phi * (by_phi * a - b)
    line[COVARIANCE] = b - gain_phi * (by_phi * b - c)
    line[VAR_BEYOND] = c - gain_beyond * (by_phi * b - c)
    _, _, _, place = innovation(line, pose, model)
    line[LOW] = min(line[LOW], place)
    line[HIGH] = max(line[HIGH], place)
    line[HITS] += 1.0


@njit(cache=True)
def begin_line(line, pose, model):
    """A wall that nothing but one bump is known of: somewhere at the bumper, more or less across the heading."""
    line[X] = pose[0] + model.ahead * math.cos(pose[2])
    line[Y] = pose[1] + model.ahead * math.sin(pose[2])
    line[PHI] = pose[2]
    line[BEYOND] = 0.3 * model.half_width
    line[VAR_PHI] = model.direction**2
    line[COVARIANCE] = 0.0
    line[VAR_BEYOND] = model.contact**2 + (0.4 * model.half_width) ** 2
    line[LOW] = line[HIGH] = 0.0
    line[HITS] = 1.0


@njit(cache=True)
def passed(line, piece):
    """Whether a drive's piece (4,) leads outward through a line where it was felt."""
    cos, sin = math.cos(line[PHI]), math.sin(line[PHI])
    first = cos * (piece[0] - line[X]) + sin * (piece[1] - line[Y]) - line[BEYOND]
    second = cos * (piece[2] - line[X]) + sin * (piece[3] - line[Y]) - line[BEYOND]
    spread = 2.0 * math.sqrt(line[VAR_BEYOND]) + 0.02
    if first >= 0.0 or second <= spread:
        return False
    at = first / (first - second)
    x, y = piece[0] + at * (piece[2] - piece[0]) - line[X], piece[1] + at * (piece[3] - piece[1]) - line[Y]
    t = -sin * x + cos * y
    return line[LOW] + 0.02 < t < line[HIGH] - 0.02


@njit(cache=True)
def was_free(pieces, n_pieces, x, y, model):
    """Whether an earlier drive passed well over a point."""
    within = model.half_width - 2.0 * model.contact
    for row in range(n_pieces):
        dx, dy = pieces[row, 2] - pieces[row, 0], pieces[row, 3] - pieces[row, 1]
        length = math.sqrt(dx * dx + dy * dy)
        if length < 1e-6:
            continue
        ux, uy = dx / length, dy / length
        px, py = x - pieces[row, 0], y - pieces[row, 1]
        along = ux * px + uy * py
        if 0.0 < along < length - 3.0 * model.contact and abs(uy * px - ux * py) < within:
            return True
    return False


@njit(cache=True)
def below(z):
    """The normal distribution."""
    return 0.5 * math.erfc(-z * 0.7071067811865476)


@njit(cache=True)
def weigh(swarm, p, pose, n_bumps, bumper, model, options):
    """Log likelihood of what a drive of particle p ended with at a pose.

    Fills `options` (k + 2,) with how likely a bump is told of each known line, of a new one, and of nothing.
    """
    n_lines = swarm.n_lines[p]
    lines = swarm.lines[p]
    log_weight = 0.0
    options[: n_lines + 2] = 0.0
    through = np.zeros(n_lines)
    total_through, known = 0.0, 0.0
    for j in range(n_lines):
        for piece in range(PIECES):
            if passed(lines[j], swarm.pieces[p, n_bumps * PIECES + piece]):
                log_weight += math.log(model.missed)
        delta = pose[2] - lines[j, PHI]
        if math.cos(delta) < STEEPEST:
            continue
        off, _, variance, place = innovation(lines[j], pose, model)
        if lines[j, LOW] < place < lines[j, HIGH]:
            through[j] = math.log(max(below(-off / math.sqrt(variance)), model.missed))
            total_through += through[j]
        if bumper != 0 and abs(off) < 6.0 * math.sqrt(variance):
            density = math.exp(-0.5 * off * off / variance) / math.sqrt(2.0 * math.pi * variance)
            options[j] = density * math.exp(extrapolated(lines[j], place, model)) * sided(delta, bumper)
            known += options[j]
    if bumper == 0:
        return log_weight + total_through
    if n_lines < lines.shape[0]:
        options[n_lines] = model.new_walls * model.settled / (model.settled + n_bumps)
        x, y = pose[0] + model.ahead * math.cos(pose[2]), pose[1] + model.ahead * math.sin(pose[2])
        if known < 50.0 * options[n_lines] and was_free(swarm.pieces[p], n_bumps * PIECES, x, y, model):
            options[n_lines] *= model.again
    options[n_lines + 1] = model.strays
    total = 0.0
    for j in range(n_lines + 2):
        # whoever is felt is no wall that was passed; all others must not be
        options[j] *= math.exp(total_through - (through[j] if j < n_lines else 0.0))
        total += options[j]
    return log_weight + math.log(total)


@njit(cache=True)
def believe(swarm, p, pose, n_bumps, key, model, options):
    """What a bump of particle p at a pose is told of is drawn of `options`, and the map learns it."""
    n_lines = swarm.n_lines[p]
    lines = swarm.lines[p]
    chosen = n_lines + 1
    u = uniform_of(key, p, 3) * np.sum(options[: n_lines + 2])
    for j in range(n_lines + 2):
        u -= options[j]
        if u < 0.0:
            chosen = j
            break
    if chosen < n_lines:
        learn(lines[chosen], pose, model)
        swarm.felt[p, n_bumps] = chosen
    elif chosen == n_lines:
        begin_line(lines[n_lines], pose, model)
        swarm.n_lines[p] += 1
        swarm.felt[p, n_bumps] = chosen
    else:
        swarm.felt[p, n_bumps] = STRAY


@njit(cache=True)
def sided(delta, bumper):
    """How well a bumper's switches go with the heading's angle to a wall; all is well where only the middle speaks."""
    if bumper == 1:  # left: the wall is met with the left end
        return below(-math.sin(delta) / 0.1)
    if bumper == 4:
        return below(math.sin(delta) / 0.1)
    return 1.0


@njit(cache=True)
def square_up(pose, line, flat, key, p, model):
    """A bump off square to a wall by less than `flat` may have turned the cart square to it."""
    off = pose[2] - line[PHI]
    off -= 2.0 * math.pi * math.floor(off / (2.0 * math.pi) + 0.5)
    if abs(off) < flat and line[VAR_PHI] < 0.01 and uniform_of(key, p, 4) < model.flat_share:
        spread = math.sqrt(line[VAR_PHI] + 0.01**2)
        pose[2] -= off - spread * gaussian_of(key, p, 5)


@njit(cache=True)
def attempt(swarm, p, stages, bumper, n_bumps, key, draw, model, start, pose, options):
    """Move particle p by the stages up to a drive's end with the errors of a `draw`, and weigh it.

    Fills `start` (3,), `pose` (3,), `options` and the drive's pieces; returns the log weight, and whether the cart was
    dragged along a wall.
    """
    last = stages.shape[0] - 1
    pose[:] = swarm.poses[p]
    gained = 0.0
    for s in range(last):
        gained += moved(pose, swarm.biases[p], stages[s], False, key, draw, 8 + 4 * s, model, pose)[0]
    start[:] = pose
    plus, is_dragged = moved(pose, swarm.biases[p], stages[last], bumper != 0, key, draw, 8 + 4 * last, model, pose)
    chord_pieces(start, pose, swarm.pieces[p], n_bumps * PIECES, model)
    return gained + plus + weigh(swarm, p, pose, n_bumps, bumper, model, options), is_dragged


@njit(cache=True)
def advance(swarm, stages, bumper, n_bumps, seed, vertex, model):
    """Move all particles by the stages (s, 3) up to a bump, the last of which is the drive, and weigh them by it.

    Each draws several errors of the odometry and goes on with one, chosen by how likely they make the bump (sampling
    importance resampling; Rubin, 1987); its weight is their mean, so that the filter estimates what it did with one.
    """
    key = vertex_key(seed, vertex)
    n, n_tries = swarm.poses.shape[0], int(model.tries)
    pose, start = np.empty(3), np.empty(3)
    options, logs = np.empty(swarm.lines.shape[1] + 2), np.empty(n_tries)
    for p in range(n):
        swarm.biases[p, 0] += 0.001 * gaussian_of(key, p, 6)
        swarm.biases[p, 1] += 0.003 * gaussian_of(key, p, 7)
        top = -np.inf
        is_dragged = False
        for i in range(n_tries):
            logs[i], is_dragged = attempt(
                swarm, p, stages, bumper, n_bumps, key, p + i * n, model, start, pose, options
            )
            top = max(top, logs[i])
        total = np.sum(np.exp(logs - top))
        gained = top + math.log(total / n_tries)
        if n_tries > 1:
            u = uniform_of(key, p, 1) * total
            taken = 0
            for i in range(n_tries):
                u -= math.exp(logs[i] - top)
                taken = i
                if u < 0.0:
                    break
            if taken < n_tries - 1:
                _, is_dragged = attempt(
                    swarm, p, stages, bumper, n_bumps, key, p + taken * n, model, start, pose, options
                )
        if bumper != 0:
            believe(swarm, p, pose, n_bumps, key, model, options)
        swarm.log_weights[p] += gained
        swarm.scores[p] += gained
        chosen = swarm.felt[p, n_bumps]
        if bumper != 0 and chosen >= 0:
            square_up(pose, swarm.lines[p, chosen], model.drag_turn if is_dragged else model.flat, key, p, model)
        swarm.poses[p] = pose
        for axis in range(3):
            swarm.begun[p, n_bumps, axis] = start[axis]
            swarm.bumped[p, n_bumps, axis] = pose[axis]


@njit(cache=True)
def chord_pieces(start, end, pieces, row, model):
    """Write the two chords that the bumper's middle goes along from pose `start` to `end`."""
    turn = end[2] - start[2]
    chord = math.hypot(end[0] - start[0], end[1] - start[1])
    half = chord / (2.0 * math.cos(0.25 * turn)) if abs(turn) < 3.0 else 0.5 * chord
    heading = start[2] + 0.25 * turn
    middle_x, middle_y = start[0] + half * math.cos(heading), start[1] + half * math.sin(heading)
    middle = start[2] + 0.5 * turn
    pieces[row, 0] = start[0] + model.ahead * math.cos(start[2])
    pieces[row, 1] = start[1] + model.ahead * math.sin(start[2])
    pieces[row, 2] = pieces[row + 1, 0] = middle_x + model.ahead * math.cos(middle)
    pieces[row, 3] = pieces[row + 1, 1] = middle_y + model.ahead * math.sin(middle)
    pieces[row + 1, 2] = end[0] + model.ahead * math.cos(end[2])
    pieces[row + 1, 3] = end[1] + model.ahead * math.sin(end[2])
