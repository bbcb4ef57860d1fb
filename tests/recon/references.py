"""Slow, obvious forms of the kernels, to compare with. They take and return NumPy arrays."""

from __future__ import annotations

from collections import deque
from itertools import product

import numpy as np

WAYS = {4: [(0, 1), (0, -1), (1, 0), (-1, 0)]}
WAYS[8] = WAYS[4] + [(1, 1), (1, -1), (-1, 1), (-1, -1)]


def compare_at_shifts(reference, other, shifts, compare):
    """result[y, x, k] = compare(reference[..., y, x], other[..., y, x - shifts[k]])."""
    height, width = reference.shape[-2:]
    result = np.full((height, width, len(shifts)), np.inf)
    for y, x, (k, shift) in product(range(height), range(width), enumerate(shifts)):
        if 0 <= x - shift < width:
            result[y, x, k] = compare(reference[..., y, x], other[..., y, x - shift])
    return result


def window(y, x, shape, radius):
    """List the pixels around (y, x) that exist."""
    rows = range(max(0, y - radius), min(shape[0], y + radius + 1))
    columns = range(max(0, x - radius), min(shape[1], x + radius + 1))
    return list(product(rows, columns))


def census_words(image, rows, columns):
    height, width = image.shape
    words, cells = np.zeros((2, height, width), np.int64)
    offsets = product(range(-(rows // 2), rows // 2 + 1), range(-(columns // 2), columns // 2 + 1))
    for bit, (dy, dx) in enumerate(o for o in offsets if o != (0, 0)):
        for y, x in np.ndindex(height, width):
            if 0 <= y + dy < height and 0 <= x + dx < width:
                cells[y, x] |= 1 << bit
                words[y, x] |= int(image[y + dy, x + dx] < image[y, x]) << bit
    return words, cells


def normalised_patches(image, radius, *, centred):
    height, width = image.shape
    side = 2 * radius + 1
    result = np.zeros((side * side, height, width))
    for y, x in np.ndindex(height, width):
        pixels = window(y, x, image.shape, radius)
        values = np.array([image[q] for q in pixels], np.float64)
        if centred:
            values -= values.mean()
        for (row, column), value in zip(pixels, values / np.linalg.norm(values), strict=True):
            result[(row - y + radius) * side + column - x + radius, y, x] = value
    return result


def weighted_mean(volume, radius, weight):
    """Mean of the finite neighbours q of p, by weight(p, q); +inf stays."""
    result = np.full(volume.shape, np.inf)
    for y, x, k in np.ndindex(volume.shape):
        if not np.isfinite(volume[y, x, k]):
            continue
        total = norm = 0.0
        for q in window(y, x, volume.shape, radius):
            if np.isfinite(volume[q][k]):
                total += weight((y, x), q) * volume[q][k]
                norm += weight((y, x), q)
        result[y, x, k] = total / norm
    return result


def bilateral_mean(volume, guide, *, radius, sigma_space, sigma_colour):
    def weight(p, q):
        distance = (p[0] - q[0]) ** 2 + (p[1] - q[1]) ** 2
        difference = ((guide[p].astype(np.float64) - guide[q]) ** 2).sum()
        value = np.exp(-distance / (2 * sigma_space**2) - difference / (2 * sigma_colour**2))
        return value if value >= 1e-3 else 0.0

    return weighted_mean(volume, radius, weight)


def lowest(line):
    """Return layer, value, before, after, rival of one column of a volume."""
    if not np.isfinite(line).any():
        return -1, np.inf, np.inf, np.inf, np.inf
    k = int(np.argmin(line))
    padded = np.pad(line, 1, constant_values=np.inf)
    rivals = np.concatenate([line[: max(0, k - 1)], line[k + 2 :], [np.inf]])
    return k, line[k], padded[k], padded[k + 2], rivals.min()


def smooth_line(line, feedback):
    """J[n] = (1 - a^d) I[n] + a^d J[n - 1], forward and then backward."""
    result = line.astype(np.float64).copy()
    for n in range(1, len(line)):
        result[n] = (1 - feedback[n]) * result[n] + feedback[n] * result[n - 1]
    for n in range(len(line) - 2, -1, -1):
        result[n] = (1 - feedback[n + 1]) * result[n] + feedback[n + 1] * result[n + 1]
    return result


def smooth_along_rows_and_columns(values, weights, steps, *, sigma, iterations):
    images = [values * weights, weights]
    for i in range(1, iterations + 1):
        s = sigma * np.sqrt(3) * 2 ** (iterations - i) / np.sqrt(4**iterations - 1)
        across, down = (np.exp(-np.sqrt(2) / s) ** step.astype(np.float64) for step in steps)
        for index, image in enumerate(images):
            rows = np.array([smooth_line(*pair) for pair in zip(image, across, strict=True)])
            columns = [smooth_line(*pair) for pair in zip(rows.T, down.T, strict=True)]
            images[index] = np.array(columns).T
    return images[0] / images[1]


def weighted_median(values, guide, *, radius, sigma_colour):
    result = np.full(values.shape, np.nan)
    for p in np.argwhere(~np.isnan(values)):
        p = tuple(p)
        pixels = [q for q in window(*p, values.shape, radius) if not np.isnan(values[q])]
        pixels.sort(key=lambda q: values[q])
        difference = [((guide[p].astype(np.float64) - guide[q]) ** 2).sum() for q in pixels]
        weights = np.exp(-np.array(difference) / (2 * sigma_colour**2))
        reached = np.cumsum(weights) >= weights.sum() / 2
        result[p] = values[pixels[int(np.argmax(reached))]]
    return result


def segment_sizes(values, largest_step):
    sizes = np.zeros(values.shape, np.int64)
    for start in np.argwhere(~np.isnan(values)):
        if sizes[tuple(start)]:
            continue
        piece, queue = {tuple(start)}, deque([tuple(start)])
        while queue:
            y, x = queue.popleft()
            for q in ((y - 1, x), (y + 1, x), (y, x - 1), (y, x + 1)):
                if not (0 <= q[0] < values.shape[0] and 0 <= q[1] < values.shape[1]):
                    continue
                if q not in piece and abs(values[q] - values[y, x]) <= largest_step:
                    piece.add(q)
                    queue.append(q)
        for q in piece:
            sizes[q] = len(piece)
    return sizes


def local_planes(values, weights, guide, belonging, slopes, *, rounds):
    radius, step, colour, tolerance = belonging
    height, width = values.shape
    planes = np.concatenate([values[..., None], slopes], -1).astype(np.float64)
    for number in range(rounds):
        before, planes = planes, planes.copy()
        for y, x in np.argwhere(~np.isnan(values)):
            dy, dx = np.mgrid[-radius : radius + 1, -radius : radius + 1]
            inside = (y + dy >= 0) & (y + dy < height) & (x + dx >= 0) & (x + dx < width)
            inside &= (dy % step == 0) & (dx % step == 0)
            dy, dx = dy[inside], dx[inside]
            v = values[y + dy, x + dx].astype(np.float64)
            distance = np.hypot(dx, dy)
            v -= before[y, x] @ [np.ones_like(dx), dx, dy]
            most = tolerance + (0.125 * distance if number == 0 else 0.0)
            alike = 1 - np.abs(guide[y + dy, x + dx] - guide[y, x]).sum(-1) / colour
            w = weights[y + dy, x + dx] * alike.clip(0) * (1 - (v / most) ** 2).clip(0)
            w = np.nan_to_num(w * (1 - distance**2 / (2 * (radius + 1) ** 2)))
            if w.sum() < 1:
                continue
            columns = np.stack([np.ones_like(v), dx, dy], -1)
            normal = (columns * w[:, None]).T @ columns
            normal += np.diag([0, 1, 1]) * 0.002 * w.sum() * radius**2
            right = (columns * w[:, None]).T @ np.nan_to_num(v)
            planes[y, x] = before[y, x] + np.linalg.solve(normal, right)
    return planes[..., 0]


def path_sums(volume, guide, costs, directions):
    """Follow the recursion pixel by pixel; a path begins behind a pixel without cells."""
    height, width, count = volume.shape
    total = np.zeros(volume.shape)
    steps = np.abs(np.subtract.outer(np.arange(count), np.arange(count)))
    for down, right in WAYS[directions]:
        paths = np.zeros(volume.shape)
        rows = range(height) if down >= 0 else range(height - 1, -1, -1)
        columns = range(width) if right >= 0 else range(width - 1, -1, -1)
        for y, x in product(rows, columns):
            above, beside = y - down, x - right
            paths[y, x] = volume[y, x]
            inside = 0 <= above < height and 0 <= beside < width
            if inside and np.isfinite(volume[above, beside]).any():
                edge = abs(guide[y, x] - guide[above, beside]) >= costs.edge
                large = costs.large * (costs.across if edge else 1)
                pays = np.where(steps == 0, 0, np.where(steps == 1, costs.small, large))
                before = paths[above, beside]
                paths[y, x] += (before + pays).min(1) - before.min()
        total += paths
    return total
