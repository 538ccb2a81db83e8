"""What a run was made with: versions, commit, checkpoint, memory."""

import hashlib
import json
import platform
import resource
import subprocess
from collections.abc import Callable
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

UNKNOWN_COMMIT = "unknown"

_CPUINFO = Path("/proc/cpuinfo")
_VECTORS = ("amx_bf16", "avx512_bf16", "avx512f", "avx2", "sse4_1")
_PACKAGES = ("drake", "torch", "numpy", "trimesh", "ompl")
_ROOT = Path(__file__).parents[2]
_SOURCES = ("split_drake", "planning", "models", "scenarios")
_SUFFIXES = (".py", ".urdf", ".xml", ".obj", ".json", ".npz")


def code_version() -> dict[str, Any]:
    """Return what made a run: the code's commit, a checksum of it, versions, and the processor."""
    return {
        "commit": git_commit(),
        "code_sha256": code_sha256(),
        "versions": package_versions(),
        "processor": processor(),
    }


def package_versions() -> dict[str, str]:
    """Return {package: version} of what results depend on, Python among them."""
    return {"python": platform.python_version(), **{name: version(name) for name in _PACKAGES}}


def processor() -> str:
    """Return the processor's name and the widest of its vector extensions that PyTorch uses."""
    fields: dict[str, str] = {}
    for line in _CPUINFO.read_text().splitlines() if _CPUINFO.exists() else []:
        name, _, value = line.partition(":")
        fields.setdefault(name.strip(), value.strip())
    flags = fields.get("flags", "").split()
    widest = next((name for name in _VECTORS if name in flags), "")
    named = fields.get("model name") or platform.processor() or platform.machine()
    return f"{named}, {widest.upper()}" if widest else named


def git_commit() -> str:
    """Return the source tree's commit, "-dirty" appended where changed; "unknown" without git."""
    if not (_ROOT / ".git").exists():
        return UNKNOWN_COMMIT
    command = ["git", "describe", "--always", "--abbrev=40", "--dirty", "--exclude=*"]
    try:
        run = subprocess.run(command, cwd=_ROOT, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return UNKNOWN_COMMIT
    return run.stdout.strip()


def code_sha256() -> str:
    """Return a checksum of modules, robot, mugs and regions, edited or unknown to git as they are.

    Weights and problems are named beside it by the runs that they matter to.  Parts of a file that
    is being made are none of it.
    """
    digest = hashlib.sha256()
    for path in sorted(path for package in _SOURCES for path in (_ROOT / package).rglob("*")):
        name = path.relative_to(_ROOT)
        unfinished = any(part.endswith(".parts") for part in name.parts)
        if path.suffix in _SUFFIXES and "problems" not in name.parts and not unfinished:
            digest.update(f"{name}\0".encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()


def peak_memory_bytes() -> int:
    """Return the most memory that this process has had resident."""
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def file_sha256(path: Path) -> str:
    """Return the hexadecimal SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def combined_sha256(shard_hashes: dict[str, str]) -> str:
    """Return the hash of a dataset, given that of each shard."""
    text = json.dumps(shard_hashes, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def qualified_name(function: Callable[..., object]) -> str:
    """Return where a function is defined, and its name there; of a partial, those of its function.

    Objects that are called are named by their class.
    """
    while isinstance(function, partial):
        function = function.func
    named = function if hasattr(function, "__qualname__") else type(function)
    return f"{named.__module__}.{named.__qualname__}"


def short_hash(value: object) -> str:
    """Return a hash as far as people read it, and whether the tree had changes; "" of nothing."""
    text = str(value or "")
    return text[:12] + ("-dirty" if text.endswith("-dirty") else "")
