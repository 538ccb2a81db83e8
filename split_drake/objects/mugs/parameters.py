"""The parametric family of mugs: what can vary, within which ranges, and the body's profile."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from split_drake.poses import Array

BodyProfile = Literal["straight", "tapered", "curved", "flared", "barrel", "teacup"]
HandleShape = Literal["round", "D", "square", "ear"]

PROFILES: tuple[BodyProfile, ...] = get_args(BodyProfile)
HANDLES: tuple[HandleShape, ...] = get_args(HandleShape)

# Lower and upper end of each range that is drawn uniformly, whatever the profile and handle.
RANGES: dict[str, tuple[float, float]] = {
    "outer_radius_m": (0.03, 0.06),
    "height_m": (0.055, 0.12),
    "wall_m": (0.0025, 0.005),
    "base_m": (0.003, 0.008),
    "profile_strength": (0.0, 1.0),
    "handle_reach_m": (0.028, 0.052),
    "handle_span": (0.45, 1.0),
    "handle_position": (0.0, 1.0),
    "grip_thickness_m": (0.005, 0.012),
    "grip_aspect": (1.0, 2.2),
    "mass_kg": (0.15, 0.40),
}

# Mugs that are harder to see and to hang: what a mug may be at all.
WIDENED_RANGES = RANGES | {
    "wall_m": (0.0015, 0.013),
    "grip_thickness_m": (0.002, 0.012),
    "handle_lift_m": (-0.02, 0.02),
}

# Those of them whose grips are thinnest.
THIN_RANGES = WIDENED_RANGES | {"grip_thickness_m": (0.002, 0.003)}

# Exponent of the handle's superellipse: 2 is an ellipse, a large one a rectangle.
HANDLE_POWERS: dict[HandleShape, tuple[float, float]] = {
    "round": (1.9, 2.2),
    "D": (2.8, 4.0),
    "square": (6.0, 10.0),
    "ear": (1.7, 2.6),
}

# Only ears lean; a positive skew widens the upper half.
EAR_SKEWS = (-0.45, 0.45)

# Lengths are kept to 10 micrometres, so that a file of parameters rebuilds the same mesh.
DECIMALS = 5


@dataclass(frozen=True)
class MugParameters:
    """A mug in its frame O: origin at the centre of the base, z to the rim, handle towards x.

    Attributes:
        profile: how the outer radius changes with height, see `outer_radius_m`.
        outer_radius_m: largest outer radius of the body.
        height_m: from the table to the rim.
        wall_m: thickness of the wall, across it.
        base_m: thickness of the base.
        profile_strength: 0 (mild) to 1 (strong).
        handle: family of the handle's outline.
        handle_power: exponent of its superellipse, above 1.
        handle_skew: share by which the handle reaches further at its top than at its middle.
        handle_reach_m: from the body's wall to the handle's centreline at its furthest.
        handle_span: height of the handle, as a share of what the body's height leaves room for.
        handle_position: 0 (as low as there is room) to 1 (as high).
        grip_thickness_m: of the handle's cross-section, in the plane y = 0.
        grip_aspect: its width along y over its thickness, 1 or more.
        mass_kg: of the whole mug.
        handle_lift_m: how far the handle's middle rises above a straight way out from its roots:
            it may reach above the rim, or below the base.

    Raises ValueError where a name is unknown or a number leaves its range.
    """

    profile: BodyProfile
    outer_radius_m: float
    height_m: float
    wall_m: float
    base_m: float
    profile_strength: float
    handle: HandleShape
    handle_power: float
    handle_skew: float
    handle_reach_m: float
    handle_span: float
    handle_position: float
    grip_thickness_m: float
    grip_aspect: float
    mass_kg: float
    handle_lift_m: float = 0.0

    def __post_init__(self) -> None:
        if self.profile not in PROFILES:
            raise ValueError(f"profile is {self.profile!r}; expected one of {PROFILES}")
        if self.handle not in HANDLES:
            raise ValueError(f"handle is {self.handle!r}; expected one of {HANDLES}")
        for name, (low, high) in WIDENED_RANGES.items():
            value = getattr(self, name)
            if not low <= value <= high:
                raise ValueError(f"{name} is {value}; expected {low} to {high}")

    def numbers(self) -> Array:
        """Return (F,) the numeric parameters, each as a share of its range where it has one."""
        values = []
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name in RANGES:
                low, high = RANGES[field.name]
                values.append((value - low) / (high - low))
            elif isinstance(value, float):
                values.append(value)
        return np.array(values)


def sample_parameters(
    rng: np.random.Generator, ranges: Mapping[str, tuple[float, float]] = RANGES
) -> MugParameters:
    """Draw each parameter uniformly; the mug may turn out invalid (`build.build_mug` judges).

    Args:
        ranges: those of RANGES, widened or narrowed; WIDENED_RANGES bound them.
    """
    profile = PROFILES[rng.integers(len(PROFILES))]
    handle = HANDLES[rng.integers(len(HANDLES))]
    drawn = {name: round(rng.uniform(*limits), DECIMALS) for name, limits in ranges.items()}
    power = round(rng.uniform(*HANDLE_POWERS[handle]), DECIMALS)
    skew = round(rng.uniform(*EAR_SKEWS), DECIMALS) if handle == "ear" else 0.0
    return MugParameters(
        profile=profile, handle=handle, handle_power=power, handle_skew=skew, **drawn
    )


def _relative_radius(profile: BodyProfile, strength: float, t: Array) -> Array:
    """Return the outer radius over the largest one at relative heights `t` in [0, 1]."""
    match profile:
        case "straight":
            return 1.0 - 0.03 * strength * (1.0 - t)
        case "tapered":
            return 1.0 - (0.08 + 0.24 * strength) * (1.0 - t)
        case "curved":
            bend = np.clip(1.0 - t / 0.55, 0.0, 1.0)
            return 1.0 - (0.2 + 0.2 * strength) * bend**2.5
        case "flared":
            return 1.0 - (0.12 + 0.2 * strength) * (1.0 - t**2.5)
        case "barrel":
            return 1.0 - (0.08 + 0.14 * strength) * (2.0 * t - 1.0) ** 2
        case "teacup":
            return 1.0 - (0.40 + 0.2 * strength) * (1.0 - t) ** 2.2


def outer_radius_m(parameters: MugParameters, z: ArrayLike) -> Array:
    """Return the body's outer radius at heights `z` (...), metres; beyond its ends as at them."""
    t = np.clip(np.asarray(z, dtype=float) / parameters.height_m, 0.0, 1.0)
    relative = _relative_radius(parameters.profile, parameters.profile_strength, t)
    return parameters.outer_radius_m * relative
