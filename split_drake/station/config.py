"""What a station is made of, as numbers; the defaults are those the project was measured with."""

from dataclasses import dataclass, fields
from typing import Any, Literal, get_args

from split_drake.bad_input import require_number, require_numbers
from split_drake.depth_noise import DepthNoiseLevel
from split_drake.station.layout import Layout

ContactModel = Literal["point", "hydroelastic_with_fallback"]
ContactApproximation = Literal["sap", "similar", "lagged"]


@dataclass(frozen=True)
class StationConfig:
    """Layout, contact model and control of a station.

    Attributes:
        layout: where cameras, table and hook stand.
        time_step_s: of the discrete plant.
        contact_model: point contact; or hydroelastic contact of compliant pads with everything
            else, which is rigid, and point contact elsewhere.
        contact_approximation: of Drake's discrete contact solver.
        friction: Coulomb coefficient of every pair of surfaces.
        dissipation_s_per_m: Hunt-Crossley dissipation of every surface.
        point_stiffness_n_per_m: of the point contact; a tenth of the default lets held mugs slip.
        relaxation_time_s: of SAP's linear dissipation; 0.1 lets held mugs slip.
        near_rigid_threshold: Drake's `sap_near_rigid_threshold`; 0 for none.  Drake's default, 1,
            softens contact that is too stiff for the step, and light things most: pads sank 4 mm
            into what weighs 7 to 15 g.  With 0.1 they sink as with 0, and SAP keeps a bound.
        pad_modulus_pa: of the pads in hydroelastic contact.
        arm_kp_nm_per_rad, arm_kd_nms_per_rad: implicit PD gains of the seven arm joints.
        finger_kp_n_per_m, finger_kd_ns_per_m: implicit PD gains of each finger.
        meshcat_rate_hz: how often a station with a Meshcat publishes to it.
        depth_noise: how badly its depth cameras err, see `split_drake.depth_noise`.

    Raises ValueError where a number is not positive (the threshold may be 0), a joint's gain is
    missing, or a contact model is unknown.
    """

    layout: Layout
    time_step_s: float = 0.002
    contact_model: ContactModel = "point"
    contact_approximation: ContactApproximation = "sap"
    friction: float = 0.8
    dissipation_s_per_m: float = 10.0
    point_stiffness_n_per_m: float = 1e5
    relaxation_time_s: float = 0.02
    near_rigid_threshold: float = 0.1
    pad_modulus_pa: float = 1e7
    arm_kp_nm_per_rad: tuple[float, ...] = (3000.0, 3000.0, 3000.0, 3000.0, 1500.0, 1500.0, 1000.0)
    arm_kd_nms_per_rad: tuple[float, ...] = (150.0, 150.0, 150.0, 150.0, 60.0, 60.0, 40.0)
    finger_kp_n_per_m: float = 4000.0
    finger_kd_ns_per_m: float = 80.0
    meshcat_rate_hz: float = 30.0
    depth_noise: DepthNoiseLevel = "none"

    def __post_init__(self) -> None:
        require_numbers(self)
        for name, kinds in (
            ("contact_model", get_args(ContactModel)),
            ("contact_approximation", get_args(ContactApproximation)),
            ("depth_noise", get_args(DepthNoiseLevel)),
        ):
            if getattr(self, name) not in kinds:
                raise ValueError(f"{name} is {getattr(self, name)!r}; expected one of {kinds}")
        for entry in fields(self):
            value = getattr(self, entry.name)
            if isinstance(value, tuple):
                if len(value) != 7 or not min(value) > 0.0:
                    raise ValueError(f"{entry.name} is {value}; expected seven positive numbers")
            elif entry.name == "near_rigid_threshold":
                require_number(entry.name, value, 0.0)
            elif isinstance(value, (int, float)) and not value > 0.0:
                raise ValueError(f"{entry.name} is {value}; expected a positive number")

    def physics(self) -> dict[str, Any]:
        """Return contact and control by name, which outcomes depend on wherever things stand."""
        return {name: getattr(self, name) for name in PHYSICS}


# What of a station is contact and control.
PHYSICS = tuple(
    entry.name
    for entry in fields(StationConfig)
    if entry.name not in ("layout", "meshcat_rate_hz", "depth_noise")
)
