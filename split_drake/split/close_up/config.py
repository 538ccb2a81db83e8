"""What a close-up shows, and what it takes to rebuild the network that judges it."""

from dataclasses import dataclass

from split_drake.bad_input import BadInputError, require_count, require_number, require_numbers

# What a close-up says of each of its cells, see `images.close_ups`.
CHANNELS = 4


@dataclass(frozen=True)
class CloseUpConfig:
    """What a close-up shows, and the network that judges it.

    Attributes:
        cells: of the box around a grasp, along x, y and z of G.
        spacing_m: between the cells' middles, along each axis.
        middle_z_m: of the box, along the approach; its other middles are G's.
        fine_m, coarse_m: distances to the surface seen are told up to these.
        channels: of the four convolutions; the first and the third halve the resolution.
        width: of the layers after them.
    """

    cells: tuple[int, int, int] = (10, 40, 18)
    spacing_m: tuple[float, float, float] = (0.0045, 0.003, 0.004)
    middle_z_m: float = -0.010
    fine_m: float = 0.008
    coarse_m: float = 0.04
    channels: tuple[int, int, int, int] = (16, 24, 48, 48)
    width: int = 96

    def __post_init__(self) -> None:
        require_numbers(self)
        for name, length in (("cells", 3), ("spacing_m", 3), ("channels", 4)):
            if len(values := getattr(self, name)) != length:
                raise BadInputError(f"{name} is {values}; expected {length} numbers")
        for name in ("cells", "channels"):
            for value in getattr(self, name):
                require_count(name, value, 1)
        for value in (*self.spacing_m, self.fine_m, self.coarse_m):
            require_number("a distance of a close-up", value, 1e-4, 1.0, "metres")
        require_count("width", self.width, 1)

    @property
    def cells_after(self) -> int:
        """Cells that are left where the resolution has been halved twice."""
        x, y, z = (-(-count // 4) for count in self.cells)
        return x * y * z
