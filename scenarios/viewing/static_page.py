"""Pages of MeshCat that are written without its server, which would listen on all addresses.

The `meshcat` package draws by sending commands to a window; here they are kept, and a page runs
them by the viewer that the package ships.
"""

import base64
from pathlib import Path
from typing import Any

import meshcat
import umsgpack

_VIEWER = Path(meshcat.__file__).parent / "viewer" / "dist" / "main.min.js"
_PAGE = """<!DOCTYPE html>
<html>
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title>
<style>
body {{ margin: 0; }}
#meshcat-pane {{ width: 100vw; height: 100vh; overflow: hidden; }}
</style>
</head>
<body>
<div id="meshcat-pane"></div>
<script>
{viewer}
</script>
<script>
var viewer = new MeshCat.Viewer(document.getElementById("meshcat-pane"));
for (const text of {commands}) {{
  viewer.handle_command_bytearray(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)));
}}
</script>
<script id="embedded-json"></script>
</body>
</html>
"""


class StaticWindow:
    """Stands for the window of a `meshcat.Visualizer`, and keeps what is drawn."""

    def __init__(self) -> None:
        self._commands: list[bytes] = []

    def send(self, command: Any) -> None:
        """Keep a command of `meshcat.commands`."""
        self._commands.append(umsgpack.packb(command.lower()))

    def page(self, title: str) -> str:
        """Return a self-contained HTML page of what was drawn."""
        commands = [base64.b64encode(command).decode() for command in self._commands]
        viewer = _VIEWER.read_text(encoding="utf-8")
        return _PAGE.format(title=title, viewer=viewer, commands=commands)


def static_visualizer() -> tuple[meshcat.Visualizer, StaticWindow]:
    """Return a visualizer without a server, and its window."""
    window = StaticWindow()
    return meshcat.Visualizer(window=window), window
