"""What a run was made with: versions, commit, checkpoint, memory."""

import hashlib
import platform
import resource
import subprocess
from importlib.metadata import version
from pathlib import Path

_PACKAGES = ("drake", "torch", "numpy", "trimesh", "ompl")


def package_versions() -> dict[str, str]:
    """Return {package: version} of what results depend on, Python among them."""
    return {"python": platform.python_version(), **{name: version(name) for name in _PACKAGES}}


def git_commit() -> str | None:
    """Return the source tree's commit, "-dirty" appended where changed; None without git."""
    root = Path(__file__).parents[1]
    if not (root / ".git").exists():
        return None
    command = ["git", "describe", "--always", "--abbrev=40", "--dirty", "--exclude=*"]
    run = subprocess.run(command, cwd=root, capture_output=True, text=True, check=False)
    return run.stdout.strip() if run.returncode == 0 else None


def peak_memory_bytes() -> int:
    """Return the most memory that this process has had resident."""
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def file_sha256(path: Path) -> str:
    """Return the hexadecimal SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
