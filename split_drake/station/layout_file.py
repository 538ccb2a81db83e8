"""A layout as a line of JSON, for files that depend on where table and hook stand."""

import json
from dataclasses import asdict

import numpy as np

from split_drake.scene import Workspace
from split_drake.station.layout import HookShape, Layout


def layout_to_json(layout: Layout) -> str:
    """Return the layout without its cameras, of which planners know nothing."""
    fields = {
        "workspace": asdict(layout.workspace),
        "X_WK": np.asarray(layout.X_WK).tolist(),
        "hook": asdict(layout.hook),
        "table_size_m": layout.table_size_m,
        "p_WTable": layout.p_WTable,
    }
    return json.dumps(fields, sort_keys=True)


def layout_from_json(text: str) -> Layout:
    """Return the layout; its cameras are those that `Layout` has by default."""
    fields = json.loads(text)
    workspace = dict(fields["workspace"])
    workspace["p_WCenter"] = tuple(workspace["p_WCenter"])
    return Layout(
        workspace=Workspace(**workspace),
        X_WK=np.array(fields["X_WK"]),
        hook=HookShape(**fields["hook"]),
        table_size_m=tuple(fields["table_size_m"]),
        p_WTable=tuple(fields["p_WTable"]),
    )
