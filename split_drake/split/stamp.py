"""Add the checksum that `load_checkpoint` asks for: `python -m split_drake.split.stamp FILE ...`.

For checkpoints that were written before there was one.  Tensors and all other metadata stay as they
are, to the bit.  Since the file's own hash changes, and checkpoints that were trained from this one
name it by that, the hash before is kept beside the checksum.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from safetensors.torch import save_file

from split_drake.experiments.command import run_command
from split_drake.experiments.provenance import file_sha256
from split_drake.files import replacing
from split_drake.split.checkpoint import (
    CHECKSUM,
    content_sha256,
    load_checkpoint,
    read_content,
    rebuilt,
)

STAMPED_FROM = "stamped_from"


@dataclass(frozen=True)
class StampOptions:
    """Which files to stamp.

    Attributes:
        files: checkpoints; one that has a checksum already is compared with it, and left alone.
    """

    files: Annotated[tuple[Path, ...], tyro.conf.Positional]


def stamp(path: Path) -> bool:
    """Add a checksum to a checkpoint; return whether it had none.

    Raises CheckpointError where the file is no checkpoint, or is not what its checksum says.
    """
    metadata, tensors = read_content(path)
    if CHECKSUM in metadata:
        load_checkpoint(path)
        return False
    rebuilt(path, metadata, tensors)
    checksum = content_sha256(metadata, tensors)
    stamped = {**metadata, CHECKSUM: checksum, STAMPED_FROM: file_sha256(path)}
    with replacing(path) as temporary:
        save_file(tensors, temporary, stamped)
    return True


def known_hashes(path: Path) -> set[str]:
    """Return the file's SHA-256, and the one that it had before it was stamped."""
    metadata, _ = read_content(path)
    return {file_sha256(path), metadata.get(STAMPED_FROM, "")} - {""}


def main(options: StampOptions) -> None:
    """Stamp the files, and say of each what was done."""
    for path in options.files:
        print(f"{path}: {'checksum added' if stamp(path) else 'has a checksum, which is right'}")


if __name__ == "__main__":
    run_command(main, StampOptions, __doc__)
