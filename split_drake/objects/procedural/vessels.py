"""Hollow kinds: thin walls around a space that is open at the top, or at both ends."""

import numpy as np

from split_drake.objects.procedural.kinds import kind
from split_drake.objects.procedural.revolved import ring, sleeve, turned, vessel
from split_drake.objects.procedural.shape import (
    Shape,
    circle,
    cuboid,
    moved,
    stretched,
    superellipsoid,
    swept,
    union,
)
from split_drake.objects.procedural.turned import smooth
from split_drake.poses import Array, make_pose


def _rising(foot: float, rim: float, height: float, power: float, rows: int = 12) -> Array:
    """Return a profile (N, 2) from the axis over a flat foot up to the rim.

    The wall is a superellipse's quarter: straighter for higher powers.
    """
    angle = np.linspace(0.0, np.pi / 2.0, rows)
    radius = foot + (rim - foot) * np.sin(angle) ** (2.0 / power)
    z = height * (1.0 - np.cos(angle) ** (2.0 / power))
    return np.vstack([[0.0, 0.0], np.column_stack([radius, z])])


@kind("bowl", "hollow", "round")
def bowl(rng: np.random.Generator) -> Shape:
    """Wider than high, on a small flat foot."""
    rim, height = rng.uniform(0.035, 0.068), rng.uniform(0.025, 0.055)
    foot, wall = rim * rng.uniform(0.35, 0.6), rng.uniform(0.0035, 0.006)
    return vessel(_rising(foot, rim, height, rng.uniform(1.6, 2.3)), wall)


def _cup_profile(rng: np.random.Generator) -> Array:
    foot, height = rng.uniform(0.02, 0.032), rng.uniform(0.05, 0.115)
    rim = min(foot * rng.uniform(1.0, 1.4), 0.038)
    belly = (foot + rim) / 2.0 * rng.uniform(0.95, 1.12)
    wall = smooth([(foot, 0.0), (belly, height * rng.uniform(0.4, 0.6)), (rim, height)], 10)
    return np.vstack([[0.0, 0.0], wall])


@kind("cup", "hollow", "round")
def cup(rng: np.random.Generator) -> Shape:
    """Without a handle; a little bellied or waisted."""
    return vessel(_cup_profile(rng), rng.uniform(0.003, 0.005))


@kind("handled_cup", "hollow", "composed")
def handled_cup(rng: np.random.Generator) -> Shape:
    """A cup with a handle towards x."""
    profile, wall = _cup_profile(rng), rng.uniform(0.0035, 0.005)
    height = profile[-1, 1]
    half_span, reach = height * rng.uniform(0.24, 0.36), rng.uniform(0.022, 0.034)
    angle = np.linspace(-np.pi / 2.0, np.pi / 2.0, 11)
    z = height * rng.uniform(0.48, 0.54) + half_span * np.sin(angle)
    roots = np.interp(z, profile[1:, 1], profile[1:, 0]) - wall / 2.0
    x = np.interp(z, z[[0, -1]], roots[[0, -1]]) + reach * np.cos(angle) ** rng.uniform(0.6, 1.0)
    path = np.column_stack([x, np.zeros(len(x)), z])
    grip = circle(rng.uniform(0.0035, 0.0055), 12) * (1.0, rng.uniform(1.0, 1.8))
    return union(vessel(profile, wall), swept(path, grip, (0.0, 1.0, 0.0)))


@kind("dish", "hollow", "flat", "round")
def dish(rng: np.random.Generator) -> Shape:
    """A plate or a saucer."""
    rim, height = rng.uniform(0.04, 0.068), rng.uniform(0.012, 0.022)
    profile = _rising(rim * rng.uniform(0.5, 0.7), rim, height, 1.4, 7)
    return vessel(profile, rng.uniform(0.0035, 0.005))


@kind("tray", "hollow", "composed")
def tray(rng: np.random.Generator) -> Shape:
    """A box without a lid."""
    a, b = rng.uniform(0.045, 0.09), rng.uniform(0.05, 0.12)
    height, wall = rng.uniform(0.025, 0.065), rng.uniform(0.0035, 0.006)
    floor = cuboid((a, b, wall), (0.0, 0.0, wall / 2.0))
    sides = [
        cuboid((wall, b, height), (sign * (a - wall) / 2.0, 0.0, height / 2.0)) for sign in (-1, 1)
    ]
    ends = [
        cuboid((a, wall, height), (0.0, sign * (b - wall) / 2.0, height / 2.0)) for sign in (-1, 1)
    ]
    return union(floor, *sides, *ends)


@kind("tube", "hollow", "long")
def tube(rng: np.random.Generator) -> Shape:
    """Standing, open at both ends."""
    radius, height = rng.uniform(0.013, 0.037), rng.uniform(0.03, 0.13)
    return sleeve([(radius, 0.0), (radius, height)], rng.uniform(0.0035, min(0.009, radius * 0.5)))


@kind("ring", "hollow", "flat", "round")
def torus(rng: np.random.Generator) -> Shape:
    """A ring lying flat, its cross-section an ellipse."""
    radius, thick = rng.uniform(0.02, 0.045), rng.uniform(0.005, 0.010)
    section = circle(thick, 14) * (1.0, rng.uniform(0.7, 1.5)) + (radius + thick, 0.0)
    return ring(section)


@kind("jar", "hollow", "round")
def jar(rng: np.random.Generator) -> Shape:
    """A belly, and a mouth that is narrower, with a lip."""
    belly, height = rng.uniform(0.026, 0.037), rng.uniform(0.05, 0.11)
    foot, mouth = belly * rng.uniform(0.6, 0.9), belly * rng.uniform(0.6, 0.8)
    knots = [
        *((foot, 0.0), (belly, height * rng.uniform(0.35, 0.55)), (mouth, height * 0.9)),
        (mouth * rng.uniform(1.02, 1.12), height),
    ]
    return vessel(np.vstack([[0.0, 0.0], smooth(knots, 16)]), rng.uniform(0.003, 0.0045))


@kind("goblet", "hollow", "round", "composed")
def goblet(rng: np.random.Generator) -> Shape:
    """A bowl on a stem on a foot."""
    foot, stem = rng.uniform(0.02, 0.032), rng.uniform(0.004, 0.008)
    rise, rim = rng.uniform(0.03, 0.06), rng.uniform(0.022, 0.036)
    base = [(foot, 0.0), (foot, 0.003), (stem, 0.008), (stem, rise), (stem * 1.6, rise + 0.004)]
    top = vessel(_rising(rim * 0.45, rim, rng.uniform(0.03, 0.055), 2.4), rng.uniform(0.003, 0.004))
    return union(turned(base), moved(top, make_pose(p=(0.0, 0.0, rise + 0.002))))


@kind("pan", "hollow", "flat", "long", "composed")
def pan(rng: np.random.Generator) -> Shape:
    """A low round pan, its handle along x."""
    rim, height = rng.uniform(0.03, 0.042), rng.uniform(0.014, 0.03)
    wall, length = rng.uniform(0.003, 0.0045), rng.uniform(0.05, 0.065)
    body = vessel(_rising(rim * 0.85, rim, height, 3.0, 8), wall)
    grip = superellipsoid(
        (length / 2.0, rng.uniform(0.006, 0.010), rng.uniform(0.004, 0.006)), 0.7, 0.4
    )
    p_OGrip = (rim - wall * 0.6 + length / 2.0, 0.0, height - 0.006)
    return union(body, moved(grip, make_pose(p=p_OGrip)))


@kind("oval_tub", "hollow")
def oval_tub(rng: np.random.Generator) -> Shape:
    """A vessel stretched along y, with steep walls."""
    rim, height = rng.uniform(0.028, 0.037), rng.uniform(0.03, 0.07)
    profile = _rising(rim * rng.uniform(0.75, 0.9), rim, height, rng.uniform(2.5, 4.0))
    return stretched(
        vessel(profile, rng.uniform(0.0035, 0.005)), (1.0, rng.uniform(1.15, 1.45), 1.0)
    )
