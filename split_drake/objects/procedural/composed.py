"""Kinds put together from parts: tools and toys."""

import numpy as np
from scipy.spatial.transform import Rotation

from split_drake.objects.procedural.kinds import kind
from split_drake.objects.procedural.prisms import extruded
from split_drake.objects.procedural.revolved import turned, vessel
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
from split_drake.poses import make_pose, rotation_y, rotation_z


@kind("hammer", "long", "composed")
def hammer(rng: np.random.Generator) -> Shape:
    """Lying; its handle along x, its head along y."""
    length, thick = rng.uniform(0.09, 0.13), rng.uniform(0.006, 0.011)
    handle = moved(
        superellipsoid((length / 2.0, thick, thick * 0.8), 0.8, 0.3),
        make_pose(p=(length / 2.0, 0, 0)),
    )
    half, size = rng.uniform(0.022, 0.04), rng.uniform(0.009, 0.014)
    if rng.random() < 0.5:
        head = cuboid((2.0 * size, 2.0 * half, 2.0 * size))
    else:
        head = rod((0.0, -half, 0.0), (0.0, half, 0.0), size, size * rng.uniform(0.6, 1.2))
    return union(handle, head)


@kind("spoon", "long", "composed", "flat")
def spoon(rng: np.random.Generator) -> Shape:
    """Lying; a shallow oval bowl and a handle that rises along x."""
    half, depth = rng.uniform(0.015, 0.022), rng.uniform(0.008, 0.012)
    profile = [(0.0, 0.0), (0.45 * half, 0.0), (0.8 * half, 0.4 * depth), (half, depth)]
    bowl = stretched(vessel(profile, 0.003), (rng.uniform(1.2, 1.5), 1.0, 1.0))
    x_rim, length = bowl.mesh.bounds[1][0], rng.uniform(0.06, 0.085)
    x = x_rim - 0.003 + np.linspace(0.0, length, 5)
    z = depth - 0.002 + rng.uniform(0.0, 0.015) * np.linspace(0.0, 1.0, 5) ** 2
    grip = circle(rng.uniform(0.0030, 0.0045), 12) * (1.0, rng.uniform(1.2, 2.0))
    path = np.column_stack([x, np.zeros(5), z])
    return union(bowl, swept(path, grip, (0.0, 1.0, 0.0), np.linspace(0.8, 1.2, 5)))


@kind("tower", "composed")
def tower(rng: np.random.Generator) -> Shape:
    """Two to four blocks and cylinders stacked, each beside the middle of the one below."""
    parts, z, width = [], 0.0, rng.uniform(0.04, 0.068)
    for _ in range(int(rng.integers(2, 5))):
        height = rng.uniform(0.015, 0.04)
        x, y = rng.uniform(-0.1, 0.1, 2) * width
        if rng.random() < 0.5:
            block = cuboid((width, width * rng.uniform(0.5, 1.0), height), (0.0, 0.0, height / 2.0))
        else:
            block = turned([(width / 2.0, 0.0), (width / 2.0, height)])
        parts.append(moved(block, make_pose(rotation_z(rng.uniform(0.0, np.pi)), (x, y, z))))
        z, width = z + height - 1e-4, width * rng.uniform(0.5, 0.9)
    return union(*parts)


@kind("dumbbell", "long", "round", "composed")
def dumbbell(rng: np.random.Generator) -> Shape:
    """Lying along x: weights, round or square, on a bar."""
    length, bar, weight = (
        rng.uniform(0.07, 0.12),
        rng.uniform(0.006, 0.011),
        rng.uniform(0.016, 0.027),
    )
    thick, style = rng.uniform(0.012, 0.025), int(rng.integers(3))
    parts = [rod((-length / 2.0, 0.0, 0.0), (length / 2.0, 0.0, 0.0), bar)]
    for x in (-length / 2.0, length / 2.0):
        if style == 0:
            parts.append(ball(weight, (x, 0.0, 0.0)))
        elif style == 1:
            parts.append(rod((x - thick / 2.0, 0.0, 0.0), (x + thick / 2.0, 0.0, 0.0), weight))
        else:
            parts.append(cuboid((thick, 1.7 * weight, 1.7 * weight), (x, 0.0, 0.0)))
    return union(*parts)


@kind("stool", "composed")
def stool(rng: np.random.Generator) -> Shape:
    """A seat on three or four legs."""
    radius, height = rng.uniform(0.025, 0.045), rng.uniform(0.04, 0.09)
    seat, leg = rng.uniform(0.006, 0.014), rng.uniform(0.004, 0.007)
    count = int(rng.integers(3, 5))
    spread = rng.uniform(0.65, 0.95) * radius
    top = turned([(radius, height - seat), (radius, height)])
    starts, ends = circle(spread, count), circle(0.6 * radius, count)
    legs = [
        rod((*a, 0.0), (*b, height - seat / 2.0), leg) for a, b in zip(starts, ends, strict=True)
    ]
    return union(top, *legs)


@kind("car", "composed")
def car(rng: np.random.Generator) -> Shape:
    """A toy on four wheels."""
    length, width = rng.uniform(0.06, 0.11), rng.uniform(0.03, 0.05)
    wheel, body = rng.uniform(0.010, 0.015), rng.uniform(0.018, 0.028)
    cabin = rng.uniform(0.015, 0.025)
    chassis = cuboid((length, width, body), (0.0, 0.0, wheel + body / 2.0))
    top = cuboid(
        (length * rng.uniform(0.4, 0.6), width * 0.85, cabin),
        (-0.05 * length, 0.0, wheel + body + cabin / 2.0 - 1e-4),
    )
    half = width / 2.0
    wheels = [
        rod((x, y - 0.005, wheel), (x, y + 0.005, wheel), wheel)
        for x in (-0.3 * length, 0.3 * length)
        for y in (-half, half)
    ]
    return union(chassis, top, *wheels)


@kind("cluster", "composed")
def cluster(rng: np.random.Generator) -> Shape:
    """Three to five blocks, balls and rods stuck into each other."""
    parts, p_OPart = [], np.zeros(3)
    for _ in range(int(rng.integers(3, 6))):
        size = rng.uniform(0.014, 0.024)
        style, R = int(rng.integers(3)), Rotation.from_quat(rng.normal(size=4)).as_matrix()
        if style == 0:
            part = cuboid(size * rng.uniform(1.0, 2.4, 3))
        elif style == 1:
            part = ball(size)
        else:
            part = rod((0.0, 0.0, -1.6 * size), (0.0, 0.0, 1.6 * size), 0.7 * size)
        parts.append(moved(part, make_pose(R, p_OPart)))
        step = rng.normal(size=3)
        p_OPart = p_OPart + 0.9 * size * step / np.linalg.norm(step)
    return union(*parts)


@kind("wrench", "long", "flat", "composed")
def wrench(rng: np.random.Generator) -> Shape:
    """Lying along x: a bar with an open jaw at one end and a ring at the other."""
    length, thick = rng.uniform(0.07, 0.09), rng.uniform(0.009, 0.014)
    jaw, eye = rng.uniform(0.014, 0.020), rng.uniform(0.012, 0.016)
    grip = rng.uniform(0.009, 0.013)
    bar = cuboid((length, grip, 0.8 * thick), (length / 2.0, 0.0, thick / 2.0))
    gap = np.radians(rng.uniform(28.0, 40.0))
    around = np.linspace(gap, 2.0 * np.pi - gap, 15)
    arc = np.column_stack([np.cos(around), np.sin(around)])
    open_end = extruded([np.vstack([jaw * arc, 0.5 * jaw * arc[::-1]])], thick)
    closed_end = extruded([circle(eye, 24), circle(0.55 * eye, 24)], thick)
    # The bar runs into the material of both ends and not on into their openings.
    turned_away = moved(
        open_end, make_pose(rotation_z(np.pi + rng.uniform(-0.25, 0.25)), (-0.75 * jaw, 0, 0))
    )
    return union(bar, turned_away, moved(closed_end, make_pose(p=(length + 0.75 * eye, 0.0, 0.0))))


@kind("brush", "long", "composed")
def brush(rng: np.random.Generator) -> Shape:
    """Standing on its bristles, its handle along x."""
    length, width = rng.uniform(0.05, 0.075), rng.uniform(0.022, 0.04)
    thick, bristles = rng.uniform(0.010, 0.016), rng.uniform(0.012, 0.025)
    back = moved(
        superellipsoid((length / 2.0, width / 2.0, thick / 2.0), 0.4, 0.5),
        make_pose(p=(0.0, 0.0, bristles + thick / 2.0)),
    )
    hair = cuboid(
        (0.85 * length, 0.75 * width, bristles + thick / 2.0),
        (0.0, 0.0, (bristles + thick / 2.0) / 2.0),
    )
    handle = rng.uniform(0.05, 0.065)
    start = length / 2.0 - 0.008
    ends = (
        (start, 0.0, bristles + thick / 2.0),
        (start + handle, 0.0, bristles + thick / 2.0 + rng.uniform(0.0, 0.015)),
    )
    return union(back, hair, rod(*ends, 0.45 * thick, 0.6 * thick))


@kind("animal", "composed")
def animal(rng: np.random.Generator) -> Shape:
    """A toy on four legs, with a head and a tail."""
    length, width, height = (
        rng.uniform(0.05, 0.08),
        rng.uniform(0.026, 0.042),
        rng.uniform(0.024, 0.036),
    )
    leg, thick = rng.uniform(0.018, 0.035), rng.uniform(0.005, 0.008)
    z = leg + height / 2.0
    body = moved(
        superellipsoid((length / 2.0, width / 2.0, height / 2.0), 0.7, 0.7),
        make_pose(p=(0.0, 0.0, z)),
    )
    x_leg, y_leg = 0.32 * length, 0.26 * width
    legs = [rod((x, y, 0.0), (x, y, z), thick) for x in (-x_leg, x_leg) for y in (-y_leg, y_leg)]
    head_size = height * rng.uniform(0.38, 0.5)
    head = ball(head_size, (0.5 * length + 0.3 * head_size, 0.0, z + 0.5 * height))
    tail = rod(
        (-0.4 * length, 0.0, z),
        (-0.5 * length - 0.015, 0.0, z + rng.uniform(0.0, 0.02)),
        0.0055,
        0.004,
    )
    return union(body, head, tail, *legs)


@kind("jack", "round", "composed")
def jack(rng: np.random.Generator) -> Shape:
    """Three rods through one point, with knobs, standing on three of them."""
    reach, thick = rng.uniform(0.025, 0.042), rng.uniform(0.005, 0.009)
    knob = thick * rng.uniform(1.2, 1.8)
    rods = [rod(-reach * axis, reach * axis, thick) for axis in np.eye(3)]
    knobs = [ball(knob, sign * reach * axis) for axis in np.eye(3) for sign in (-1.0, 1.0)]
    # The diagonal of the three axes points up.
    R = rotation_y(-np.arctan(np.sqrt(2.0))) @ rotation_z(-np.pi / 4.0)
    return moved(union(*rods, *knobs), make_pose(R))


@kind("bolt", "long", "composed")
def bolt(rng: np.random.Generator) -> Shape:
    """A shaft with a head of four or six edges, on its head or lying along x."""
    head, shaft = rng.uniform(0.016, 0.03), rng.uniform(0.007, 0.012)
    thick, length = rng.uniform(0.010, 0.018), rng.uniform(0.045, 0.10)
    top = extruded([circle(head, int(rng.choice([4, 6])))], thick)
    whole = union(
        top,
        turned(
            [(shaft, thick - 1e-4), (shaft, thick + length), (0.7 * shaft, thick + length + 0.003)]
        ),
    )
    return whole if rng.random() < 0.5 else moved(whole, make_pose(rotation_y(np.pi / 2.0)))
