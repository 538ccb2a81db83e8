"""Kinds with shafts and bars that are partly too thin to count as held, at ends that are not.

The protocol of clutter removal fails a grasp whose pads close to less than 8 mm.  What tells a
shaft of 6 mm from one of 10 mm has to be learned from both.
"""

import numpy as np

from split_drake.objects.procedural.kinds import kind
from split_drake.objects.procedural.prisms import extruded
from split_drake.objects.procedural.revolved import turned
from split_drake.objects.procedural.shape import (
    Shape,
    ball,
    circle,
    cuboid,
    moved,
    rod,
    stretched,
    superellipsoid,
    swept,
    union,
)
from split_drake.poses import make_pose, rotation_y

# Edges and diameters of what is slender, before a scene's scale of 0.7 to 1.
_SLENDER_M = (0.005, 0.015)


def _lying(shape: Shape) -> Shape:
    """Return a shape that stands along z lying along x."""
    return moved(shape, make_pose(rotation_y(np.pi / 2.0)))


@kind("fork", "long", "flat", "composed")
def fork(rng: np.random.Generator) -> Shape:
    """Lying: two to four tines along x, on a flat handle."""
    count, thick = int(rng.integers(2, 5)), rng.uniform(0.008, 0.013)
    width, tine = rng.uniform(0.022, 0.036), rng.uniform(0.03, 0.045)
    length, grip = rng.uniform(0.05, 0.09), rng.uniform(*_SLENDER_M)
    palm = cuboid((0.016, width, thick), (0.0, 0.0, thick / 2.0))
    handle = cuboid(
        (length, grip, thick * rng.uniform(0.7, 1.0)), (-0.5 * length, 0.0, 0.4 * thick)
    )
    edge = min(0.6 * width / count, 0.009)
    ys = np.linspace(-0.5, 0.5, count) * (width - edge)
    tines = [cuboid((tine, edge, 0.9 * thick), (0.5 * tine, y, 0.5 * thick)) for y in ys]
    return union(palm, handle, *tines)


@kind("screwdriver", "long", "round", "composed")
def screwdriver(rng: np.random.Generator) -> Shape:
    """Lying along x: a thick grip and a thin shaft."""
    grip, radius = rng.uniform(0.035, 0.06), rng.uniform(0.009, 0.015)
    shaft, length = 0.5 * rng.uniform(*_SLENDER_M), rng.uniform(0.045, 0.08)
    handle = turned(
        [(0.8 * radius, 0.0), (radius, 0.15 * grip), (radius, 0.8 * grip), (0.6 * radius, grip)]
    )
    return _lying(union(handle, rod((0, 0, grip - 1e-3), (0, 0, grip + length), shaft)))


@kind("pen", "long", "round")
def pen(rng: np.random.Generator) -> Shape:
    """Lying along x: a rod with a point and a cap, as a rule a thicker one."""
    length, radius = rng.uniform(0.09, 0.145), 0.5 * rng.uniform(0.007, 0.016)
    cap, share = radius * rng.uniform(1.0, 1.6), rng.uniform(0.25, 0.45)
    body = turned([(0.3 * radius, 0.0), (radius, 0.012), (radius, length)])
    top = turned([(cap, (1.0 - share) * length), (cap, length + 1e-3)])
    return _lying(union(body, top))


@kind("lollipop", "long", "round", "composed")
def lollipop(rng: np.random.Generator) -> Shape:
    """Lying along x: a ball, a drop or a disc on a stick."""
    radius, length = rng.uniform(0.013, 0.028), rng.uniform(0.05, 0.085)
    head = stretched(ball(radius), (rng.uniform(0.8, 1.3), 1.0, rng.uniform(0.35, 1.0)))
    stick = rod(
        (0.5 * radius, 0.0, 0.0), (radius + length, 0.0, 0.0), 0.5 * rng.uniform(*_SLENDER_M)
    )
    return union(head, stick)


@kind("paddle", "long", "flat", "composed")
def paddle(rng: np.random.Generator) -> Shape:
    """Lying along x: a blade with rounded corners on a bar."""
    half, blade = rng.uniform(0.015, 0.03), rng.uniform(0.02, 0.035)
    thick, length = rng.uniform(0.008, 0.015), rng.uniform(0.05, 0.08)
    flat = moved(
        superellipsoid((blade, half, thick / 2.0), 0.2, rng.uniform(0.2, 0.9)),
        make_pose(p=(0.0, 0.0, thick / 2.0)),
    )
    height = thick * rng.uniform(0.7, 1.0)
    bar = cuboid(
        (length + 0.5 * blade, rng.uniform(*_SLENDER_M), height),
        (0.5 * blade + 0.5 * (length + 0.5 * blade), 0.0, height / 2.0),
    )
    return union(flat, bar)


@kind("ladder", "hollow", "flat", "composed")
def ladder(rng: np.random.Generator) -> Shape:
    """Lying: two bars along x and rungs between them."""
    length, width = rng.uniform(0.06, 0.11), rng.uniform(0.035, 0.06)
    bar, rung = rng.uniform(*_SLENDER_M), rng.uniform(0.006, 0.012)
    thick = rng.uniform(0.009, 0.016)
    bars = [
        cuboid((length, bar, thick), (0.0, y, thick / 2.0)) for y in (-width / 2.0, width / 2.0)
    ]
    places = np.linspace(-0.4, 0.4, int(rng.integers(2, 5))) * length
    rungs = [cuboid((rung, width, 0.8 * thick), (x, 0.0, thick / 2.0)) for x in places]
    return union(*bars, *rungs)


@kind("picture_frame", "hollow", "flat")
def picture_frame(rng: np.random.Generator) -> Shape:
    """Lying: a rectangle, an ellipse or a triangle with its middle cut out."""
    half = np.array([rng.uniform(0.025, 0.05), rng.uniform(0.02, 0.036)])
    bar = rng.uniform(*_SLENDER_M)
    count = int(rng.choice([3, 4, 24]))
    outline = circle(1.0, count) * half * (np.sqrt(2.0) if count == 4 else 1.0)
    # A triangle's edges are nearer to its middle than its corners, by half.
    inner = outline * np.clip(1.0 - bar / (half * np.cos(np.pi / count)), 0.15, 0.9)
    return extruded([outline, inner], rng.uniform(0.009, 0.02))


@kind("hook", "long", "composed")
def hook(rng: np.random.Generator) -> Shape:
    """Lying: a straight shaft that ends in an arc, with a knob or a bar at its other end."""
    radius, length = rng.uniform(0.016, 0.028), rng.uniform(0.045, 0.08)
    thick = 0.5 * rng.uniform(0.006, 0.014)
    angle = np.linspace(-np.pi / 2.0, rng.uniform(0.2, 0.5) * np.pi, 9)
    arc = radius * np.column_stack([np.cos(angle), np.sin(angle), 0.0 * angle])
    path = np.vstack([[-length, -radius, 0.0], arc])
    shaft = swept(path, circle(thick, 12), (0.0, 0.0, 1.0))
    end = rng.uniform(0.008, 0.014)
    if rng.random() < 0.5:
        return union(shaft, ball(end, path[0]))
    return union(shaft, cuboid((1.4 * end, rng.uniform(0.03, 0.05), 1.6 * end), path[0]))


@kind("comb", "flat", "composed")
def comb(rng: np.random.Generator) -> Shape:
    """Lying or on edge: a spine along x with teeth across it."""
    length, spine = rng.uniform(0.07, 0.13), rng.uniform(*_SLENDER_M)
    tooth, thick = rng.uniform(0.012, 0.03), rng.uniform(0.009, 0.014)
    count = int(rng.integers(4, 8))
    edge = 0.45 * length / count
    back = cuboid((length, spine, thick), (0.0, spine / 2.0, thick / 2.0))
    teeth = [
        cuboid((edge, tooth, 0.8 * thick), (x, spine + 0.5 * tooth - 1e-4, thick / 2.0))
        for x in np.linspace(-0.5, 0.5, count) * (length - edge)
    ]
    return union(back, *teeth)


@kind("stepped_bar", "long", "composed")
def stepped_bar(rng: np.random.Generator) -> Shape:
    """Lying along x: two or three bars of unequal thickness, end to end."""
    parts, x = [], 0.0
    for _ in range(int(rng.integers(2, 4))):
        length = rng.uniform(0.03, 0.05)
        y, z = rng.uniform(0.006, 0.03), rng.uniform(0.008, 0.02)
        parts.append(cuboid((length, y, z), (x + length / 2.0, 0.0, z / 2.0)))
        x += length - 1e-3
    return union(*parts)
