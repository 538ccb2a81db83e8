"""A recording as a small page beside a script that all recordings of a folder share.

Meshcat's own page holds its script, 2 MB, and what it draws as text.  Here the script lies beside
the pages, and what is drawn is compressed; words, a legend and controls are added.  A page opens
from a file, without a server.
"""

import base64
import hashlib
import json
import re
import zlib
from importlib import resources
from pathlib import Path

from scenarios.viewing.narration import Narration
from split_drake.files import write_atomically

_PARTS = resources.files("scenarios.viewing") / "parts"
_SCRIPT = re.compile(r'<script type="text/javascript">(.*?)</script>', re.DOTALL)
_COMMAND = re.compile(
    r'fetch\("data:application/octet-binary;base64,([A-Za-z0-9+/=]+)"\)\s*'
    r"\.then\(res => res\.arrayBuffer\(\)\)\s*"
    r"\.then\(buffer => viewer\.handle_command_bytearray\(new Uint8Array\(buffer\)\)\);"
)


class UnknownPageError(ValueError):
    """Meshcat's page is not as it is known to be."""


def write_replay(path: Path, page: str, narration: Narration) -> None:
    """Write a recording and, where it is missing, the script that it shares with others.

    Args:
        path: of the page.
        page: Meshcat's own, with everything in it.
        narration: what is said while it plays.

    Raises UnknownPageError where Meshcat's page has no script, or draws nothing.
    """
    found = _SCRIPT.search(page)
    commands = [base64.b64decode(each) for each in _COMMAND.findall(page)]
    if found is None or not commands:
        raise UnknownPageError(
            f"Meshcat's page has {len(commands)} commands and {'a' if found else 'no'} script; "
            "expected some, as in Drake 1.51"
        )
    script = found[1]
    name = f"meshcat-{hashlib.sha256(script.encode()).hexdigest()[:12]}.js"
    path.parent.mkdir(parents=True, exist_ok=True)
    if not (shared := path.parent / name).exists():
        write_atomically(shared, script)
    small = page[: found.start()] + f'<script src="{name}"></script>' + page[found.end() :]
    first = _COMMAND.search(small)
    assert first is not None  # there are commands
    before, after = small[: first.start()], _COMMAND.sub("", small[first.end() :])
    write_atomically(path, before + _play(commands, narration) + _with_style(after, narration))


def _play(commands: list[bytes], narration: Narration) -> str:
    """Return the script that draws and tells."""
    packed = b"".join(len(each).to_bytes(4, "little") + each for each in commands)
    drawn = base64.b64encode(zlib.compress(packed, 9)).decode()
    told = json.dumps(narration.to_json(), separators=(",", ":")).replace("<", "\\u003c")
    code = (_PARTS / "replay.js").read_text(encoding="utf-8")
    return f'const PACKED = "{drawn}";\nconst NARRATION = {told};\n{code}'


def _with_style(rest: str, narration: Narration) -> str:
    """Return the rest of the page, with what is laid over the scene."""
    style = (_PARTS / "replay.css").read_text(encoding="utf-8")
    over = (_PARTS / "replay.html").read_text(encoding="utf-8")
    title = narration.title.replace("&", "&amp;").replace("<", "&lt;")
    head = '<meta name="viewport" content="width=device-width, initial-scale=1">'
    shown = f"<style>\n{style}</style>\n{over}"
    return rest.replace("</body>", f"{head}<title>{title}</title>\n{shown}\n</body>")
