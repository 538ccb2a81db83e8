"""The cells of the physics study: the station as it is, and one thing changed at a time."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np

from split_drake.poses import make_pose, rotation_x
from split_drake.station.config import ContactApproximation, ContactModel, StationConfig
from split_drake.station.layout import HookShape, Layout

Factor = Literal["time step", "contact", "near-rigid", "friction", "mass", "peg radius", "peg tilt"]
FACTORS: tuple[Factor, ...] = get_args(Factor)

TIME_STEPS_S = (0.0005, 0.001, 0.002, 0.005)
CONTACTS: tuple[tuple[str, ContactModel, ContactApproximation], ...] = (
    ("point, similar", "point", "similar"),
    ("point, lagged", "point", "lagged"),
    ("hydroelastic, sap", "hydroelastic_with_fallback", "sap"),
    ("hydroelastic, similar", "hydroelastic_with_fallback", "similar"),
    ("hydroelastic, lagged", "hydroelastic_with_fallback", "lagged"),
)
# Drake's usual threshold, and none.
NEAR_RIGID = (1.0, 0.0)
FRICTIONS = (0.4, 0.6, 1.0)
MASSES_KG = (0.15, 0.30, 0.50)
PEG_RADII_M = (0.004, 0.008)
PEG_TILTS_DEG = (0.0, 20.0)


@dataclass(frozen=True)
class Cell:
    """One row of the study.

    Attributes:
        kind: a mug held still for some seconds, or picked and hung.
        factor: what differs from the default; None for the default itself.
        value: of the factor, in words.
        station: as simulated.
        mass_kg: of every mug; each its own where None.
    """

    kind: Literal["hold", "hang"]
    factor: Factor | None
    value: str
    station: StationConfig
    mass_kg: float | None = None

    @property
    def name(self) -> str:
        """The cell's name, unique in the study."""
        return f"{self.kind}: {self.factor or 'default'} {self.value}".strip()


def study_cells(default: StationConfig, factors: tuple[Factor, ...]) -> tuple[Cell, ...]:
    """Return the cells of a default station and those in which one of `factors` differs."""
    cells = [Cell("hold", None, "", default), *_hold_cells(default)]
    cells += [Cell("hang", None, "", default), *_hang_cells(default)]
    return tuple(cell for cell in cells if cell.factor is None or cell.factor in factors)


def _hold_cells(default: StationConfig) -> Iterator[Cell]:
    for step_s in TIME_STEPS_S:
        station = replace(default, time_step_s=step_s)
        yield Cell("hold", "time step", f"{1e3 * step_s:g} ms", station)
    for name, model, approximation in CONTACTS:
        station = replace(default, contact_model=model, contact_approximation=approximation)
        yield Cell("hold", "contact", name, station)
    for threshold in NEAR_RIGID:
        station = replace(default, near_rigid_threshold=threshold)
        yield Cell("hold", "near-rigid", f"{threshold:g}", station)
    for friction in FRICTIONS:
        yield Cell("hold", "friction", f"{friction:g}", replace(default, friction=friction))


def _hang_cells(default: StationConfig) -> Iterator[Cell]:
    for friction in FRICTIONS:
        yield Cell("hang", "friction", f"{friction:g}", replace(default, friction=friction))
    for mass_kg in MASSES_KG:
        yield Cell("hang", "mass", f"{mass_kg:g} kg", default, mass_kg)
    for radius_m in PEG_RADII_M:
        layout = replace(default.layout, hook=HookShape(peg_radius_m=radius_m))
        station = replace(default, layout=layout)
        yield Cell("hang", "peg radius", f"{1e3 * radius_m:g} mm", station)
    for tilt_deg in PEG_TILTS_DEG:
        station = replace(default, layout=_with_peg_tilted(default.layout, tilt_deg))
        yield Cell("hang", "peg tilt", f"{tilt_deg:g} deg", station)


def _with_peg_tilted(layout: Layout, tilt_deg: float) -> Layout:
    """Return the layout with the peg's tip that much above its root, seen from K."""
    X_WK = make_pose(rotation_x(np.radians(tilt_deg)), layout.X_WK[:3, 3])
    return replace(layout, X_WK=X_WK)
