"""SE(3)-DiffusionFields as it is made for: of one segment of the cloud at a time."""

from functools import partial

from split_drake.baselines.learning.method import Method
from split_drake.baselines.learning.methods.se3dif import METHOD as WHOLE
from split_drake.baselines.learning.methods.se3dif import prepare

METHOD = Method(
    "se3dif_segments",
    WHOLE.learning_rates,
    WHOLE.scenes,
    partial(prepare, segments=True),
)
