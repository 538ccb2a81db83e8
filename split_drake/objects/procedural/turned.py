"""Round kinds without a hollow, turned about z."""

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import PchipInterpolator

from split_drake.objects.procedural.kinds import kind
from split_drake.objects.procedural.revolved import turned
from split_drake.objects.procedural.shape import Shape, circle, hull, stretched
from split_drake.poses import Array


def smooth(knots: ArrayLike, rows: int = 16) -> Array:
    """Return a smooth profile (N, 2) through (radius, height) of its knots, from the foot up."""
    radius, height = np.asarray(knots, dtype=float).T
    z = np.linspace(height[0], height[-1], rows)
    return np.column_stack([PchipInterpolator(height, radius)(z), z])


@kind("can", "round")
def can(rng: np.random.Generator) -> Shape:
    """A cylinder, its edges bevelled."""
    radius, height = rng.uniform(0.014, 0.037), rng.uniform(0.025, 0.14)
    bevel = rng.uniform(0.0005, 0.003)
    rise = [
        (radius - bevel, 0.0),
        (radius, bevel),
        (radius, height - bevel),
        (radius - bevel, height),
    ]
    return turned(rise)


@kind("cone", "round")
def cone(rng: np.random.Generator) -> Shape:
    """A frustum on either end."""
    wide, narrow, height = (
        rng.uniform(0.02, 0.037),
        rng.uniform(0.005, 0.03),
        rng.uniform(0.04, 0.13),
    )
    ends = [wide, narrow] if rng.random() < 0.7 else [narrow, wide]
    return turned([(ends[0], 0.0), (ends[1], height)])


@kind("bottle", "round", "long")
def bottle(rng: np.random.Generator) -> Shape:
    """Body, shoulder, neck and cap; more or less flattened."""
    radius, body = rng.uniform(0.018, 0.035), rng.uniform(0.04, 0.085)
    neck, shoulder = radius * rng.uniform(0.35, 0.6), rng.uniform(0.008, 0.025)
    cap, neck_height = neck * rng.uniform(1.0, 1.25), rng.uniform(0.012, 0.03)
    fall = (1.0 + np.cos(np.linspace(0.0, np.pi, 8))) / 2.0
    slope = np.column_stack([neck + (radius - neck) * fall, np.linspace(body, body + shoulder, 8)])
    top = body + shoulder
    foot = [(radius - 0.002, 0.0), (radius, 0.002)]
    lid = [(cap, top + 0.3 * neck_height), (cap, top + neck_height)]
    profile = np.vstack([foot, slope, [(neck, top + 0.29 * neck_height)], lid])
    return stretched(turned(profile), (rng.uniform(0.65, 1.0), 1.0, 1.0))


@kind("vase", "round")
def vase(rng: np.random.Generator) -> Shape:
    """A smooth profile through four radii at random."""
    height = rng.uniform(0.05, 0.14)
    radii = rng.uniform(0.012, 0.036, 4)
    return turned(smooth(np.column_stack([radii, np.linspace(0.0, height, 4)])))


@kind("spool", "round")
def spool(rng: np.random.Generator) -> Shape:
    """Two flanges on a core."""
    flange, height = rng.uniform(0.02, 0.036), rng.uniform(0.03, 0.09)
    core, thickness = flange * rng.uniform(0.4, 0.75), rng.uniform(0.004, 0.012)
    slope = rng.uniform(0.0005, 0.004)
    half = [(flange, 0.0), (flange, thickness), (core, thickness + slope)]
    return turned([*half, *((r, height - z) for r, z in half[::-1])])


@kind("pill", "round", "long")
def pill(rng: np.random.Generator) -> Shape:
    """A capsule lying along x."""
    radius, length = rng.uniform(0.012, 0.034), rng.uniform(0.02, 0.09)
    angle = np.linspace(0.0, np.pi / 2.0, 7)
    rings = [
        np.column_stack(
            [np.full(24, length / 2.0 + radius * np.sin(a)), circle(radius * np.cos(a), 24)]
        )
        for a in angle
    ]
    end = np.vstack(rings)
    return hull(np.vstack([end, end * (-1.0, 1.0, 1.0)]))


@kind("pear", "round")
def pear(rng: np.random.Generator) -> Shape:
    """A belly and a narrower top, both round."""
    belly, top = rng.uniform(0.024, 0.036), rng.uniform(0.009, 0.02)
    height = rng.uniform(0.06, 0.11)
    z_belly, z_top = belly * 0.9, height - top
    knots = [
        *((belly * 0.45, 0.0), (belly * 0.86, z_belly * 0.45), (belly, z_belly)),
        *((top * 1.1, z_top - 0.002), (top * 0.8, height - top * 0.4), (top * 0.15, height)),
    ]
    return turned(smooth(knots, 24))
